"""The anti-aliasing study: its ways draw the same frame, its counters count what the arithmetic says, and its report has every part."""

import json

import numpy as np
import pytest

import luxel
from luxel.scene.builtin.paper import two_triangles
from luxel.studies import find
from luxel.studies.antialiasing import PAPER, fourier, quality, schedule, traffic
from luxel.studies.report import Report
from luxel.studies.study import HERE, Context


@pytest.fixture(params=[1, 2, 3])
def team(request):
    team = schedule.Team(request.param)
    yield team
    team.close()


def test_every_way_draws_the_same_frame(team):
    for which in ("large", "small", "both"):
        screen = schedule.scene(97, which)
        kept = schedule.Buffers.of(screen, 97)
        frames = [schedule.draw(screen, 97, way, team, buffers) for way in schedule.WAYS for buffers in (None, kept)]
        for frame, seconds, idle in frames:
            assert np.array_equal(frame.color, frames[0][0].color)
            assert np.array_equal(frame.depth, frames[0][0].depth)
            assert seconds > 0
            assert len(idle) == team.threads
            assert min(idle) >= 0
        assert frames[0][0].color.any()


def test_the_papers_formula_is_right_inside_and_black_outside():
    """Where all four samples see one triangle it is luxel's own picture; where one sees nothing, or another triangle, it is darker or as dark."""
    team = schedule.Team(1)
    frame, _, _ = schedule.draw(schedule.scene(200), 200, "dynamic by row", team)
    team.close()
    own = luxel.render(two_triangles(), size=(200, 200), samples=4, pattern="grid", background=(0, 0, 0)).color[..., :3]
    _, true, darker = schedule.darkened(200, (0, 0, 0))
    flat = [np.all(true == color, -1) for color in ((217, 238, 185), (185, 217, 238), (0, 0, 0))]
    for mask in flat:
        assert np.array_equal(frame.color[mask], own[mask])
        assert mask.sum() > 1000
    assert darker.sum() > 10
    assert not darker[np.any(flat, 0)].any()
    assert (frame.color.astype(int) <= true.astype(int) + 1)[~np.any(flat, 0)].mean() > 0.99


def test_darkening_on_white():
    theirs, true, darker = schedule.darkened(100, (255, 255, 255))
    edge = ~np.any([np.all(true == color, -1) for color in ((217, 238, 185), (185, 217, 238), (255, 255, 255))], 0)
    assert darker.sum() > 0.9 * edge.sum() > 50
    assert theirs.shape == true.shape == (100, 100, 3)


@pytest.mark.parametrize("samples", [1, 4, 8])
def test_traffic_adds_up(samples):
    pixels = 64 * 64
    for overdraw in (1, 2, 5):
        pictures, counts = zip(*(traffic.count(way, 64, samples, overdraw) for way in traffic.WAYS))
        immediate, tiled, deferred = counts
        assert np.array_equal(pictures[0], pictures[1])
        assert np.array_equal(pictures[0], pictures[2])
        assert immediate.depth_read == 4 * samples * overdraw * pixels  # every layer covers every sample
        assert immediate.depth_written == immediate.color_written - 4 * pixels * (samples > 1)  # cleared, then both when the test passes
        assert immediate.color_read == 4 * samples * pixels * (samples > 1)
        assert immediate.on_chip == 0
        for tiles in (tiled, deferred):
            assert tiles.external == tiles.color_written == 4 * pixels
        assert tiled.on_chip == immediate.external - 4 * pixels * (samples > 1) + 4 * samples * pixels * (samples == 1)
        assert tiled.shaded == immediate.shaded >= deferred.shaded
    assert traffic.count("tiled, deferred", 64, 1, 8)[1].shaded == pixels
    assert traffic.count("immediate", 64, samples, 1)[1].depth_written == 2 * 4 * samples * pixels


def test_expected_overdraw():
    """Of k shuffled layers, 1 + 1/2 + ... + 1/k pass the depth test."""
    counted = traffic.count("immediate", 256, 1, 8)[1].shaded / 256**2
    assert counted == pytest.approx(sum(1 / k for k in range(1, 9)), rel=0.05)


def test_round_trip_and_timing():
    row = fourier.round_trip(16, np.float64)
    assert row["within 1e-2"] == "yes"
    assert row["largest error"] < 1e-12
    calls = []
    assert fourier.timed(lambda: calls.append(1), 0.01) > 0
    assert len(calls) > 100


def test_scenes_and_modes():
    names = [mode.name for mode in quality.modes()]
    assert len(names) == len(set(names))
    for name, (scene, camera) in quality.scenes(Context(quick=True), 64).items():
        prepared = luxel.prepare(scene)
        right = quality.reference(prepared, camera, 64)
        errors = [np.sqrt(np.mean((quality._drawn(**o)(prepared, camera, 64) - right) ** 2)) for o in ({}, {"samples": 4}, {"ssaa": 4})]
        assert errors[0] > errors[1] > errors[2] > 0, name
    scene, camera = quality.zone_plate_scene(rings=6, segments=90)
    drawn = luxel.render(scene, camera, (100, 100), outputs="object").object >= 0
    assert drawn.mean() == pytest.approx(np.pi / 2 / 2.02**2, rel=0.03)  # half of the disc


def test_the_whole_study(tmp_path, monkeypatch):
    monkeypatch.setattr(fourier, "launcher", lambda: None)  # ranks are tested elsewhere
    done = []
    study = find("antialiasing")
    report = Report(tmp_path, study, quick=True)
    study.run(Context(quick=True, threads=2, progress=done.append), report)
    assert done[-1] == 1
    text = (tmp_path / "README.md").read_text()
    tables = json.loads((tmp_path / "results.json").read_text())["tables"]
    assert set(tables) == {"schedule", "idle", "darkened", "traffic", "fourier", "round_trip", "quality"}
    for table in ("schedule", "fourier"):
        assert {row["source"] for row in tables[table]} == {HERE, PAPER}
    for path in ("schedule.png", "darkened.png", "traffic.png", "fourier.png", "quality.png", "tradeoff.png"):
        assert (tmp_path / path).stat().st_size > 1000
        assert path in text
    assert "MPI is not installed here" in text
    assert len({row["scene"] for row in tables["quality"]}) == 4
    assert all(row["within 1e-2"] == "yes" for row in tables["round_trip"])
