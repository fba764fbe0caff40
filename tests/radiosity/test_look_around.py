"""What elements see, and the light that comes to them through it."""

import numpy as np
import pytest
from closed import box, matte

from luxel import Light, Mesh, Scene, jit
from luxel.radiosity import packet
from luxel.radiosity import prepare as module
from luxel.radiosity.bake import bake
from luxel.radiosity.closer import gather_closer
from luxel.radiosity.directions import _on_hemisphere, cosine_directions
from luxel.radiosity.element import FREE, SAMPLES
from luxel.radiosity.gather import LOST, NOWHERE, Sight, _sample_of, exchange_of, gather, padded
from luxel.radiosity.hemicube import frames_of
from luxel.radiosity.labour import Labour
from luxel.radiosity.nearest import nearest
from luxel.radiosity.occlusion import Masks, prepare
from luxel.radiosity.sky import cells, split
from luxel.radiosity.solve import pass_on
from luxel.radiosity.transfer import polygon_factor
from luxel.scene.builtin import icosphere
from luxel.scene.normals import with_normals
from luxel.scene.transforms import look_at


@jit.kernel
def trace(scene, origins, directions, reach, found, at):
    """Each ray by itself, and in packets: rows 0 and 1."""
    own_c, own_stack = np.zeros(packet.SCRATCH, np.float32), np.zeros(packet.STACK, np.int32)
    c, stack, scene = jit.borrow(own_c), jit.borrow(own_stack), jit.borrow(scene)
    for first in range(0, len(origins), packet.WIDTH):
        for r in range(np.uint64(packet.WIDTH)):
            o, d = origins[first + r], directions[first + r]
            found[0, first + r], _, share = nearest(scene, o[0], o[1], o[2], d[0] * reach, d[1] * reach, d[2] * reach)
            at[0, first + r] = share * reach
            c[packet.OX + r], c[packet.OY + r], c[packet.OZ + r] = o[0], o[1], o[2]
            c[packet.DX + r], c[packet.DY + r], c[packet.DZ + r], c[packet.AT + r] = d[0], d[1], d[2], reach
        packet.meet_all(scene, c, stack)
        for r in range(np.uint64(packet.WIDTH)):
            item = jit.float_bits(c[packet.FOUND + r])
            found[1, first + r] = scene.triangle[item] if item >= 0 else -1
            at[1, first + r] = c[packet.AT + r]
    own_c[0] = own_stack[0]


def traced(positions, triangles, origins, directions, masks=None):
    found, at = np.zeros((2, len(origins)), np.int64), np.zeros((2, len(origins)))
    trace(prepare(positions, triangles, masks), origins.astype(np.float64), directions.astype(np.float64), 10.0, found, at)
    return found, at


def test_a_packet_meets_what_its_rays_meet():
    rng = np.random.default_rng(1)
    positions = rng.random((900, 3)).astype(np.float32)
    triangles = np.arange(900, dtype=np.int32).reshape(-1, 3)
    positions[triangles[:, 1:]] = positions[triangles[:, :1]] + 0.2 * rng.normal(size=(300, 2, 3)).astype(np.float32)
    origins = rng.random((4096, 3))
    directions = rng.normal(size=(4096, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    directions[:64] = np.repeat(np.eye(3)[rng.integers(0, 3, 4)], 16, 0)  # along axes
    found, at = traced(positions, triangles, origins, directions)
    same = found[0] == found[1]
    assert 0.3 < (found[0] >= 0).mean() < 1
    assert same.mean() > 0.998  # the others pass an edge so near that single precision decides
    both = same & (found[0] >= 0)
    np.testing.assert_allclose(at[1, both], at[0, both], rtol=2e-3, atol=1e-5)


def test_of_faces_back_to_back_a_ray_meets_the_one_that_faces_it():
    rng = np.random.default_rng(4)
    corners = (rng.normal(size=(200, 3, 3)) + 3.0).astype(np.float32)
    positions = np.concatenate([corners, corners[:, [1, 0, 2]]]).reshape(-1, 3)  # each, and its other side, which begins at another corner
    triangles = rng.permutation(np.arange(1200, dtype=np.int32).reshape(-1, 3))
    origins = 3.0 + 3.0 * rng.normal(size=(4096, 3))
    directions = 3.0 + rng.normal(size=(4096, 3)) - origins
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    found, _ = traced(positions, triangles, origins, directions)
    for met in found:
        rays = np.flatnonzero(met >= 0)
        assert len(rays) > 2000
        a, b, c = (positions[triangles[met[rays], k]].astype(float) for k in range(3))
        assert ((np.cross(b - a, c - a) * directions[rays]).sum(1) < 0).all()


def test_a_packet_passes_through_holes():
    positions = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, -1], [1, 0, -1], [0, 1, -1]], np.float32)
    triangles = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6]], np.int32)
    texcoords = np.array([[0, 1, 1, 1, 1, 0], [0, 1, 1, 0, 0, 0], [0] * 6], np.float32)
    table, alpha = np.array([[0, 2, 1, 1, 1, 1, 0, 0]], np.int32), np.array([1.0, 0.0], np.float32)  # the left half is solid
    masks = Masks(np.array([0, 0, -1], np.int32), texcoords, table, np.array([0.5], np.float32), alpha)
    x = np.linspace(0.02, 0.48, 16)
    origins = np.stack([np.concatenate([x, x + 0.5]), np.full(32, 0.3), np.ones(32)], 1)
    found, _ = traced(positions, triangles, origins, np.tile([0.0, 0.0, -1.0], (32, 1)), masks)
    assert set(found[1, :16]) <= {0, 1}
    assert set(found[1, 16:]) <= {2, -1}


