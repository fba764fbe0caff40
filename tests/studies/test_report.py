"""The frame of the studies: what a report writes, that it keeps what it has, and that every study names its sources."""

import csv
import json
import sys

import numpy as np
import pytest

from luxel.errors import ExtraMissingError, FileError
from luxel.io.images import read_image
from luxel.studies import NAMES, find
from luxel.studies.report import Report, markdown_table, published
from luxel.studies.study import HERE, Context, Study

ROWS = [
    {"model": "a | b", "source": HERE, "ACMR": np.float64(0.61), "triangles": 1234567},
    {"model": "a | b", "source": "Lin & Yu 2006", "ACMR": 0.628, "rate": float("nan")},
]
PROBE = Study("probe", "A probe", "Nobody: Nothing, 1999", lambda context, report: None)


@pytest.fixture
def report(tmp_path):
    return Report(tmp_path / "out" / "folder", PROBE)


def test_tables_come_in_three_forms(report):
    report.table("acmr", "ACMR", ROWS, "At 12.")
    text = (report.folder / "README.md").read_text()
    assert text.startswith("# A probe\n\nAfter Nobody: Nothing, 1999.")
    assert "| a \\| b | here | 0.61 | 1,234,567 |  |" in text
    assert "| *a \\| b* | *Lin & Yu 2006* | *0.628* |  |  |" in text
    assert "## ACMR\n\nAt 12.\n\n|" in text
    stored = json.loads((report.folder / "acmr.json").read_text())
    assert stored[0] == {"model": "a | b", "source": "here", "ACMR": 0.61, "triangles": 1234567, "rate": None}
    with (report.folder / "acmr.csv").open(newline="") as file:
        read = list(csv.DictReader(file))
    assert [row["ACMR"] for row in read] == ["0.61", "0.628"]
    assert json.loads((report.folder / "results.json").read_text())["tables"]["acmr"] == stored


def test_figures_and_pictures(report):
    with report.figure("curve", "A curve") as axes:
        axes.plot([1, 2], [3, 4], label="ours")
        published(axes, [1, 2], [4, 5], "Somebody 2001")
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert labels == ["ours", "Somebody 2001 (published)"]
    image = np.zeros((4, 6, 3), np.uint8)
    image[1, 2] = 200, 100, 50
    report.picture("dots", "Dots", image)
    assert (read_image(report.folder / "dots.png")[..., :3] == image).all()
    assert read_image(report.folder / "curve.png").shape[1] == 1050
    assert "![Dots](dots.png)" in (report.folder / "README.md").read_text()
    assert {path.name for path in report.files} == {"curve.png", "dots.png", "README.md", "results.json"}


def test_a_figure_that_fails_leaves_what_was_there(report):
    report.say("Before.")
    before = sorted(path.name for path in report.folder.iterdir())

    def fail():
        with report.figure("curve", "A curve"):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail()
    assert sorted(path.name for path in report.folder.iterdir()) == before
    assert "Before." in (report.folder / "README.md").read_text()


def test_a_quick_run_is_marked(tmp_path):
    report = Report(tmp_path, PROBE, quick=True)
    report.say("x")
    assert "A quick run" in (tmp_path / "README.md").read_text()


def test_numbers_stand_to_the_right():
    lines = markdown_table(["name", "n"], [{"name": "a", "n": 1}, {"name": "b", "n": None}]).splitlines()
    assert lines == ["| name | n |", "| --- | ---: |", "| a | 1 |", "| b |  |"]


def test_a_folder_that_cannot_be_made(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(FileError, match="cannot make this folder"):
        Report(tmp_path / "file" / "folder", PROBE)


def test_without_matplotlib_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(ExtraMissingError, match=r"luxel\[study\]"):
        Report(tmp_path / "folder", PROBE)
    assert not (tmp_path / "folder").exists()


@pytest.mark.parametrize("name", NAMES)
def test_every_study_is_named_and_cited(name):
    study = find(name)
    assert study.name == name
    assert study.title
    assert study.paper
    assert isinstance(Context().threads, int)
