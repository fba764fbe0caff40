"""The study of parallel shading, whole: what holds, what its schemes take on this processor, and what balances the load, kept in RESULTS.md.

    python benchmarks/shading.py
"""

from __future__ import annotations

import json
import tempfile
import time
from pathlib import Path

from luxel.jit import available_threads
from luxel.studies import find
from luxel.studies.report import Report, markdown_table
from luxel.studies.study import Context
from report import machine, write_section


def shown(rows: list[dict[str, object]]) -> str:
    return markdown_table(list(dict.fromkeys(key for row in rows for key in row)), rows)


def main() -> None:
    start = time.perf_counter()
    study = find("shading")
    with tempfile.TemporaryDirectory() as folder:
        study.run(Context(threads=available_threads()), Report(Path(folder), study))
        tables = json.loads((Path(folder) / "results.json").read_text())["tables"]
    took = time.perf_counter() - start
    balance = [row for row in tables["balance"] if row["units"] in (1, 8, 64)]
    pixels = balance[0]["triangles"] * balance[0]["pixels a triangle"]
    write_section("Shading study", f"""{machine()}.

`luxel study shading`, {took:.0f} s; what it models, and what follows, is in [docs/shading.md](../docs/shading.md).

{shown(tables["claims"])}

Nanoseconds a pixel on one thread, by the mean length of spans; RGB in 8.16, medians of 41 runs in turns:

{shown(tables["cpu"])}

The size of triangles into which a hexagon of {pixels:,.0f} pixels is best cut for so many units, each a classical interpolator:

{shown(balance)}""")


if __name__ == "__main__":
    main()
