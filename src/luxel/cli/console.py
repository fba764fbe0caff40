"""What a command says: results on stdout, notes and progress on stderr."""

from __future__ import annotations

import json
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Annotated, Any

import typer

from luxel.errors import LuxelWarning

Quiet = Annotated[bool, typer.Option("-q", "--quiet", help="Say nothing but errors.", rich_help_panel="What it says")]
Json = Annotated[
    bool,
    typer.Option("--json", help="The result as JSON on stdout, nothing else there.", rich_help_panel="What it says"),
]

PATIENCE = 1.0  # seconds of work before a progress bar shows


class Console:
    """Where one command speaks; `quiet` leaves errors only, `as_json` keeps stdout for programs."""

    def __init__(self, quiet: bool = False, as_json: bool = False) -> None:
        self.quiet, self.as_json = quiet, as_json
        self._told = False
        if quiet:
            warnings.simplefilter("ignore", LuxelWarning)  # within main's catch_warnings

    def note(self, text: str) -> None:
        """One line on stderr."""
        if not self.quiet:
            print(f"luxel: {text}", file=sys.stderr, flush=True)  # noqa: T201

    def result(self, data: dict[str, Any], text: str) -> None:
        """What came out: `data` for programs, else `text` for people."""
        if self.as_json:
            print(json.dumps(data, allow_nan=False))  # noqa: T201
        elif not self.quiet:
            print(text)  # noqa: T201

    @contextmanager
    def work(self, label: str) -> Iterator[Callable[..., None]]:
        """Around heavy work: says once that kernels are compiled, and gives what to report the part done (0..1) to, and another label.

        A bar shows on a terminal, after a second.
        """
        from luxel.jit import on_compile

        bar = _Bar(label, shown=not self.quiet and sys.stderr.isatty())
        try:
            with on_compile(self._compiling):
                yield bar.report
        finally:
            bar.close()

    def _compiling(self, kernel: str) -> None:
        if not self._told:
            self._told = True
            self.note("compiling kernels for this machine; only the first run waits for it ...")


class _Bar:
    def __init__(self, label: str, shown: bool) -> None:
        self.label: Any = label  # its text is asked for each time it is shown
        self.shown, self.start = shown, time.monotonic()
        self.done = 0.0
        self.progress: Any = None
        self.task: Any = None

    def report(self, done: float, label: Any = None) -> None:
        self.label = label or self.label
        if not self.shown or (self.progress is None and time.monotonic() - self.start < PATIENCE):
            return
        if self.progress is None:
            from rich.console import Console as RichConsole
            from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

            columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
            self.progress = Progress(*columns, console=RichConsole(stderr=True), transient=True)
            self.task = self.progress.add_task(self.label, total=1.0)
            self.progress.start()
        if done < self.done:  # something else has begun, whose pace is another
            self.progress.reset(self.task)
        self.done = done
        self.progress.update(self.task, completed=done, description=self.label)

    def close(self) -> None:
        if self.progress is not None:
            self.progress.stop()


def seconds(value: float) -> str:
    """A duration to read: "0.42 s", "1 min 05 s"."""
    if value < 60:
        return f"{value:.2f} s"
    return f"{int(value // 60)} min {int(value % 60):02d} s"
