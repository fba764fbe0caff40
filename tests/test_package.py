"""The package as a whole: what importing costs, what it offers, and that the README's and the guide's snippets run."""

import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import luxel
from luxel.cli import main

ROOT = Path(__file__).resolve().parents[1]
PAGES = ["README.md", "docs/bake.md", "docs/guide.md", "docs/hardware.md"]
HEAVY = ("numba", "llvmlite", "scipy", "trimesh", "pygltflib", "PIL", "OpenEXR", "meshoptimizer", "mpi4py")


def python(code: str) -> str:
    return subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout.strip()


def blocks(page: str, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", (ROOT / page).read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("imported", ["luxel", "luxel.scene", "luxel.io", "luxel.cli", "luxel.cli.app", "luxel.errors"])
def test_imports_nothing_heavy(imported):
    code = f"import sys, {imported}; print([m for m in {HEAVY} if m in sys.modules])"
    assert python(code) == "[]"


def test_help_imports_nothing_heavy():
    code = f"import sys; from luxel.cli import main; main(['--help']); print([m for m in {HEAVY} if m in sys.modules])"
    assert python(code).splitlines()[-1] == "[]"


def test_all_that_is_offered_is_there():
    for name in luxel.__all__:
        assert getattr(luxel, name) is not None
    assert set(luxel.__all__) <= set(dir(luxel))
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        luxel.nothing  # noqa: B018


def test_every_public_name_is_documented():
    undocumented = [name for name in luxel.__all__ if not name.startswith("_") and not (getattr(luxel, name).__doc__ or "").strip()]
    assert undocumented == []


def test_versions_agree():
    from importlib.metadata import version

    assert version("luxel") == luxel.__version__


def test_typed():
    assert (Path(luxel.__file__).parent / "py.typed").exists()


def test_python_m_luxel():
    done = subprocess.run([sys.executable, "-m", "luxel", "--version"], check=True, capture_output=True, text=True)
    assert done.stdout == f"luxel {luxel.__version__}\n"


def test_numba_and_its_cuda_have_one_door_each():
    doors = {p.name for p in (ROOT / "src").rglob("*.py") if re.search(r"^\s*(import|from) numba\b", p.read_text(), re.MULTILINE)}
    assert doors == {"jit.py", "door.py"}


@pytest.mark.parametrize("page", PAGES)
def test_snippets_run(page, tmp_path, monkeypatch):
    """A page's Python blocks, one after the other as a reader would type them, then its command lines, in one folder."""
    monkeypatch.chdir(tmp_path)
    snippets = blocks(page, "python")
    assert snippets
    names: dict[str, object] = {}
    for i, snippet in enumerate(snippets):
        exec(compile(snippet, f"{page}, Python block {i + 1}", "exec"), names)
    lines = [line for block in blocks(page, "console") for line in block.replace("\\\n", " ").splitlines() if line.startswith("luxel ")]
    assert lines
    for line in lines:
        words = shlex.split(line, comments=True)
        assert main(words[1:]) == 0, line


def extras_named(text: str) -> set[str]:
    """Extras that a page or a source promises: "extra `mpi`", 'luxel[mpi]' or '.[exr,mpi]' quoted or after pip install, and those of errors."""
    lists = re.findall(r"""(?:['"`]|pip install (?:-\S+ )*)(?:luxel|\.)\[([\w, -]+)\]""", text)
    named = re.findall(r"\bextras? `(\w+)`", text) + re.findall(r"ExtraMissingError\(.*?, \"(\w+)\"", text)
    return set(named).union(*(re.split(r"\s*,\s*", names.strip()) for names in lists))


def test_extras_named_are_found():
    text = """the extra `a`; pip install 'luxel[b, c]'; pip install -e .[d]; `luxel[e]`; ExtraMissingError("x", "f", why)"""
    assert extras_named(text) == set("abcdef")
    assert extras_named("cut.luxel[front], self.luxel[i], raise ExtraMissingError") == set()


def test_pages_promise_no_extra_that_is_not_there():
    with (ROOT / "pyproject.toml").open("rb") as file:
        known = set(tomllib.load(file)["project"]["optional-dependencies"])
    for page in [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "src").rglob("*.py")]:
        assert extras_named(page.read_text(encoding="utf-8")) <= known, page


def test_pages_name_what_is_there():
    """Links between pages lead somewhere."""
    for page in [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")]:
        for target in re.findall(r"\]\((?!https?://|#)([^)#]+)", page.read_text(encoding="utf-8")):
            assert (page.parent / target).exists(), f"{page.name}: {target}"
