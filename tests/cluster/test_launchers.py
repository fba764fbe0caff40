"""What launchers tell the processes they start."""

import pytest

from luxel.cluster import launchers


@pytest.fixture(autouse=True)
def alone(monkeypatch):
    for name in (*launchers._RANKS, *launchers._SIZES):
        monkeypatch.delenv(name, raising=False)


def test_a_process_nobody_launched():
    assert (launchers.launched(), launchers.started(), launchers.follows()) == (False, 1, False)


@pytest.mark.parametrize("name", launchers._RANKS)
def test_a_rank_tells_of_a_launcher(monkeypatch, name):
    monkeypatch.setenv(name, "0")
    assert (launchers.launched(), launchers.follows()) == (True, False)
    monkeypatch.setenv(name, "3")
    assert (launchers.launched(), launchers.follows()) == (True, True)


@pytest.mark.parametrize("name", launchers._SIZES)
@pytest.mark.parametrize(("value", "count"), [("1", 1), ("4", 4), ("x", 1)])
def test_a_size_tells_of_a_launcher_if_there_are_several(monkeypatch, name, value, count):
    monkeypatch.setenv(name, value)
    assert (launchers.launched(), launchers.started()) == (count > 1, count)
