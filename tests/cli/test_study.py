"""`luxel study`, from the command line."""

import json

import pytest

from luxel.cli import main
from luxel.studies import NAMES, study


@pytest.fixture
def probe(monkeypatch):
    """A study that takes no time, in the place of the first one."""
    seen = []

    def run(context, report):
        seen.append(context)
        context.progress(0.5)
        report.table("t", "T", [{"a": 1}])

    made = study.Study(NAMES[0], "Probe", "Nobody, 1999", run)
    monkeypatch.setattr("luxel.studies.find", lambda name: made)
    return seen


def error_of(capsys, *words):
    code = main([str(word) for word in words])
    out, err = capsys.readouterr()
    assert (code, out) == (2, "")
    assert err.startswith("luxel: error: ")
    assert err.count("\n") == 1
    return err


def test_the_list(capsys):
    assert main(["study", "--list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[::2]] == list(NAMES)
    assert main(["study", "--list", "--json"]) == 0
    assert [each["name"] for each in json.loads(capsys.readouterr().out)["studies"]] == list(NAMES)


def test_a_study_gets_its_options_and_says_what_it_wrote(capsys, tmp_path, probe):
    out = tmp_path / "folder"
    words = ["study", NAMES[0], "-o", str(out), "--quick", "--threads", "3", "--meshes", str(tmp_path), "--json"]
    assert main(words) == 0
    data = json.loads(capsys.readouterr().out)
    assert {path.rsplit("/", 1)[-1] for path in data["output"]} == {"t.csv", "t.json", "README.md", "results.json"}
    (context,) = probe
    assert (context.quick, context.threads, context.meshes) == (True, 3, tmp_path)


def test_the_folder_has_a_name_of_its_own(capsys, tmp_path, probe, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["study", NAMES[0]]) == 0
    assert capsys.readouterr().out.startswith(f"study-{NAMES[0]}/README.md")
    assert (tmp_path / f"study-{NAMES[0]}" / "README.md").exists()


def test_mistakes_are_named(capsys, tmp_path):
    assert "--list" in error_of(capsys, "study")
    assert "did you mean layout" in error_of(capsys, "study", "layuot")
    assert "--threads" in error_of(capsys, "study", "layout", "--threads", "0")
    assert "no such folder" in error_of(capsys, "study", "layout", "--meshes", tmp_path / "nowhere")
