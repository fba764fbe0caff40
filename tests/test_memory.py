"""Arrays whose memory is used again."""

import gc
import pickle
import sys
import threading

import numpy as np
import pytest

from luxel import memory
from luxel.memory import LARGE, reusable


@pytest.fixture(autouse=True)
def nothing_idle():
    memory._idle.clear()


def address(array):
    return array.__array_interface__["data"][0]


@pytest.mark.parametrize(("shape", "dtype"), [((700, 700), np.float32), ((1 << 20,), np.uint8), ((3, 5, 1 << 16), np.int16)])
def test_it_is_an_array_like_any_other(shape, dtype):
    array = reusable(shape, dtype)
    assert array.shape == shape
    assert array.dtype == dtype
    assert array.flags.c_contiguous
    assert array.flags.writeable
    assert address(array) % 64 == 0
    array[...] = 7
    assert (array == 7).all()


def test_memory_comes_back_when_the_last_view_goes():
    array = reusable((LARGE,), np.float32)
    where, view = address(array), array[5:10].view(np.int32)
    del array
    assert address(reusable((LARGE,), np.float32)) != where
    del view
    gc.collect()
    assert where in {address(again) for again in [reusable((LARGE,), np.float32), reusable((LARGE,), np.float32)]}


def test_no_memory_is_in_two_hands():
    held = [reusable((LARGE + 100 * k,), np.float32) for k in range(8)]
    del held[::2]
    held += [reusable((LARGE + 50 * k,), np.float32) for k in range(8)]
    for number, array in enumerate(held):
        array[:] = number
    assert all((array == number).all() for number, array in enumerate(held))


def test_small_arrays_and_much_larger_memory_are_left_alone():
    assert reusable((4,), np.float32).base is None
    big = address(reusable((16 * LARGE,), np.uint8))
    assert address(reusable((LARGE,), np.uint8)) != big


def test_what_is_kept_is_bounded(monkeypatch):
    monkeypatch.setattr(memory._Lease.__del__, "__defaults__", (memory._idle, 3 * LARGE))
    held = [reusable((LARGE,), np.uint8) for _ in range(9)]
    del held
    assert 0 < sum(map(len, memory._idle)) <= 3 * LARGE


def test_threads_share_it():
    wrong = []

    def work(number):
        for _ in range(200):
            array = reusable((LARGE,), np.uint8)
            array[:] = number
            if not (array == number).all():
                wrong.append(number)

    threads = [threading.Thread(target=work, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


def test_collecting_garbage_meanwhile_is_no_error(monkeypatch):
    """Arrays in cycles come back while the pool is counted."""
    errors = []
    monkeypatch.setattr(sys, "unraisablehook", errors.append)
    before = gc.get_threshold()
    gc.set_threshold(20, 2, 2)
    try:
        for _ in range(3000):
            cycle = [reusable((LARGE + 64,), np.uint8)]
            cycle.append(cycle)
            del cycle
    finally:
        gc.set_threshold(*before)
    assert not errors


def test_a_child_and_a_copy_have_their_own():
    array = reusable((LARGE,), np.uint8)
    array[:] = 3
    copy = pickle.loads(pickle.dumps(array))
    view = memoryview(array)
    del array
    gc.collect()
    reusable((LARGE,), np.uint8)[:] = 9
    assert (copy == 3).all()
    assert bytes(view[:10]) == bytes([3] * 10)


def test_what_is_free_is_the_least_of_machine_and_container(tmp_path, monkeypatch):
    (tmp_path / "meminfo").write_text("MemTotal: 9000 kB\nMemAvailable: 4000 kB\n")
    group = [tmp_path / name for name in ("max", "current", "stat")]
    monkeypatch.setattr(memory, "_MEMINFO", tmp_path / "meminfo")
    monkeypatch.setattr(memory, "_GROUPS", ((*group, "inactive_file"),))
    assert memory.free_bytes() == 4000 << 10
    for path, text in zip(group, ("3000000\n", "1000000\n", "anon 5\ninactive_file 250000\n"), strict=True):
        path.write_text(text)
    assert memory.free_bytes() == 2_250_000
    group[0].write_text("max\n")
    assert memory.free_bytes() == 4000 << 10
    (tmp_path / "meminfo").unlink()
    assert memory.free_bytes() is None
