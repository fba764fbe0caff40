"""The command line: `luxel COMMAND`, one file a command. Nothing heavy is imported before a command needs it."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Sequence

from luxel import interrupts
from luxel.cluster.launchers import follows
from luxel.errors import LuxelError, in_words


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code.

    0: done. 1: something unexpected, or `diff` found a difference. 2: wrong input. 130: interrupted (143 by SIGTERM).

    Args:
        arguments: Words after `luxel`; None takes the process's own.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    if arguments is None:
        interrupts.stop_on_signals()
    if "--traceback" in words:  # it may stand anywhere
        words.remove("--traceback")
        words.insert(0, "--traceback")
    with warnings.catch_warnings():
        _show_warnings_on_one_line()
        code = _flushed(_guarded(words))
    if code == interrupts.exit_code() and arguments is None:
        os._exit(code)  # at once: not after kernels that still run, and not by the signal, as CPython may choose to
    return code


def _guarded(words: list[str]) -> int:
    try:
        from luxel.cli.app import command

        result = command().main(words, prog_name="luxel", standalone_mode=False)
        code = result if isinstance(result, int) else 0
    except SystemExit as leaving:  # a reader that went away (typer's answer to EPIPE)
        return leaving.code if isinstance(leaving.code, int) else 1
    except KeyboardInterrupt:
        code = interrupts.exit_code()
    except Exception as error:
        if not interrupts.interrupted():  # or it was made of an interrupt by what that went through, as an import makes an ImportError
            return _wrong(error, words)
        code = interrupts.exit_code()
    if interrupts.interrupted() or code == interrupts.exit_code():  # typer makes an exit of a KeyboardInterrupt, whichever signal it stood for
        print(f"luxel: {interrupts.told()}", file=sys.stderr)  # noqa: T201
        return interrupts.exit_code()
    return code


def _wrong(error: Exception, words: list[str]) -> int:
    """Say what went wrong; the exit code."""
    if isinstance(error, LuxelError):
        return _fail(str(error), 2, words, error)
    if isinstance(error, OSError):
        return _fail(in_words(error) or str(error), 2, words, error)
    if isinstance(error, MemoryError):
        return _fail(in_words(error) or "", 1, words, error)
    usage = getattr(error, "format_message", None)  # typer's own errors, wherever this version of it keeps them
    if usage and follows():
        return 2  # every rank has read the same words; the first one says what is wrong with them
    if usage:
        return _fail(_suggested(error, usage(), words), 2, words, error)
    what = str(error) or "no message"
    return _fail(f"unexpected {type(error).__name__}: {what} (--traceback shows where)", 1, words, error)


def _suggested(error: Exception, message: str, words: list[str]) -> str:
    """typer's message, with what was meant if it can be guessed, or else where to look."""
    name, near = getattr(error, "option_name", None), getattr(error, "possibilities", None)
    if name and near:
        return f"No such option {name}. Did you mean {' or '.join(near)}?"
    command = [word for word in words[:1] if not word.startswith("-")]
    path = getattr(getattr(error, "ctx", None), "command_path", " ".join(["luxel", *command]))
    return message if "Did you mean" in message else f"{message.rstrip('.')} ({path} --help shows what there is)"


def _fail(message: str, code: int, words: list[str], error: BaseException) -> int:
    if "--traceback" in words[:1]:
        import traceback

        traceback.print_exception(error)
    print("luxel: error:", " ".join(message.split()), file=sys.stderr)  # noqa: T201
    return code


def _show_warnings_on_one_line() -> None:
    from luxel.errors import LuxelWarning

    told: set[str] = set()

    def show(message: Warning | str, category: type[Warning], *rest: object) -> None:
        line = " ".join(str(message).split())
        if line not in told:
            told.add(line)
            print("luxel: warning:", line, file=sys.stderr)  # noqa: T201

    warnings.showwarning = show  # type: ignore[assignment]
    warnings.simplefilter("always", LuxelWarning)


def _flushed(code: int) -> int:
    """`code`, after the last of stdout is out; quiet when nobody reads it any more."""
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return code or 1
    return code
