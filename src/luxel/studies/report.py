"""The folder that a study writes: README.md, with tables (also as CSV and JSON), figures (matplotlib) and pictures beside it.

Everything is written as soon as it is there, each file whole or not at all, so a study that is interrupted keeps what it has.
"""

from __future__ import annotations

import csv
import io
import json
import math
import os
import platform
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import date
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from luxel.arrays import Array
from luxel.errors import ExtraMissingError, FileError
from luxel.io.files import atomic_write
from luxel.studies.study import HERE, Study

Row = Mapping[str, Any]


class Report:
    """Collects what a study finds.

    Args:
        folder: Where to write; made if it is not there. Files of the same name are replaced, others are left.
        study: Whose report it is.
        quick: Say in the report that the run was a quick one.

    Raises:
        ExtraMissingError: matplotlib is not installed: said before the work, not after it.
        FileError: The folder cannot be made.
    """

    def __init__(self, folder: Path, study: Study, quick: bool = False) -> None:
        _figure_class()
        self.folder, self.study = folder, study
        self.files: list[Path] = []
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise FileError(folder, f"cannot make this folder: {error.strerror}") from error
        short = " A quick run: fewer and smaller cases than the whole study has." if quick else ""
        self._parts = [f"# {study.title}\n\nAfter {study.paper}.{short}\n\n{machine()}"]
        self._numbers: dict[str, Any] = {"study": study.name, "paper": study.paper, "machine": machine(), "quick": quick, "tables": {}}

    def say(self, markdown: str) -> None:
        """A paragraph, or a heading."""
        self._add(markdown.strip())

    def table(self, name: str, title: str, rows: Sequence[Row], note: str = "") -> None:
        """Rows of named cells, as a table of the report, NAME.csv and NAME.json.

        Args:
            name: Of the files.
            title: Heading.
            rows: Cells by column; a column that a row lacks stays empty. A row whose `source` is not `HERE` is set in italics.
            note: A sentence below the heading.
        """
        columns = list(dict.fromkeys(key for row in rows for key in row))
        plain = [{key: _plain(row.get(key)) for key in columns} for row in rows]
        text = io.StringIO()
        writer = csv.DictWriter(text, columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows(plain)
        self._write(f"{name}.csv", text.getvalue().encode())
        self._write(f"{name}.json", json.dumps(plain, indent=1, allow_nan=False).encode())
        self._numbers["tables"][name] = plain
        self._add(f"## {title}\n\n{note.strip()}\n\n{markdown_table(columns, rows)}")

    @contextmanager
    def figure(self, name: str, title: str, note: str = "", size: tuple[float, float] = (7.0, 4.2)) -> Iterator[Any]:
        """Around the drawing of a figure: gives matplotlib's axes, and writes NAME.png when the block ends. `size` is in inches."""
        figure = _figure_class()(figsize=size, dpi=150, layout="constrained")
        axes = figure.subplots()
        axes.grid(alpha=0.3)
        yield axes
        axes.set_title(title)
        handles, labels = axes.get_legend_handles_labels()
        if len(handles) > 5:  # more would hide what they explain
            figure.legend(handles, labels, fontsize="small", loc="outside right upper")
        elif handles:
            axes.legend(fontsize="small")
        data = io.BytesIO()
        figure.savefig(data, format="png")
        self._write(f"{name}.png", data.getvalue())
        self._add(f"## {title}\n\n{note.strip()}\n\n![{title}]({name}.png)")

    def picture(self, name: str, title: str, image: Array, note: str = "") -> None:
        """A picture, (h, w, 3 or 4) uint8, sRGB, as NAME.png."""
        from luxel.io.images import write_png

        write_png(self.folder / f"{name}.png", image)
        self.files.append(self.folder / f"{name}.png")
        self._add(f"## {title}\n\n{note.strip()}\n\n![{title}]({name}.png)")

    def _add(self, markdown: str) -> None:
        self._parts.append(re.sub(r"\n{3,}", "\n\n", markdown))
        self._write("README.md", ("\n\n".join(self._parts) + "\n").encode())
        self._write("results.json", json.dumps(self._numbers, indent=1, allow_nan=False).encode())

    def _write(self, name: str, data: bytes) -> None:
        path = self.folder / name
        with atomic_write(path) as file:
            file.write(data)
        if path not in self.files:
            self.files.append(path)


def published(axes: Any, x: Sequence[float], y: Sequence[float], source: str) -> None:
    """Plot figures that a publication gives: dashed, hollow, and named after it."""
    axes.plot(x, y, linestyle="--", marker="o", fillstyle="none", label=f"{source} (published)")


def markdown_table(columns: Sequence[str], rows: Sequence[Row]) -> str:
    """A Markdown table; columns of numbers to the right, rows from a publication in italics."""
    numeric = [all(isinstance(row.get(key), (int, float, type(None))) for row in rows) for key in columns]
    lines = ["| " + " | ".join(columns) + " |", "| " + " | ".join("---:" if right else "---" for right in numeric) + " |"]
    for row in rows:
        cells = [_shown(row.get(key)) for key in columns]
        if row.get("source", HERE) != HERE:
            cells = [f"*{cell}*" if cell else "" for cell in cells]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _shown(value: Any) -> str:
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return ""
    if isinstance(value, float):
        return f"{value:.4g}" if abs(value) < 1e4 else f"{value:,.0f}"
    return f"{value:,}" if isinstance(value, int) and not isinstance(value, bool) else str(value).replace("|", "\\|")


def _plain(value: Any) -> Any:
    """What JSON and CSV have words for: no NumPy numbers, no infinity."""
    value = value.item() if hasattr(value, "item") else value
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _figure_class() -> Any:
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise ExtraMissingError("matplotlib", "study", "a study") from error
    return Figure


def machine() -> str:
    """Processor, cores that this process may use, versions and date, in one line."""
    info = Path("/proc/cpuinfo")
    named = re.search(r"^model name\s*:\s*(.+)$", info.read_text() if info.exists() else "", re.MULTILINE)
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    libraries = ", ".join(f"{name} {_version(name)}" for name in ("luxel", "numba", "numpy"))
    processor = named[1] if named else platform.processor() or platform.machine()
    return f"{processor}, {cores} cores, {platform.system()}; Python {platform.python_version()}, {libraries}; {date.today()}."


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "(not installed)"