def test_a_packet_in_an_empty_scene_meets_nothing():
    found, at = traced(np.zeros((3, 3), np.float32), np.zeros((0, 3), np.int32), np.zeros((16, 3)), cosine_directions(16))
    assert (found[1] == -1).all()
    assert (at[1] == 10).all()


@pytest.fixture(scope="module")
def room():
    """A lit room with a block on its floor, that covers parts of texels."""
    scene = box([matte(0.5), matte(0.5), matte(0.5), matte(0.7, (0.3, 0.3, 0.3)), matte(0.5), matte(0.5)])
    box(matte(0.4), (0.31, 0.0, 0.32), (0.63, 0.4, 0.66), scene, inward=False, skip=(2,))
    return bake(scene, density=20, transport=True)


def test_what_is_met_lies_where_the_ray_goes(room):
    transport, position = room.transport, room.luxels.position
    normal, side = room.luxels.normal, np.sqrt(room.luxels.area)
    hits, luxel = transport.hits, transport.luxel
    assert (hits >= 0).mean() > 0.99
    assert not (hits == NOWHERE).any()
    directions = cosine_directions(hits.shape[1])
    frames = frames_of(normal[luxel])
    for e in range(0, len(hits), 97):
        met = hits[e] >= 0
        way = directions[met] @ frames[e]
        to = position[luxel[hits[e, met]]] - position[luxel[e]]
        along = (to * way).sum(1)
        apart = np.linalg.norm(to - along[:, None] * way, axis=1)
        assert (apart < 2.5 * side.max()).all()  # a spot's distance from the middle, at both ends, seen obliquely
        assert (along > -side.max()).all()


def test_light_passed_on_in_a_closed_scene_is_received():
    rng = np.random.default_rng(2)
    hits = rng.integers(0, 50, (50, 64)).astype(np.int32)
    hits[rng.random(hits.shape) < 0.02] = LOST
    area, light = rng.random(50).astype(np.float32), rng.random((50, 3)).astype(np.float32)
    got, away = pass_on(Sight(hits, np.zeros(50), np.zeros(50, bool)), light, area, Labour(1))
    np.testing.assert_allclose(got.astype(np.float64) @ area, light.T.astype(np.float64) @ area, rtol=1e-6)
    assert not away.any()
    bare = gather(hits, padded(light), 2)
    mean = np.array([light[row[row >= 0]].mean(0) for row in hits]).T
    np.testing.assert_allclose(bare, mean, rtol=1e-5)
    exchange = exchange_of(hits, np.array([0, 20, 50]), area, 1)
    np.testing.assert_allclose(exchange, exchange.T)
    np.testing.assert_allclose(exchange.sum(), area.sum(), rtol=1e-5)


def test_spots_under_a_block_are_not_free(room, monkeypatch):
    kept = []
    original = module.cut
    monkeypatch.setattr(module, "cut", lambda *arguments: kept.append(original(*arguments)) or kept[-1])
    bake(room.atlas.scene, density=20, quality="draft")
    numbers, luxel = kept[0].problem.elements.numbers, kept[0].luxel
    p = room.luxels.position[luxel]
    floor = p[:, 1] < 1e-6
    free = np.bitwise_count(numbers[FREE].astype(np.uint16))
    beyond = np.maximum(np.abs(p[:, 0] - 0.47) - 0.16, np.abs(p[:, 2] - 0.49) - 0.17)
    assert (free[floor & (beyond > 0.06)] == 16).all()
    beside = floor & (beyond > 0) & (beyond < 0.012)  # less than a quarter of a luxel
    assert beside.sum() > 4
    assert (free[beside] < 16).mean() > 0.8


