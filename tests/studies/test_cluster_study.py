"""The model of ranks: its bytes are those that are packed, its cuts those of composition, and its report holds the figures' data."""

import json

import numpy as np
import pytest

from luxel.cluster.composite import COMPOSITIONS, pack, radices, regions
from luxel.errors import InputError
from luxel.studies import find
from luxel.studies.cluster import calibrate, tables
from luxel.studies.cluster.facts import TILE, facts_of
from luxel.studies.cluster.messages import owners, parts, rounds
from luxel.studies.cluster.model import DIVISIONS, Costs, Memory, Network, alone, frame
from luxel.studies.report import Report
from luxel.studies.study import Context

PRICES = Costs(7e-4, 1e-8, 1.3e-7, 1.7e-8, 1e-6, 1e-10, 4e-9, 3e-8, 2e-10, 8e-8, 7e-6, 6e-6)
MEMORY = Memory(180e6, 160.0, 4.0)
NETWORK = Network("fast", 1.5e-6, 22e9)


@pytest.fixture(scope="module")
def facts():
    return facts_of("even", 40, (320, 180))


@pytest.mark.parametrize("composition", COMPOSITIONS)
@pytest.mark.parametrize("ranks", [1, 2, 4, 6, 8, 12, 64])
def test_tiles_are_cut_as_composition_cuts_them(ranks, composition):
    slots, steps = np.arange(37), radices(ranks, composition)
    shares, digits = regions(slots, ranks, composition), parts(slots, steps)
    stride = np.cumprod([1, *steps])[:-1]
    for rank in range(int(np.prod(steps))):
        mine = (digits == rank // stride % np.array(steps)).all(1) if steps else np.ones(37, bool)
        assert np.array_equal(slots[mine], shares[rank])


@pytest.mark.parametrize("ranks", [2, 3, 4])
def test_bytes_are_those_that_are_packed(facts, ranks):
    """Of the first round: later ones send what has been merged, which is counted in the same way."""
    tiles, owner = facts.tiles, owners(facts, ranks)
    for composition in ("direct", "radix") + ("swap",) * (ranks != 3):
        k = radices(ranks, composition)[0]
        ids = np.full((ranks, tiles, TILE * TILE), -1, np.int32)
        ids[owner, facts.slot, facts.place] = 1
        slots = np.unique(facts.slot)
        sent = []
        for rank in range(ranks):
            given = [part for j, part in enumerate(np.array_split(slots, k)) if j != rank % k]
            sent.append(sum(pack(part, TILE * TILE, ids[rank], np.zeros(ids[rank].shape, np.float32)).nbytes for part in given))
        assert rounds(facts, ranks, composition)[0].sent.tolist() == sent, composition


def test_every_pixel_that_is_not_at_home_is_sent_once(facts):
    for ranks in (5, 16, 1000):
        for composition in COMPOSITIONS:
            for step in rounds(facts, ranks, composition):
                assert step.sent.sum() == step.got.sum()
        (direct,) = rounds(facts, ranks, "direct")
        assert 8 * len(facts.owner) * (1 - 1 / ranks) * 0.5 < direct.sent.sum() < 8 * len(facts.owner) * 3


def test_one_rank_is_one_process_and_balance_helps(facts):
    one = alone(facts, PRICES)
    assert frame(facts, "screen", 1, PRICES, MEMORY, NETWORK).seconds == pytest.approx(one)
    assert frame(facts, "objects", 1, PRICES, MEMORY, NETWORK).seconds == pytest.approx(one + 3e-8 * len(facts.owner))
    corner = facts_of("corner", 40, (320, 180))
    for ranks in (2, 4):
        static, dynamic = (frame(corner, way, ranks, PRICES, MEMORY, NETWORK).draw for way in ("screen, static", "screen"))
        assert dynamic < 0.95 * static
    huge = facts._replace(weight=1e5)
    held = {way: frame(huge, way, 64, PRICES, MEMORY, NETWORK).memory - 180e6 for way in DIVISIONS}
    assert held["objects"] < held["both"] / 7 < held["screen"] / 40
    crowded = frame(facts, "objects", 4, PRICES, MEMORY, NETWORK, cores=2)
    assert crowded.draw > 1.5 * frame(facts, "objects", 4, PRICES, MEMORY, NETWORK).draw


def test_what_is_simulated_is_marked_and_drawn(tmp_path, facts):
    report = Report(tmp_path, find("cluster"), True)
    rows = tables.beyond(Context(True), report, facts, PRICES, MEMORY)
    assert {row["ranks"] for row in rows} == {1, 8, 64, 512, 4096, 10_000}
    assert all(row["source"] == "simulated" for row in rows)
    assert all(0 < row["efficiency"] <= 1.0001 for row in rows)
    assert all(row["ms"] == pytest.approx(row["draw, ms"] + row["compose, ms"] + row["glue, ms"] + row["agree, ms"]) for row in rows)
    written = json.loads((tmp_path / "simulated.json").read_text())
    assert [row["ms"] for row in written] == [row["ms"] for row in rows]
    slow = [a["ms"] <= b["ms"] for a, b in zip(rows, rows[len(rows) // 4 :], strict=False) if a["scene"] == b["scene"]]
    assert all(slow)  # Ethernet after InfiniBand
    for row in tables.wins(rows):
        some = [r["ms"] for r in rows if (r["scene"], r["network"], r["ranks"]) == (row["scene"], row["network"], row["ranks"])]
        assert row["ms"] == min(some)
    composed = json.loads((tmp_path / "composition.json").read_text())
    assert all(row["sent, MB a rank"] <= row["N b (1 - 1/P), MB"] for row in composed)
    assert {path.suffix for path in tmp_path.iterdir()} == {".md", ".png", ".json", ".csv"}
    assert "Nothing below was measured" in (tmp_path / "README.md").read_text()


def test_measured_and_simulated_stand_apart(tmp_path, monkeypatch, facts):
    """With frames as a launcher would have measured them."""
    report = Report(tmp_path, find("cluster"), True)
    measured = [{"name": "even", "division": way, "composition": "radix", "ranks": ranks, "seconds": 0.01, "composed": 1e5, "peak": 2e8, "step": 1e-5}
                for ranks in (1, 2, 4) for way in DIVISIONS]  # fmt: skip
    rows = tables.check(report, {"even": facts}, measured, PRICES, MEMORY, NETWORK)
    assert len(rows) == 12
    assert all(row["model / measured"] == pytest.approx(row["model, ms"] / 10) for row in rows)
    assert {row["sent, MB a rank"] for row in rows if row["division"] == "screen"} == {None}
    monkeypatch.setenv("PMI_RANK", "0")
    with pytest.raises(InputError, match="run it without"):
        find("cluster").run(Context(True), report)


def test_ranks_that_fail_say_why(tmp_path):
    launcher = calibrate.mpiexec()
    if launcher is None:
        pytest.skip("no mpiexec or mpi4py: pip install 'luxel[mpi]'")
    found = calibrate.run_ranks(launcher, 2, [calibrate.case("even", "even", 10, (64, 48), [("objects", "radix"), ("screen", "swap")], 2, tmp_path)])
    assert [(row["division"], row["ranks"]) for row in found["rows"]] == [("objects", 2), ("screen", 2)]
    assert found["rows"][0]["composed"] > 0
    assert min(found["latency"], found["bandwidth"], found["step"], found["byte"]) > 0
    with pytest.raises(InputError, match=r"nothing\.ply"):
        calibrate.run_ranks(launcher, 2, [{**calibrate.case("even", "even", 10, (64, 48), [("screen", "swap")], 2, tmp_path), "file": "nothing.ply"}])
