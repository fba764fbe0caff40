"""One-sided faces back to back in one place, as walls without thickness are exported: each is lit on its own side."""

import numpy as np
import pytest
from closed import box, face, matte

from luxel import Mesh, Scene
from luxel.radiosity.bake import bake

GREY, LAMP, SIZE = matte(0.6), matte(0.0, 10.0), (4, 3, 5)
TURN = np.array([[0.8, 0.36, -0.48], [0.0, 0.8, 0.6], [0.6, -0.48, 0.64]])  # a rotation: planes' numbers are rounded


def flipped(mesh, along_other):
    """Its other side, in the same place; `along_other`: cut along the other diagonal."""
    return Mesh(np.roll(mesh.positions, int(along_other), 0), mesh.triangles[:, ::-1].copy())


def turned(scene):
    for mesh in scene.meshes:
        mesh.positions = (mesh.positions @ TURN.T + (1.3, -0.7, 0.9)).astype(np.float32)
    return scene


def room():
    scene = box(GREY, high=SIZE)
    scene.add(face(1, 1, (1.5, 0, 1), (2.5, 2.95, 2)), LAMP)
    return scene


def arranged(scene, more, first):
    """A room with more meshes before its own, or behind them."""
    own, more = list(zip(scene.meshes, [GREY] * 6 + [LAMP], strict=True)), [(mesh, GREY) for mesh in more]
    result = Scene()
    for mesh, material in more + own if first else own + more:
        result.add(mesh, material)
    return result


def mean_of(baked, scene, mesh):
    """The mean irradiance of a mesh of a scene, W/m2."""
    start = np.cumsum([0] + [len(each.triangles) for each in scene.meshes])
    triangle, weight = baked.luxels.triangle, baked.luxels.area * baked.valid
    some = (triangle >= start[mesh]) & (triangle < start[mesh + 1])
    return np.average(baked.irradiance[some].mean(1), weights=weight[some])


def escaped(baked):
    step = baked.ledger[-1]
    return step.escaped.sum() / step.emitted.sum()


OPTIONS = {"density": 6, "tolerance": 1e-3}


@pytest.mark.parametrize("quality", ["draft", "progressive"])
def test_a_room_whose_walls_are_doubled_is_lit_as_one_whose_are_not(quality):
    scene = room()
    single = bake(scene, quality=quality, **OPTIONS)
    wanted = [mean_of(single, scene, k) for k in range(6)]
    for first, along_other, turn in ((False, False, False), (True, True, False), (False, True, True))[: 3 if quality == "draft" else 2]:
        doubled = arranged(room(), [flipped(mesh, along_other) for mesh in room().meshes[:6]], first)
        if turn:
            doubled = turned(doubled)
        baked = bake(doubled, quality=quality, **OPTIONS)
        assert escaped(baked) < 1e-3
        inner, outer = (6, 0) if first else (0, 7)
        np.testing.assert_allclose([mean_of(baked, doubled, inner + k) for k in range(6)], wanted, rtol=0.01)
        np.testing.assert_allclose([mean_of(baked, doubled, outer + k) for k in range(6)], 0, atol=1e-3 * min(wanted))
        assert baked.valid.mean() > 0.98


@pytest.mark.parametrize("turn", [False, True])
def test_a_doubled_partition_parts_light_from_shadow_as_one_with_a_gap_does(turn):
    near, far = [], []
    for gap, first, along_other in ((1e-3, False, False), (0.0, False, False), (0.0, True, True)):
        wall = face(2, 1, (0, 0, 0), (3, 3, 2.5))
        other = flipped(wall, along_other)
        other.positions[:, 2] += np.float32(gap)
        scene = arranged(room(), [wall, other], first)
        if turn:
            scene = turned(scene)
        baked = bake(scene, quality="draft", **OPTIONS)
        assert escaped(baked) < 2e-3
        at = 0 if first else 7
        near.append(mean_of(baked, scene, at))
        far.append(mean_of(baked, scene, at + 1))
    np.testing.assert_allclose(near, near[0], rtol=0.01)
    np.testing.assert_allclose(far, far[0], rtol=0.02)
    assert 0 < far[0] < 0.3 * near[0]
