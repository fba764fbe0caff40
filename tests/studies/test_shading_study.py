"""The study of parallel shading: its parts say what is true, its compiled loops draw the same picture, and its report holds the figures' data."""

import json

import numpy as np
import pytest

from luxel.raster.constants import NOTHING, SUBPIXEL
from luxel.studies import find
from luxel.studies.report import Report
from luxel.studies.shading import accuracy, balance, claims, cpu, kernels, speed
from luxel.studies.shading.coverage import ids_of
from luxel.studies.shading.fill import fill
from luxel.studies.shading.fixed import Format
from luxel.studies.shading.schemes import CLASSICAL, COUNTERED, INTERLEAVES, MIDLINES, SCHEMES, VARIANTS, WAVE
from luxel.studies.shading.shapes import SHAPES, corners_of, random_triangle, span
from luxel.studies.study import Context


def test_resources_are_the_papers():
    """One edge interpolator an edge; counter: a code and a line interpolator more; midlines: four line interpolators, one code, three adders."""
    assert CLASSICAL.resources(1) == (2, 1, 1, 0)
    assert COUNTERED.resources(2) == (2, 2, 2, 0)
    assert MIDLINES.resources(4) == (2, 4, 1, 3)
    assert [scheme.resources(scheme.lanes) for scheme in INTERLEAVES] == [(2, 1, n, int(n == 3)) for n in (2, 3, 4, 8, 16)]
    assert WAVE.resources(50) == (2, 0, 50, 1)
    assert CLASSICAL.resources(1).sums(3) == 2 * 4 + 1 + 3
    assert MIDLINES.resources(4).sums(1) == 2 * 2 + 4 + 1 + 3


@pytest.mark.parametrize("shape", SHAPES)
def test_random_triangles_have_their_area(shape):
    rng = np.random.default_rng(1)
    for area in (16, 300):
        pixels = [random_triangle(rng, area, shape).covered.pixels for _ in range(60)]
        assert np.mean(pixels) == pytest.approx(area, rel=0.15)
    for _ in range(20):
        corners = corners_of(rng, 100, "even")
        assert (corners % (2 * SUBPIXEL) == 0).all()


def test_speed_of_spans():
    """As the arithmetic says: n + s over n / p + log2 p + s."""
    for row in speed.span_rows([8, 256]):
        n, s = row["pixels"], 4 * (row["set-up"] != "nothing")
        assert row["counter, x"] == (n + s) / (n / 2 + s)
        assert row["interleaved 4, x"] == (n + s) / (n / 4 + 2 + s)
    assert span(37).covered.pixels == 37


def test_errors_of_long_spans_are_halved_by_exact_ends_only():
    (row,) = accuracy._halving(accuracy.by_length([256], 12, Format()))
    assert row["largest, span's slopes"] == pytest.approx(0.5, abs=0.03)
    assert row["RMS, span's slopes"] == pytest.approx(0.5, abs=0.03)
    assert row["largest, truncated"] == pytest.approx(0.5, abs=0.03)
    assert row["largest, plane's slopes"] == row["RMS, plane's slopes"] == 1
    assert row["seam / largest one-way error"] == pytest.approx(1, abs=0.05)


def test_more_fraction_bits_show_less():
    rows = {(row["format"], row["scheme"]): row for row in accuracy.attribute_rows("normals", 2, 500)}
    for scheme in accuracy.WAYS:
        wrong = [rows[str(form), scheme]["largest error of the level"] for form in accuracy.FORMATS]
        assert wrong == sorted(wrong, reverse=True)
        assert wrong[-1] < 0.5 < wrong[0]
    assert all(rows[str(form), "EC-DDA"]["largest error, ulp"] <= 1 for form in accuracy.FORMATS)


def test_light_depends_on_the_direction_only():
    normals = np.random.default_rng(3).normal(size=(3, 50))
    assert accuracy.level(normals) == pytest.approx(accuracy.level(3.7 * normals))
    brightest = np.argmax(accuracy.level(normals))
    assert accuracy._TO_LIGHT @ normals[:, brightest] > 0
    copies = accuracy.phong_copies(10, 400)
    assert copies["normals"] < 1e-12
    assert copies["lit, levels, largest"] > copies["lit, levels, mean"] > 1


@pytest.mark.parametrize("kind", balance.KINDS)
def test_a_triangulation_covers_the_hexagon_once(kind):
    """The same pixels at every size; each is written once; steps are those of `fill`."""
    whole = ids_of(balance.triangulated("regular", 60, 1), 120, 120) != NOTHING
    for parts in (1, 4, 9):
        corners = balance.triangulated(kind, 60, parts)
        assert len(corners) == pytest.approx(6 * parts * parts, rel=0.01)
        work = balance.work_of(corners, 120)
        assert np.array_equal(work.writes, whole)
        assert work.pixels.sum() == whole.sum()
        assert (work.steps >= balance.TRIANGLE_SETUP + work.pixels).all()
        assert (work.steps <= balance.TRIANGLE_SETUP + 5 * work.pixels).all()


