"""The study of mesh layouts: every part on small meshes, and the published figures beside ours, marked."""

import json

import numpy as np
import pytest

from luxel.scene.builtin import icosphere
from luxel.studies import layout
from luxel.studies.report import Report
from luxel.studies.study import HERE, Context

ORDERS = ["file", "tipsify"]


@pytest.fixture
def study(tmp_path):
    mesh = icosphere(subdivisions=3)
    model = layout.Model("small bunny", mesh.positions, mesh.triangles[np.random.default_rng(0).permutation(len(mesh.triangles))])
    context = Context(quick=True)
    return layout._Run(context, Report(tmp_path, layout.STUDY, True), [model], ORDERS)


def table(study, name):
    return json.loads((study.report.folder / f"{name}.json").read_text())


def test_the_worked_example_comes_out_as_printed(tmp_path):
    report = Report(tmp_path, layout.STUDY)
    layout._example(report)
    rows = json.loads((tmp_path / "example.json").read_text())
    for ours, theirs in zip(rows[::2], rows[1::2], strict=True):
        assert (ours["source"], theirs["source"]) == (HERE, layout.PAPER)
        for key in list(ours)[2:]:
            assert ours[key] == pytest.approx(theirs[key], abs=0.005)


def test_published_figures_are_marked_and_ours_stand_beside(study):
    layout._published(study)
    rows = [row for row in table(study, "published") if row["model"] == "bunny"]
    assert {row["source"] for row in rows} == {HERE, layout.SANDER}
    ours = next(row for row in rows if row["source"] == HERE)
    assert ours["order"] == "tipsify"
    assert 0.5 < ours["FIFO 32"] < ours["FIFO 12"] < 0.85
    text = (study.report.folder / "README.md").read_text()
    assert "| *bunny* | *Tipsify* | *Sander, Nehab, Barczak 2007, figure 9* | *0.697* |" in text


def test_every_order_is_better_than_a_random_file(study):
    layout._all_orders(study)
    means = {row["order"]: row["ACMR 12"] for row in table(study, "means")}
    assert means["tipsify"] < 0.85 < 2.5 < means["file"]
    assert len(table(study, "orders")) == len(ORDERS)


def test_larger_caches_miss_less(study):
    layout._sizes(study)
    (row,) = (row for row in table(study, "sizes") if row["order"] == "tipsify")
    assert row["FIFO 32"] < row["FIFO 16"] < row["FIFO 12"]
    assert (study.report.folder / "sizes.png").stat().st_size > 10_000


def test_overdraw_and_gpus_and_pictures(study):
    layout._overdraw(study)
    rows = table(study, "overdraw")
    assert [row["limit"] for row in rows] == ["not sorted", 1.0, 1.02, 1.05, 1.1, 1.2]
    assert all(row["ACMR 12"] <= limit * rows[0]["ACMR 12"] + 1e-9 for row, limit in zip(rows[1:], (1, 1.02, 1.05, 1.1, 1.2), strict=True))
    layout._gpus(study)
    rates = {row["order made for"]: row for row in table(study, "gpus")}
    assert rates["its own"]["ATVR intel"] < rates["file"]["ATVR intel"]
    layout._pictures(study)
    assert (study.report.folder / "order.png").exists()


def test_rates_say_what_drew(study, monkeypatch):
    monkeypatch.setattr("luxel.studies.gl.Renderer.__init__", lambda self: self.__dict__.update(name=None, missing="none was asked for"))
    layout._rates(study)
    rows = table(study, "rates")
    assert {row["order"] for row in rows} == set(ORDERS)
    assert all(row["luxel, M triangles/s"] > 0 for row in rows)
    text = (study.report.folder / "README.md").read_text()
    assert "OpenGL was left out: none was asked for." in text
    layout._growth(study)
    rows = table(study, "growth")
    assert [row["triangles"] for row in rows if row["source"] == HERE] == [3600, 14400, 57600]
    assert {row["order"] for row in rows if row["source"] != HERE} == {"Tipsify", "Hoppe 1999", "K-Cache-Reorder"}


def test_a_folder_of_models(tmp_path):
    import luxel

    luxel.save(icosphere(subdivisions=2), tmp_path / "ball.ply")
    (tmp_path / "broken.obj").write_text("v a b c\n")
    (tmp_path / "notes.txt").write_text("no model")
    with pytest.warns(luxel.LuxelWarning, match="broken.obj: left out"):
        names = [model.name for model in layout._models(Context(meshes=tmp_path))]
    assert names == ["torus", "icosphere", "bumpy sphere", "ball"]