def open_box(hole):
    """A dark room, 1 m a side, with a square hole of that size in the middle of its ceiling."""
    scene = box(matte(0.01), skip=(3,))
    low, high = 0.5 - hole / 2, 0.5 + hole / 2
    for x0, x1, z0, z1 in ((0, 1, 0, low), (0, 1, high, 1), (0, low, low, high), (high, 1, low, high)):
        corners = np.array([[x0, 1, z0], [x1, 1, z0], [x1, 1, z1], [x0, 1, z1]], np.float32)
        scene.add(Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32)), matte(0.01))
    return scene


@pytest.mark.parametrize(("hole", "quality", "most"), [(0.5, "normal", 0.02), (0.25, "normal", 0.05), (0.5, "final", 0.005), (0.25, "final", 0.01)])
def test_the_sky_through_a_window(hole, quality, most):
    """The irradiance is pi L times the form factor of the window (Lambert's formula)."""
    baked = bake(open_box(hole), density=16, sky=2.0, quality=quality)
    p = baked.luxels.position
    floor = np.flatnonzero(p[:, 1] < 1e-6)
    low, high = 0.5 - hole / 2, 0.5 + hole / 2
    corners = np.array([[low, 1, low], [high, 1, low], [high, 1, high], [low, 1, high]])
    exact = np.array([abs(polygon_factor(*map(float, p[i]), 0.0, 1.0, 0.0, corners, 4)) for i in floor]) * 2 * np.pi
    error = baked.direct[floor, 0] - exact
    assert np.sqrt((error**2).mean()) < most * exact.mean()
    assert abs(error.mean()) < 0.01 * exact.mean()


def test_a_sun_is_not_part_of_the_even_sky():
    picture = np.full((32, 64, 3), 0.5)
    picture[8, 20] = 500.0
    even, sun = split(picture)
    np.testing.assert_allclose(even.fine + sun, picture, rtol=1e-6)
    assert np.argwhere(sun.sum(2) > 0).tolist() == [[8, 20]]
    floor = Scene()
    corners = np.array([[-1, 0, 1], [1, 0, 1], [1, 0, -1], [-1, 0, -1]], np.float32)
    floor.add(Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32)), matte(0.5))
    edge = np.pi / 32
    polar, step = (8.5) * edge, 2 * np.pi / 64
    whole = 0.5 * np.pi + 499.5 * np.sin(polar) * np.cos(polar) * edge * step
    np.testing.assert_allclose(bake(floor, density=4, sky=picture).irradiance, whole, rtol=0.03)


@pytest.mark.parametrize("elevation", [5, 20, 45])
def test_the_sun_of_a_picture_is_where_it_is(elevation):
    """Half a degree of radius, anywhere between the directions that much brighter pixels are put into."""
    floor = Scene()
    corners = np.array([[-1, 0, 1], [1, 0, 1], [1, 0, -1], [-1, 0, -1]], np.float32)
    floor.add(Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32)), matte(0.1))
    rows, columns = 180, 360
    polar, around = (np.arange(rows) + 0.5) / rows * np.pi, ((np.arange(columns) + 0.5) / columns - 0.5) * 2 * np.pi
    ring = np.sin(polar)[:, None]
    pixels = np.stack([ring * np.sin(around), np.repeat(np.cos(polar)[:, None], columns, 1), -ring * np.cos(around)], -1)
    for azimuth in np.radians([0.0, 47.3, 101.7, 200.2]):
        height = np.radians(elevation)
        toward = np.array([np.cos(height) * np.sin(azimuth), np.sin(height), -np.cos(height) * np.cos(azimuth)])
        picture = np.where(pixels @ toward > np.cos(np.radians(1.5)), 1e4, 0.0)
        exact = (picture * np.maximum(pixels[..., 1], 0) * ring).sum() * (np.pi / rows) * (2 * np.pi / columns)
        baked = bake(floor, density=4, sky=np.repeat(picture[..., None], 3, 2), quality="draft")
        np.testing.assert_allclose(baked.direct, exact, rtol=0.01)


@pytest.mark.parametrize("density", [3.0, 10.0])
def test_what_bends_does_not_shadow_itself(density):
    """A ball from the inside, lit from its middle: luxels much larger than its triangles, and smaller."""
    shape, scene = icosphere(3.0, 4), Scene()
    scene.add(Mesh(shape.positions, np.ascontiguousarray(shape.triangles[:, ::-1]), -shape.normals), matte(0.1))
    scene.lights.append(Light("point", intensity=9.0, world_from_light=np.eye(4)))
    np.testing.assert_allclose(bake(scene, density=density, quality="draft").direct, 1.0, atol=0.01)


