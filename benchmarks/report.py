"""What the benchmarks share: medians, the machine in words, and sections of RESULTS.md that each script keeps up to date."""

from __future__ import annotations

import os
import platform
import re
import statistics
import time
from collections.abc import Callable, Sequence
from datetime import date
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
RESULTS = Path(__file__).with_name("RESULTS.md")
README = ROOT / "README.md"


def median(values: Sequence[float]) -> float:
    return statistics.median(values)


def alternating(repeats: int, *jobs: Callable[[], object], before: int = 0) -> list[list[float]]:
    """Seconds of each job, run in turns, so that whatever else the machine does falls on all of them alike; one turn before is not counted.

    `before`: how often a job is run in its turn before it is timed, so that it finds its own data in the caches, not another job's.
    """
    for job in jobs:
        job()
    times: list[list[float]] = [[] for _ in jobs]
    for _ in range(repeats):
        for job, taken in zip(jobs, times, strict=True):
            for _ in range(before):
                job()
            start = time.perf_counter()
            job()
            taken.append(time.perf_counter() - start)
    return times


def meshes() -> Path | None:
    """The folder of real models, or None."""
    folder = Path(os.environ.get("LUXEL_MESHES", ROOT.parent / "shared" / "meshes"))
    return folder if folder.is_dir() else None


def machine() -> str:
    """Processor, cores this process may use, and versions, in one line."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    libraries = ", ".join(f"{name} {_version(name)}" for name in ("luxel", "numba", "llvmlite", "numpy"))
    return f"{_processor()}, {cores} cores, {platform.system()}; Python {platform.python_version()}, {libraries}; {date.today()}"


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "(not installed)"


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    text = info.read_text() if info.exists() else ""
    fields = {key: re.search(rf"^{key}\s*:\s*(.+)$", text, re.MULTILINE) for key in ("model name", "model")}
    name, number = fields["model name"], fields["model"]
    if name is None:
        return platform.processor() or platform.machine()
    return f"{name[1]}, model {number[1]}" if number else name[1]


def table(head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A Markdown table; numbers to the right, the first column to the left."""
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    return "\n".join("| " + " | ".join(map(str, line)) + " |" for line in lines)


def milliseconds(seconds: float) -> str:
    value = seconds * 1e3
    return f"{value:.0f}" if value >= 100 else f"{value:.1f}" if value >= 10 else f"{value:.2f}"


def write_section(title: str, text: str, path: Path = RESULTS) -> None:
    """Put `text` under `## title` of RESULTS.md, or another file, in place of what stood there."""
    whole = path.read_text() if path.exists() else "# Results\n"
    head, *sections = re.split(r"(?m)^(?=## )", whole)
    kept = [section for section in sections if not section.startswith(f"## {title}\n")]
    sections = sorted([*kept, f"## {title}\n\n{text.strip()}\n"])
    path.write_text("\n".join(part.strip() + "\n" for part in [head, *sections]))
    print(f"written: {path}")


def write_between(path: Path, mark: str, text: str) -> None:
    """Put `text` between `<!-- mark -->` and `<!-- /mark -->` of a Markdown file."""
    whole = path.read_text()
    start, end = f"<!-- {mark} -->\n", f"<!-- /{mark} -->"
    before, rest = whole.split(start)
    path.write_text(before + start + text.strip() + "\n" + end + rest.split(end)[1])
    print(f"written: {path}")
