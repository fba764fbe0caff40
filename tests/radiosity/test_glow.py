"""What shines by its texture, and on two sides."""

import numpy as np
import pytest
from closed import box, matte

from luxel import Mesh, Scene
from luxel.radiosity.bake import bake
from luxel.radiosity.luxels import find_luxels
from luxel.radiosity.unwrap import unwrap
from luxel.scene.builtin.shapes import sphere
from luxel.scene.material import Texture, TextureRef

RADIANCE = 10.0
DENSITIES = [2, 8, 16, 40]
IDENTITY = np.eye(4)

pytestmark = pytest.mark.filterwarnings("ignore:most of the surface is black")


def quad(width, height):
    """Facing down."""
    x, z = width / 2, height / 2
    corners = np.array([[-x, 0, -z], [x, 0, -z], [x, 0, z], [-x, 0, z]], np.float32)
    return Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), texcoords=np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32))


def glowing(scene, image, **more):
    """A material that glows as a picture (h, w, 3) says, white being `RADIANCE`."""
    scene.textures.append(Texture(image))
    return matte(0.0, RADIANCE, emissive_texture=TextureRef(len(scene.textures) - 1), **more)


def stripe(first, last, width=64):
    image = np.zeros((width, width, 3), np.uint8)
    image[:, first:last] = 255
    return image


def area_of(mesh):
    a, b, c = mesh.positions[mesh.triangles].astype(float).transpose(1, 0, 2)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2


def power(luxels):
    return luxels.emission.T.astype(float) @ luxels.area


def room(lamp, material, scene, matrix=IDENTITY):
    """A black room of 4 m with a lamp in its middle."""
    box(matte(0.0), (-2, -2, -2), (2, 2, 2), scene)
    scene.add(lamp, material, matrix)
    return scene


def received(baked, chosen=None):
    """(3,) watts on what does not shine."""
    own = baked.luxels.emission.sum(1) == 0
    own &= True if chosen is None else chosen(baked.luxels.position)
    return baked.irradiance[own].T.astype(float) @ baked.luxels.area[own]


@pytest.mark.parametrize("density", DENSITIES)
@pytest.mark.parametrize("first", [0, 16, 32, 48])
@pytest.mark.parametrize("lamp", [quad(0.1, 0.06), quad(0.4, 0.3), sphere(0.03, 24), sphere(0.15, 24)], ids=["screen", "window", "bead", "ball"])
def test_a_quarter_of_a_lamp_gives_a_quarter_of_its_light(lamp, first, density):
    scene = Scene()
    scene.add(lamp, glowing(scene, stripe(first, first + 16)))
    np.testing.assert_allclose(power(find_luxels(unwrap(scene, density))), np.pi * RADIANCE * area_of(lamp) / 4, rtol=0.005)