def test_hills_lie_in_the_sun():
    n, size = 60, 15.0
    x, z = np.meshgrid(*[np.linspace(-size / 2, size / 2, n + 1)] * 2, indexing="ij")
    y = 0.8 * np.sin(0.9 * x) * np.cos(0.7 * z) + 0.3 * np.sin(2.3 * x + 1) * np.sin(1.9 * z)
    first = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    triangles = np.concatenate([np.stack([first, first + 1, first + n + 2], 1), np.stack([first, first + n + 2, first + n + 1], 1)])
    scene = Scene()
    scene.add(with_normals(Mesh(np.stack([x, y, z], -1).reshape(-1, 3).astype(np.float32), triangles.astype(np.int32))), matte(0.1))
    toward = np.array([0.3, 1.0, 0.2]) / np.linalg.norm([0.3, 1.0, 0.2])
    scene.lights.append(Light("directional", intensity=1.0, world_from_light=look_at(tuple(10 * toward), (0, 0, 0), (0, 0, 1))))
    baked = bake(scene, density=6, quality="draft")
    share = baked.direct[:, 0] / np.maximum(baked.luxels.normal @ toward, 0.05)
    assert np.percentile(share, 1) > 0.99
    assert share.mean() == pytest.approx(1, abs=0.005)


class Compared(Labour):
    """Notes how elements see the last bounce: by one look, closer, and by 4,096 rays."""

    def look_closer(self, view, sight, light, unlike, told):
        closer = super().look_closer(view, sight, light, unlike, told)
        self.seen = self.bounce(sight, light), closer, super().gather(view, light, 4096, None, told)[0]
        return closer


def last_bounces(scene, monkeypatch, **options):
    compared = Compared(2)
    monkeypatch.setattr("luxel.radiosity.bake.labour_of", lambda *_: compared)
    bake(scene, quality="normal", **options)
    return compared.seen


def test_small_bright_spots_are_looked_at_closer(monkeypatch):
    """A lamp behind a sheet lights a small part of the ceiling: from below it is met by a ray here and there, and shows as stripes."""
    scene = box([matte(0.05)] * 3 + [matte(0.8)] + [matte(0.05)] * 2)
    corners = np.array([[0.45, 0.95, 0.45], [0.55, 0.95, 0.45], [0.55, 0.95, 0.55], [0.45, 0.95, 0.55]], np.float32)
    scene.add(Mesh(corners, np.array([[0, 2, 1], [0, 3, 2]], np.int32)), matte(0.05, (50.0, 50.0, 50.0)))
    once, closer, truth = last_bounces(scene, monkeypatch, density=24)

    def error(light):
        return float(np.sqrt(((light - truth) ** 2).mean()))

    assert error(once) > 0.1 * truth.mean()
    assert error(closer) < 0.6 * error(once)
    assert abs(closer.mean() - truth.mean()) < 0.01 * truth.mean()  # who looks only at what is bright has too little light


def test_what_is_alike_is_not_looked_at_again(monkeypatch):
    scene = box([matte(0.5, (0.2, 0.2, 0.2))] * 6)
    once, closer, _ = last_bounces(scene, monkeypatch, density=10)
    np.testing.assert_allclose(closer, once, rtol=1e-5)