def test_units_share_the_work():
    steps = np.array([5, 3, 3, 1, 8, 2])
    assert balance.makespan(steps, 1) == steps.sum()
    assert balance.makespan(steps, 6) == 8
    assert balance.makespan(steps, 2) == 14  # 5, 1, 8 and 3, 3, 2: who is free takes the next, whatever comes later


def test_size_that_balances():
    """Many units want smaller triangles than few; and a unit is best served by the largest."""
    rows = balance.sweep("regular", 64, [1, 2, 4, 8, 16], 1, (CLASSICAL,))
    sizes = {row["units"]: row for row in balance.best_rows([row | {"triangulation": kind} for kind in balance.KINDS for row in rows])
             if row["triangulation"] == "regular"}  # fmt: skip
    assert sizes[1]["pixels a triangle"] > sizes[8]["pixels a triangle"] > sizes[64]["pixels a triangle"]
    assert sizes[1]["idle, %"] == 0
    assert all(row["from"] <= row["pixels a triangle"] <= row["to"] for row in sizes.values())
    for row in rows:
        share = row["idle, %"] + row["set-up, %"] + 100 * row["pixels a step"] / row["units"]
        assert share == pytest.approx(100)


def test_compiled_loops_draw_the_same_picture():
    """Bit for bit where sums are the same; a level off where they are rounded otherwise."""
    work = cpu.workload(32)
    assert work.pixels == cpu.WIDTH * cpu.HEIGHT
    pictures = {}
    for name, job in cpu.jobs(work, picture := np.zeros(work.pixels + kernels.SPARE, np.int32), False).items():
        if name not in cpu.LUXEL:
            picture[:] = 0
            job()
            assert not picture[-kernels.SPARE :].any(), name
            pictures[name] = picture[: -kernels.SPARE].copy().view(np.uint8).reshape(-1, 4).astype(int)
    right = pictures["classical"]
    assert (right[:, 3] == 255).all()
    assert len(np.unique(right[:, :3])) > 200
    for name, drawn in pictures.items():
        apart = np.abs(drawn - right).max()
        assert apart <= (name.startswith("midlines") or name == "wave"), name
    exact = _exact(work)
    assert np.abs(right[:, :3] - exact).max() < 1.01


def test_luxels_picture_of_the_workload_is_the_same():
    """Which triangle covers each pixel, and colours that are encoded as sRGB."""
    work = cpu.workload(128)
    shown = cpu.picture_of(work)()
    assert np.array_equal(shown.color[..., 3], np.full((cpu.HEIGHT, cpu.WIDTH), 255))
    linear = _exact(work).reshape(cpu.HEIGHT, cpu.WIDTH, 3) / 255
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055) * 255
    assert np.abs(shown.color[..., :3] - encoded).max() <= 1


def _exact(work):
    """Colours by barycentric coordinates."""
    ids = ids_of(work.corners, cpu.WIDTH, cpu.HEIGHT).ravel()
    y, x = np.divmod(np.arange(len(ids)), cpu.WIDTH)
    a, b, c = (work.corners[ids, k] / SUBPIXEL for k in range(3))
    p = np.stack([x, y], 1) + 0.5
    area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    v = ((p - a)[:, 0] * (c - a)[:, 1] - (p - a)[:, 1] * (c - a)[:, 0]) / area
    w = ((b - a)[:, 0] * (p - a)[:, 1] - (b - a)[:, 1] * (p - a)[:, 0]) / area
    return (1 - v - w)[:, None] * work.colors[ids, 0] + v[:, None] * work.colors[ids, 1] + w[:, None] * work.colors[ids, 2]


def test_verdicts_follow_what_was_measured():
    rows = [{"pixels": n, "x": x} for n, x in ((1, 1.0), (2, 2.0), (4, 1.8), (8, 1.95), (16, 2.0))]
    assert claims.first_that_reaches(rows, "x", 2) == 8
    assert claims.first_that_reaches(rows[:3], "x", 2) is None
    assert [claims._verdict(*pair) for pair in ((True, True), (False, True), (False, False))] == ["holds", "in part", "does not hold"]


