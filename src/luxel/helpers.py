"""Helpers: threads that wait to call a function beside the one that asks for it. Not an executor of the standard library: that takes 50 us to hand
a task over, this 5."""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Callable
from queue import SimpleQueue
from typing import Any


class _Task:
    """A call for a helper; who comes first, helper or caller, has it.

    Who that is stands first in `takers`: an append is one step, and done twice does no harm, whatever interrupts it.
    """

    __slots__ = ("arguments", "done", "ended", "error", "function", "takers")

    def __init__(self, function: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
        self.function, self.arguments = function, arguments
        self.error: BaseException | None = None
        self.takers: list[str] = []
        self.done, self.ended = threading.Lock(), False
        self.done.acquire()

    def help(self) -> None:
        self.takers.append("helper")
        if self.takers[0] != "helper":
            return
        try:
            self.function(*self.arguments)
        except BaseException as error:  # for the caller
            self.error = error
        finally:
            self.arguments, self.ended = (), True
            self.done.release()

    def finish(self) -> None:
        """Take it away from the helpers, or wait for the one that has it."""
        self.takers.append("caller")
        if self.takers[0] == "caller":  # one that has not begun has nothing left to do
            self.arguments = ()  # it may wait for long behind others, and must not hold what it will not need
            return
        while not self.ended:
            self.done.acquire()


def _finish(tasks: list[_Task]) -> None:
    """Wait for all, whatever interrupts: nobody may still write when the caller goes on."""
    try:
        for task in tasks:
            task.finish()
    except BaseException:
        _finish(tasks)
        raise


class _Pool:
    """Threads of one process, as many as were ever wanted at once."""

    def __init__(self) -> None:
        self.process, self.tasks, self.threads = os.getpid(), SimpleQueue[_Task](), 0

    def _help(self) -> None:
        while True:
            self.tasks.get().help()

    def grow(self, wanted: int) -> None:
        with contextlib.suppress(RuntimeError):  # the system has no more threads: those that there are do it, or the caller alone
            while self.threads < wanted:
                threading.Thread(target=self._help, name=f"luxel_{self.threads}", daemon=True).start()
                self.threads += 1


_pool: _Pool | None = None
_lock = threading.Lock()


def _after_fork() -> None:
    global _pool, _lock
    _pool, _lock = None, threading.Lock()  # threads do not survive a fork: the child makes its own


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)


def _helpers(wanted: int) -> SimpleQueue[_Task]:
    """Where at least so many wait for tasks."""
    global _pool
    with _lock:
        if _pool is None or _pool.process != os.getpid():
            _pool = _Pool()
        if _pool.threads < wanted:
            _pool.grow(wanted)
        return _pool.tasks


def call_together(function: Callable[..., Any], threads: int, *arguments: Any) -> None:
    """Call a function from `threads` threads at once, this one included; return, or raise what one of them raised, when all have ended.

    Helpers that are busy otherwise until this thread has ended are not waited for: the function must do all work that is left, whoever calls it.
    """
    if threads <= 1:
        function(*arguments)
        return
    tasks, waiting = [_Task(function, arguments) for _ in range(threads - 1)], _helpers(threads - 1)
    try:
        for task in tasks:
            waiting.put(task)
        function(*arguments)
    finally:
        _finish(tasks)
    for task in tasks:
        if task.error is not None:
            raise task.error