def test_who_sees_by_hardly_any_ray_is_dark(monkeypatch):
    """A luxel behind a skirting board: what one stray ray brings is not what all of its rays would."""
    given = []

    class Kept(Labour):
        def look_closer(self, *arguments):
            given.append(arguments)
            return super().look_closer(*arguments)

    monkeypatch.setattr("luxel.radiosity.bake.labour_of", lambda *_: Kept(2))
    bake(box([matte(0.5, (0.2, 0.2, 0.2))] * 6), density=6, quality="normal")
    view, sight, light = given[0][:3]
    elements, rays = sight.hits.shape
    for known, share in ((1, 1 / 8), (4, 1 / 2), (8, 1), (64, 1)):  # of 128: a sixteenth tells
        hits = np.full((elements, rays), LOST, np.int32)
        hits[:, :: rays // known] = np.arange(elements, dtype=np.int32)[:, None]  # a light that each has for itself
        seen = gather_closer(view, hits, light, np.inf, 2, lambda _: None)
        np.testing.assert_allclose(seen, share * light.T, rtol=1e-5)


def test_no_light_comes_up_through_the_floor_of_a_house_on_sunny_ground():
    """A slab lies half in the ground, walls stand in it. What of the walls is in the slab sees the ground, whose luxels there are in the slab,
    too: the nearest of them that are not are in the sun, outside."""
    scene = Scene()
    ground = np.array([[-6, 0, 6], [6, 0, 6], [6, 0, -6], [-6, 0, -6]], np.float32)
    scene.add(Mesh(ground, np.array([[0, 1, 2], [0, 2, 3]], np.int32)), matte((0.3, 0.35, 0.2)))
    box(matte(0.7), (-2, -0.1, -2), (2, 0.1, 2), scene, inward=False)
    box(matte(0.7), (-2.2, 2, -2.2), (2.2, 2.2, 2.2), scene, inward=False)
    for low, high in (((-2, 0, -2), (2, 2, -1.8)), ((-2, 0, -2), (-1.8, 2, 2)), ((1.8, 0, -2), (2, 2, 2)),
                      ((-2, 0, 1.8), (-0.7, 2, 2)), ((0.7, 0, 1.8), (2, 2, 2)), ((-0.7, 0, 1.8), (0.7, 0.8, 2))):  # fmt: skip
        box(matte(0.7), low, high, scene, inward=False)
    scene.lights.append(Light("directional", intensity=20.0, world_from_light=look_at((5, 8, 9), (0, 0, 0), (0, 1, 0))))
    baked = bake(scene, density=12, sky=0.8)
    p, n, (page, row, column) = baked.luxels.position, baked.luxels.normal, baked.luxels.texel.T
    inner = (np.abs(p[:, 2] - 1.8) < 1e-3) & (n[:, 2] < -0.9) & (np.abs(p[:, 0]) < 1.7)
    shown = baked.pages[page, row, column, 0]
    below, foot, wall = (inner & (p[:, 1] > low) & (p[:, 1] < high) for low, high in ((0, 0.1), (0.1, 0.2), (0.2, 0.4)))
    assert below.sum() > 20
    assert baked.valid[below].mean() < 0.2
    for part in (below, foot):
        assert shown[part].max() < 1.2 * shown[wall].max()
        assert shown[part].mean() > 0.6 * shown[wall].mean()  # nor is there a dark line


@pytest.mark.parametrize("quality", ["draft", "normal"])
def test_the_sun_takes_no_light_from_a_cellar(quality):
    """A lamp's light in a closed room under ground that the sun lights: bakes end by what is left where it is, not by what is left of all light."""

    def lit(*suns):
        scene = box(matte(0.5), high=(2, 1, 2))
        ground = np.array([[-3, 1.1, 5], [5, 1.1, 5], [5, 1.1, -3], [-3, 1.1, -3]], np.float32)
        scene.add(Mesh(ground, np.array([[0, 1, 2], [0, 2, 3]], np.int32)), matte(0.4))
        scene.lights = [Light("point", intensity=1.0, world_from_light=look_at((0.7, 0.6, 0.7), (0.7, 0, 0.7), (0, 0, 1))), *suns]
        baked = bake(scene, density=8, quality=quality)
        return baked.irradiance[baked.luxels.position[:, 1] < 1.05]

    sun = Light("directional", intensity=1000.0, world_from_light=look_at((0, 5, 0), (1.5, 0, 0.5), (0, 0, 1)))
    alone, under = lit(), lit(sun)
    assert np.sqrt(((under - alone) ** 2).mean()) < 0.005 * alone.mean()


@pytest.mark.parametrize("rays", [256, 1024])
def test_each_part_of_the_hemisphere_is_seen_from_all_samples(rays):
    strip = cosine_directions_strip(rays)
    for k in range(SAMPLES):
        assert {_sample_of(number) for number in np.flatnonzero(strip == k)} == set(range(SAMPLES))


def cosine_directions_strip(rays):
    """Of which sixteenth of the square each ray is, by the second coordinate."""
    cell, _, high = cells(rays)
    return cell[:, 1] * SAMPLES // high


@pytest.mark.parametrize("rays", [16, 64, 128, 512])
def test_every_cell_has_a_ray(rays):
    cell, wide, high = cells(rays)
    assert wide * high == rays
    assert len(np.unique(cell, axis=0)) == rays
    middles = np.array([_on_hemisphere(*((cell[k] + 0.5) / (wide, high))) for k in range(rays)])
    apart = np.linalg.norm((middles - cosine_directions(rays))[:, :2], axis=1)  # on the disk, where all cells have the area pi / rays
    assert apart.max() < 1.5 * np.sqrt(np.pi / rays)