@pytest.mark.parametrize("side", [5, 64, 700])
@pytest.mark.parametrize("density", DENSITIES)
def test_what_a_picture_emits_is_its_mean(side, density):
    rng = np.random.default_rng(side)
    image = rng.integers(0, 256, (side, side, 3), np.uint8)
    image[: side // 3] = 0
    scene, lamp = Scene(), quad(0.3, 0.2)
    scene.add(lamp, glowing(scene, image))
    decoded = np.where(image <= 10, image / 255 / 12.92, ((image / 255 + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(power(find_luxels(unwrap(scene, density))), np.pi * RADIANCE * 0.06 * decoded.mean((0, 1)), rtol=0.01)


def test_it_is_the_same_on_any_number_of_threads():
    scene = Scene()
    scene.add(sphere(0.5, 24), glowing(scene, stripe(10, 23)))
    atlas = unwrap(scene, 20)
    one, two = (find_luxels(atlas, threads).emission for threads in (1, 2))
    assert one.tobytes() == two.tobytes()


@pytest.mark.parametrize("density", [3, 5, 8, 12, 20])
@pytest.mark.parametrize("textured", [False, True], ids=["even", "textured"])
@pytest.mark.parametrize("lamp", [quad(0.4, 0.3), sphere(0.05, 24), quad(1, 0.7)], ids=["sign", "ball", "board"])
def test_what_is_left_of_a_lamp_by_holes_shines(lamp, textured, density):
    scene = Scene()
    scene.textures.append(Texture(np.concatenate([stripe(0, 64), stripe(0, 16)[..., :1]], 2)))
    holes = {"base_color_texture": TextureRef(0), "alpha_mode": "MASK", "alpha_cutoff": 0.5}
    scene.add(lamp, matte(0.0, RADIANCE, emissive_texture=TextureRef(0) if textured else None, **holes))
    np.testing.assert_allclose(power(find_luxels(unwrap(scene, density))), np.pi * RADIANCE * area_of(lamp) / 4, rtol=0.03)


def test_holes_take_nothing_from_the_light_of_the_rest():
    """A sign cut out of black: a quarter is there, and all of it glows."""
    image = np.concatenate([stripe(0, 16), stripe(0, 16)[..., :1]], 2)
    scene = Scene()
    scene.textures.append(Texture(image))
    ref = TextureRef(0)
    sign = matte(0.0, RADIANCE, emissive_texture=ref, base_color_texture=ref, alpha_mode="MASK", alpha_cutoff=0.5)
    scene.add(quad(0.4, 0.3), sign)
    luxels = find_luxels(unwrap(scene, 40))
    np.testing.assert_allclose(luxels.emission.max(), np.pi * RADIANCE, rtol=1e-3)
    np.testing.assert_allclose(power(luxels), np.pi * RADIANCE * 0.12 / 4, rtol=0.03)


@pytest.mark.parametrize("density", [4, 8])
@pytest.mark.parametrize("first", [0, 24, 48])
def test_a_lamp_of_a_luxel_lights_the_room_as_its_texture_says(first, density):
    scene, lamp = Scene(), quad(0.1, 0.06)
    part = received(bake(room(lamp, glowing(scene, stripe(first, first + 16)), scene), density=density))
    whole = received(bake(room(lamp, matte(0.0, RADIANCE), Scene()), density=density))
    np.testing.assert_allclose(part, whole / 4, rtol=0.005)
    np.testing.assert_allclose(part, np.pi * RADIANCE * area_of(lamp) / 4, rtol=0.03)  # luxels of 25 cm


@pytest.mark.parametrize("density", [5, 20])
def test_one_side_of_a_small_box_glows_where_its_texture_does(density):
    """A cube of 6 cm, each face with a sixth of the picture, of which one is green: light falls on one half of the room."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float32) * 0.03
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    places = np.array([[(k + x) / 6, y] for k in range(6) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))], np.float32)
    triangles = np.array([[4 * k, 4 * k + i, 4 * k + i + 1] for k in range(6) for i in (1, 2)], np.int32)
    lamp = Mesh(corners[np.array(faces).ravel()], triangles, texcoords=places)
    image = np.zeros((8, 96, 3), np.uint8)
    image[:, 48:64, 1] = 255  # the face towards +y
    scene = Scene()
    baked = bake(room(lamp, glowing(scene, image), scene), density=density, transport=True)
    watts = np.array([0, np.pi * RADIANCE * 0.06**2, 0])
    np.testing.assert_allclose(received(baked), watts, rtol=0.03)
    np.testing.assert_allclose(received(baked, lambda p: p[:, 1] > 0.05), watts, rtol=0.03)
    anew = baked.transport.solve(3 * baked.luxels.emission)
    np.testing.assert_allclose(anew.T @ baked.luxels.area, 3 * watts, rtol=0.03)


@pytest.mark.parametrize("density", [5, 20])
@pytest.mark.parametrize(("lamp", "visible"), [(quad(0.1, 0.06), 2), (quad(0.8, 0.5), 2), (sphere(0.1, 24), 1)], ids=["small", "large", "ball"])
def test_two_sided_lamps_shine_from_both_sides(lamp, visible, density):
    """Of a ball, only the outer one is seen."""
    baked = bake(room(lamp, matte(0.0, RADIANCE, double_sided=True), Scene()), density=density)
    watts = np.pi * RADIANCE * area_of(lamp)
    if visible == 2:
        np.testing.assert_allclose(baked.ledger[-1].emitted, 2 * watts, rtol=0.01)
    np.testing.assert_allclose(received(baked), visible * watts, rtol=0.02)
    above, below = (received(baked, lambda p, side=side: side * p[:, 1] > 0) for side in (1, -1))
    np.testing.assert_allclose(above, below, rtol=0.02)


def test_both_sides_are_lit_anew():
    scene = room(quad(0.8, 0.5), matte(0.0, RADIANCE, double_sided=True), Scene())
    baked = bake(scene, density=6, transport=True)
    dark = baked.luxels.emission.sum(1) == 0
    anew = baked.transport.solve(2 * baked.luxels.emission)
    np.testing.assert_allclose(anew[dark].T @ baked.luxels.area[dark], 2 * received(baked), rtol=0.01)


def test_a_two_sided_surface_that_was_dark_shines_on_both_sides_when_lit_anew():
    scene = box([matte(0.0)] * 3 + [matte(0.0, 1.0)] + [matte(0.0)] * 2, (-2, -2, -2), (2, 2, 2))
    scene.add(quad(1.0, 1.0), matte(0.0, double_sided=True))
    baked = bake(scene, density=6, transport=True)
    luxels = baked.luxels
    light = baked.transport.solve(np.where(luxels.two_sided[:, None], np.float32(1), np.zeros((1, 3), np.float32)))
    above, below = (light[side].T.astype(float) @ luxels.area[side] for side in (luxels.position[:, 1] > 0.1, luxels.position[:, 1] < -0.1))
    np.testing.assert_allclose(above, 1.0, rtol=0.03)
    np.testing.assert_allclose(below, 1.0, rtol=0.03)


@pytest.mark.parametrize("inward", [False, True])
@pytest.mark.parametrize(("thickness", "density"), [(0.005, 3), (0.0005, 6), (0.02, 24)])
def test_a_closed_two_sided_lamp_shines_as_a_one_sided_one(thickness, density, inward):
    """What shines inside is seen by nobody, and mixed up with nothing."""
    low, high = (-0.5, -thickness / 2, -0.5), (0.5, thickness / 2, 0.5)
    watts = []
    for two_sided in (False, True):
        scene = box(matte(0.0), (-2, -2, -2), (2, 2, 2))
        box(matte(0.0, RADIANCE, double_sided=two_sided), low, high, scene, inward=two_sided and inward)
        baked = bake(scene, density=density, quality="draft")
        watts.append(received(baked))
        np.testing.assert_allclose(baked.ledger[-1].emitted, watts[-1], rtol=1e-3)
    np.testing.assert_allclose(watts[1], watts[0], rtol=1e-4)
    np.testing.assert_allclose(watts[1], np.pi * RADIANCE * (2 + 4 * thickness), rtol=0.005)


@pytest.mark.parametrize(("gap", "up"), [(0.0, False), (1e-4, False), (1e-4, True), (2e-3, False)])
@pytest.mark.parametrize("kind", ["two-sided", "back to back"])
def test_a_two_sided_lamp_on_a_ceiling_lights_no_storey_above(kind, gap, up):
    """The ceiling is without thickness, and the lamp in it or right below it."""
    scene, place = Scene(), np.eye(4)
    if kind == "two-sided":
        box(matte(0.5), (-2, -2, -2), (2, 6, 2), scene)
        scene.add(quad(4, 4), matte(0.5, double_sided=True), np.array([[1, 0, 0, 0], [0, 1, 0, 2], [0, 0, 1, 0], [0, 0, 0, 1.0]]))
    else:
        box(matte(0.5), (-2, -2, -2), (2, 2, 2), scene)
        box(matte(0.5), (-2, 2, -2), (2, 6, 2), scene)
    place[1, 3] = 2 - gap
    place[1, 1] = place[2, 2] = -1 if up else 1
    scene.add(quad(1, 1), matte(0.5, RADIANCE, double_sided=True), place)
    baked = bake(scene, density=4, quality="draft")
    above, below = (baked.irradiance[side * (baked.luxels.position[:, 1] - 2) > 0.05].mean() for side in (1, -1))
    assert below > 0.5
    assert above < 5e-4 * below  # as from a one-sided lamp


@pytest.mark.parametrize("outward", [False, True])
@pytest.mark.parametrize("half", [0.25, 0.05])
def test_what_is_small_in_a_glowing_shell_is_lit(half, outward):
    """All around it is as bright."""
    shell = sphere(1.0, 24)
    if not outward:
        shell = Mesh(shell.positions, np.ascontiguousarray(shell.triangles[:, ::-1]))
    scene = box(matte(0.0), (-half,) * 3, (half,) * 3, inward=False)
    scene.add(shell, matte(0.0, RADIANCE, double_sided=True))
    baked = bake(scene, density=8, quality="draft")
    own = baked.luxels.emission.sum(1) == 0
    np.testing.assert_allclose(baked.irradiance[own].mean(), np.pi * RADIANCE, rtol=0.03)


@pytest.mark.parametrize(("cutoff", "density"), [(0.5, 5), (0.1, 5), (0.1, 40)])
def test_holes_are_those_that_are_drawn(cutoff, density):
    """Dots of one texel that is to be seen, not smoothed."""
    image = np.full((64, 64, 4), 255, np.uint8)
    image[..., 3] = 0
    image[::2, ::2, 3] = 255
    scene = Scene()
    scene.textures.append(Texture(image, filter="nearest"))
    holes = {"base_color_texture": TextureRef(0), "alpha_mode": "MASK", "alpha_cutoff": cutoff}
    scene.add(quad(0.4, 0.3), matte(0.0, RADIANCE, emissive_texture=TextureRef(0), **holes))
    np.testing.assert_allclose(power(find_luxels(unwrap(scene, density))), np.pi * RADIANCE * 0.12 / 4, rtol=0.03)


@pytest.mark.parametrize("place", [18, 21, 24])
def test_a_lamp_that_is_hardly_there(place):
    """One texel of 2048 x 2048 is left of a ball, beside a lamp that is looked up at far more places."""
    image = np.full((2048, 2048, 4), 255, np.uint8)
    image[..., 3] = 0
    image[1000, 40 * place, 3] = 255
    scene, beside = Scene(), np.eye(4)
    scene.textures.append(Texture(image))
    scene.add(sphere(0.05, 24), matte(0.0, RADIANCE, double_sided=True, base_color_texture=TextureRef(0), alpha_mode="MASK", alpha_cutoff=0.5))
    beside[:3, 3] = (0.5, 0.5, 0.5)
    baked = bake(room(quad(1, 1), glowing(scene, stripe(0, 64)), scene, beside), density=8, quality="draft")
    np.testing.assert_allclose(received(baked), np.pi * RADIANCE, rtol=0.02)