def test_what_pays_is_said():
    rows = [{"way": way, "pixels a span": n, "ns a pixel": 1 / s, "speed-up": s}
            for way, speeds in (("classical", (1, 1)), ("a", (1, 4)), ("b", (2, 3)), ("c", (1, 1.05)), (cpu.LUXEL[0], (2, 2)))
            for n, s in zip((4, 64), speeds, strict=True)]  # fmt: skip
    assert {row["way"]: row["pays"] for row in cpu.verdicts(rows)} == {
        "classical": "", "a": "from 64 pixels", "b": "always", "c": "no", cpu.LUXEL[0]: ""}  # fmt: skip


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    """The quick study, once."""
    folder, done, study = tmp_path_factory.mktemp("shading"), [], find("shading")
    report = Report(folder, study, quick=True)
    study.run(Context(quick=True, threads=2, progress=done.append), report)
    assert done[-1] == 1
    return folder, json.loads((folder / "results.json").read_text())["tables"]


def test_the_report_is_whole(quick):
    folder, tables = quick
    assert set(tables) == {"spans", "areas", "utilisation", "idle", "help", "setup", "resources", "errors", "halving", "attributes", "balance",
                           "balance-four", "balance-all", "cpu", "claims"}  # fmt: skip
    text = (folder / "README.md").read_text()
    pictures = {"spans", "area-speed-up", "area-utilisation", "cost", "errors-largest", "errors-rms", "order", "rows", "wave", "thin", "midlines",
                "seam", "phong", "balance-regular", "balance-delaunay", "balance-random", "cpu"}  # fmt: skip
    assert {path.stem for path in folder.glob("*.png")} == pictures
    for name in pictures:
        assert (folder / f"{name}.png").stat().st_size > 5000
        assert f"({name}.png)" in text
    assert "nan" not in text.lower().replace("nanosecond", "")


def test_figures_of_speed(quick):
    _, tables = quick
    names = [scheme.name for scheme in (*SCHEMES, *VARIANTS)]
    for table in ("areas", "utilisation", "idle"):
        assert {row["shape"] for row in tables[table]} == set(SHAPES)
        assert all(set(names) < set(row) for row in tables[table])
    any_shape = [row for row in tables["areas"] if row["shape"] == "any"]
    for name in ("counter", "interleaved 4", "midlines", "wave"):
        ratios = [row[name] for row in any_shape]
        assert ratios == sorted(ratios)
        assert ratios[-1] > 1.5
    assert all(row["classical"] == row["EC-DDA"] == 1 for row in tables["areas"])
    assert all(0 < row[name] <= 1 for row in tables["utilisation"] for name in names)
    helped = {(row["shape"], row["area"]): row for row in tables["help"]}
    assert set(helped) == {(row["shape"], row["area"]) for row in tables["areas"]}
    assert helped["thin", 1024]["one seed, missed"] > 0.3 > helped["any", 1024]["one seed, missed"]
    assert helped["thin", 1024]["no border, seeds"] > 10
    assert 0 < helped["even", 1024]["midlines, left"] < helped["any", 1024]["midlines, left"] < 0.1
    assert {row["scheme"] for row in tables["resources"]} == set(names)


def test_figures_of_errors_and_claims(quick):
    _, tables = quick
    longest = tables["errors"][-1]
    assert longest["counter, largest"] < 0.6 * longest["classical, largest"]
    assert longest["EC-DDA, largest"] <= 1
    assert longest["classical, largest"] == longest["interleaved 4, largest"]
    verdicts = {row["claim"]: row["verdict"] for row in tables["claims"]}
    assert verdicts["counter: half the error"] == "in part"
    assert verdicts["wave: steps are the largest distance from the seed"] == "holds"
    assert verdicts["midlines: copies differ by a constant"] == "in part"
    assert len(verdicts) == 13
    assert all(len(row["measured"]) > 20 for row in tables["claims"])
    assert {row["way"] for row in tables["cpu"]} > {"classical", "wave", cpu.LUXEL[0]}
    assert {(row["triangulation"], row["units"]) for row in tables["balance"]} == {(k, n) for k in balance.KINDS for n in balance.UNITS}


def test_schemes_fill_what_is_shown():
    from luxel.studies.shading import pictures

    what = pictures.shown_triangle()
    for scheme in pictures.SHOWN:
        assert np.array_equal(fill(what, scheme).writes, what.covered.mask)
    sheet, places = pictures.panels([np.ones((3, 4)), np.zeros((5, 2))], 2, 1)
    assert sheet.shape == (6, 10)
    assert places == [(0, 0), (5, 0)]
    assert np.nansum(sheet) == 12


def test_the_order_in_a_row():
    from luxel.studies.shading import pictures

    what = span(8)
    times = {scheme.name: pictures.within_row(fill(what, scheme))[0, :8] for scheme in pictures.IN_ROWS}
    assert np.allclose(times["classical"], np.arange(8) / 7)
    assert np.allclose(times["counter"], np.array([0, 1, 2, 3, 3, 2, 1, 0]) / 3)
    assert np.allclose(times["interleaved 2"], np.arange(8) // 2 / 3)
    assert np.allclose(times["interleaved 4"], np.arange(8) // 4)
