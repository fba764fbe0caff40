"""Failure: one rank's error ends all ranks, within seconds, with one message that names the rank and the cause.

What a rank raises it can say. What kills it, it cannot: so each rank has a witness, a process forked before anything is large, that waits at the end
of a pipe. It passes on what its rank says, or says how it died; of the witnesses of one machine the first speaks, since ranks that are stopped
because of another have nothing to say. Until it has spoken it holds the sockets that its rank had from the launcher, which so takes the rank for
alive and stops no other; then it stops the others itself. So it is the right one that speaks first, however busy the machine is.
"""

from __future__ import annotations

import os
import shutil
import signal
import socket
import sys
import time
import traceback
from collections.abc import Callable, Iterable
from contextlib import suppress

from luxel import interrupts
from luxel.errors import in_words

FAILED = 2
_LAST_WORD = 0.5  # seconds that the launcher has to pass on what a rank said before it stops them all
_CLEANING = 8.0  # seconds that rank 0 has, when all are interrupted, to end what it computes, keep a state, and remove what it was writing
_SILENCE = 2.0  # seconds after one's word in which the others' is not news
_PEACE, _SPOKEN, _NAME, _FELLOWS, _BEGUN, _ENDED = b".", b"!", b"=", b"&", b"+", b"-"  # first bytes of the lines that a rank tells its witness


class Witness:
    """What says how a rank ended; made before MPI starts and before there are threads. Where there is no fork, the rank speaks itself.

    Attributes:
        name: "rank 1 of 4", once that is known.
    """

    def __init__(self) -> None:
        self.name, self._pipe, self._rank = "a rank", -1, os.getpid()
        if hasattr(os, "fork"):
            read, self._pipe = os.pipe()
            launcher = os.getppid()
            if os.fork() == 0:
                os.close(self._pipe)
                _wait(read, self._rank, launcher)
            os.close(read)

    def know(self, name: str, fellows: list[int]) -> None:
        """The rank is called this, and these processes are the ranks of its machine."""
        self.name = name
        self._tell(_NAME, name.encode())
        self._tell(_FELLOWS, " ".join(map(str, fellows)).encode())

    def unfinished(self, path: str, begun: bool) -> None:
        """A file or folder is begun, which is to be removed should the rank end without peace; or it is ended (`luxel.unfinished`)."""
        self._tell(_BEGUN if begun else _ENDED, os.fsencode(path))

    def rest(self) -> None:
        """The rank ends in peace."""
        self._tell(_PEACE)

    def end(self, error: BaseException, first: bool, abort: Callable[[int], None]) -> None:
        """Say what went wrong, unless another rank has, and stop all of them.

        Args:
            error: What the rank raised.
            first: It is rank 0, which writes.
            abort: Ends all ranks with an exit code.
        """
        interrupted = isinstance(error, KeyboardInterrupt)  # all are, at once
        if interrupted and not first:
            time.sleep(_CLEANING)
        text = f"luxel: {interrupts.told()}" if interrupted else f"luxel: {self.name}: {told(error)}"
        if self._pipe < 0:
            print(text, file=sys.stderr, flush=True)  # noqa: T201
        self._tell(_SPOKEN, text.encode(errors="backslashreplace"))
        time.sleep(_LAST_WORD)  # a launcher that is told to stop drops what it has not read yet
        abort(interrupts.exit_code() if interrupted else FAILED)

    def _tell(self, kind: bytes, what: bytes = b"") -> None:
        if self._pipe >= 0 and os.getpid() == self._rank:  # not in a child of the rank
            with suppress(BrokenPipeError):  # it has heard enough
                os.write(self._pipe, kind + what.hex().encode() + b"\n")


def told(error: BaseException) -> str:
    """What an error says: luxel's own and the system's in a line, others with their traceback."""
    if isinstance(error, SystemExit):
        return f"left with exit code {error.code}"
    return in_words(error) or "".join(traceback.format_exception(error)).rstrip()


def _wait(read: int, rank: int, launcher: int) -> None:
    """What the witness does; never returns."""
    try:
        os.setsid()  # the launcher stops the group of a rank, at once
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.SIG_IGN)
        nowhere = os.open(os.devnull, os.O_RDWR)
        os.dup2(nowhere, 0)
        os.dup2(nowhere, 1)
        name, text, begun, fellows = "a rank", "", set[bytes](), list[int]()
        for line in os.fdopen(read, "rb"):
            if not line.endswith(b"\n"):
                break  # it died while it spoke
            kind, what = line[:1], bytes.fromhex(line[1:].decode())
            if kind == _PEACE:
                return
            if kind == _NAME:
                name = what.decode()
            elif kind == _FELLOWS:
                fellows = _descriptors(map(int, what.split()))
                if not fellows:
                    _close_but(read)
            elif kind == _SPOKEN:
                text = what.decode()
                break
            elif kind == _BEGUN:
                begun.add(what)
            else:
                begun.discard(what)
        for path in begun:
            _remove(path)
        if text:  # the rank lives, and will stop them all
            fellows = []
        text = text or f"luxel: {name}: {_cause(rank)}"
        with socket.socket(socket.AF_UNIX) as first:
            if sys.platform == "linux":
                first.bind(f"\0luxel-{launcher}")  # a name that only one can have, and that goes with it
            os.write(2, f"{text}\n".encode())
            os.dup2(nowhere, 2)
            for fellow in fellows:
                with suppress(ProcessLookupError):
                    signal.pidfd_send_signal(fellow, signal.SIGKILL)
            _close_but(first.fileno())
            time.sleep(_SILENCE)
    finally:
        os._exit(0)


def _descriptors(processes: Iterable[int]) -> list[int]:
    """What names these processes even when others have got their numbers; none where the system has no such thing, and the launcher stops them."""
    try:
        return [os.pidfd_open(process) for process in processes]
    except (AttributeError, OSError):
        return []


def _close_but(kept: int) -> None:
    """What the rank had from the launcher, and all else above the standard three but one."""
    os.closerange(3, kept)
    os.closerange(kept + 1, 1024)


def _remove(path: bytes) -> None:
    with suppress(OSError):
        shutil.rmtree(path) if os.path.isdir(path) else os.unlink(path)


def _cause(process: int) -> str:
    """What ended a process that nobody has waited for yet."""
    try:
        with open(f"/proc/{process}/stat") as file:
            status = int(file.read().rsplit(")", 1)[1].split()[49])
    except (OSError, ValueError, IndexError):
        status = 0
    if status & 127:
        name = signal.Signals(status & 127).name
        return f"killed by {name}" + (" (out of memory?)" if name == "SIGKILL" else "")
    return f"left with exit code {status >> 8}" if status else "was killed, or left without a word"
