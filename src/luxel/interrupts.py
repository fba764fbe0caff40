"""Requests to stop: Ctrl-C's SIGINT, and SIGTERM, which batch systems send some time before they kill. Both raise KeyboardInterrupt, so both end
cleanly; and what comes again at once, as launchers and batch systems repeat each other, does not interrupt that end.

What comes while code runs that an exception would break (`defer`) waits until that code says that it is safe (`raise_deferred`)."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable

_AGAIN = 1.0  # seconds in which a request is the same as the one before

_came: list[tuple[float, int]] = []
_fragile: list[Callable[[], bool]] = []
_deferred = False


def stop_on_signals() -> None:
    """Raise KeyboardInterrupt on SIGINT and SIGTERM, where nobody ignores or handles them otherwise; in the main thread, which alone can say so."""
    if threading.current_thread() is not threading.main_thread():
        return
    for number, usual in ((signal.SIGINT, signal.default_int_handler), (signal.SIGTERM, signal.SIG_DFL)):
        if signal.getsignal(number) is usual:
            signal.signal(number, _stop)


def _stop(number: int, frame: object) -> None:
    global _deferred
    now, before = time.monotonic(), _came[-1][0] if _came else None
    _came.append((now, number))
    if before is None or (number == signal.SIGINT and now - before > _AGAIN):  # a second Ctrl-C means it
        if any(breaks() for breaks in _fragile):
            _deferred = True
        else:
            raise KeyboardInterrupt


def defer(breaks: Callable[[], bool]) -> None:
    """From now on, what comes while `breaks()` is true, which the main thread is asked in the midst of what it does, waits for `raise_deferred`."""
    _fragile.append(breaks)


def raise_deferred() -> None:
    """Raise what has waited, if anything has; in another thread than the main one, which alone is interrupted, nothing."""
    global _deferred
    if _deferred and threading.current_thread() is threading.main_thread():
        _deferred = False
        raise KeyboardInterrupt


def interrupted() -> bool:
    """Whether a request has come: what it raised may have become another exception on its way."""
    return bool(_came)


def exit_code() -> int:
    """Of a process that was interrupted: 128 and the signal, 130 for Ctrl-C."""
    return 128 + (_came[0][1] if _came else signal.SIGINT)


def told() -> str:
    """What to say then."""
    by = _came[0][1] if _came else signal.SIGINT
    return "interrupted" if by == signal.SIGINT else f"interrupted by {signal.Signals(by).name}"
