import numpy as np
import pytest
from fragments import batch, rgb
from hypothesis import given, settings
from hypothesis import strategies as st

from luxel import jit
from luxel.raster import channels as c
from luxel.raster.encode import srgb_to_linear
from luxel.raster.materials import pack_materials
from luxel.raster.mipmap import LUT, expand, halve, pack_textures
from luxel.raster.texture import fetch
from luxel.scene.material import Material, Texture, TextureRef
from luxel.scene.scene import Scene

IDENTITY = np.array([1, 0, 0, 0, 1, 0], np.float32)


@jit.kernel
def sample_all(g, n, info, levels, texels, radiance, transform):
    fetch(g, n, info, levels, texels, radiance, c.U0, transform)


def scene_with(texture, **material):
    return Scene(textures=[texture], materials=[Material(base_color_texture=TextureRef(0), **material)])


def sample(texture, uv, footprint=(0, 0, 0, 0), transform=IDENTITY):
    """(n, 4) RGBA at `uv` (n, 2), with the derivatives u_x, v_x, u_y, v_y."""
    pool = pack_textures(scene_with(texture))
    uv = np.asarray(uv, np.float32)
    rows = {name: np.full(1, value) for name, value in zip(("U0X", "V0X", "U0Y", "V0Y"), footprint, strict=True)}
    g, n = batch(U0=uv[:, 0], V0=uv[:, 1], **rows)
    sample_all(g, n, pool.textures[0], pool.levels[0], pool.texels, pool.radiance, transform)
    return np.concatenate([rgb(g, n, c.TEXR), g[c.TEXA : c.TEXA + n, None]], 1)


def level(texture, k, **material):
    """(h, w, 4) linear RGBA of a stored mipmap level."""
    pool = pack_textures(scene_with(texture, **material))
    height, width = max(1, texture.image.shape[0] >> k), max(1, texture.image.shape[1] >> k)
    part = pool.texels[pool.levels[0, k] : pool.levels[0, k] + width * height]
    codes = np.stack([part >> shift & 255 for shift in (0, 8, 16, 24)], 1).astype(np.int64)
    codes[:, :3] += 256 * int(texture.srgb)
    return LUT[codes].reshape(height, width, 4)


def oracle(image, wrap, uv):
    """Bilinear interpolation, straight from the definition: a sum over all texels of the unrolled picture near the place."""
    height, width = image.shape[:2]
    place = {
        "repeat": lambda i, n: i % n,
        "clamp": lambda i, n: min(max(i, 0), n - 1),
        "mirror": lambda i, n: min(i % (2 * n), 2 * n - 1 - i % (2 * n)),
    }
    total = np.zeros((len(uv), image.shape[2]))
    for k, (u, v) in enumerate(uv):
        x, y = u * width - 0.5, v * height - 0.5
        for j in range(int(np.floor(y)), int(np.floor(y)) + 2):
            for i in range(int(np.floor(x)), int(np.floor(x)) + 2):
                total[k] += (1 - abs(x - i)) * (1 - abs(y - j)) * image[place[wrap[1]](j, height), place[wrap[0]](i, width)]
    return total


def picture(height, width, channels=4, seed=0, dtype=np.uint8):
    rng = np.random.default_rng(seed)
    codes = rng.integers(0, 256, (height, width, channels), dtype=np.uint8)
    return codes if dtype == np.uint8 else (codes / 255).astype(dtype)


@pytest.mark.parametrize("wrap", [("repeat", "clamp"), ("mirror", "repeat"), ("clamp", "mirror")])
@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_bilinear_is_its_definition(wrap, dtype):
    image = picture(5, 7, dtype=dtype)
    uv = np.random.default_rng(1).uniform(-2.5, 2.5, (60, 2))
    texture = Texture(image, srgb=False, wrap=wrap, filter="bilinear")
    linear = image / 255.0 if dtype == np.uint8 else image
    assert np.allclose(sample(texture, uv), oracle(linear, wrap, uv.astype(np.float32)), atol=2e-5)


def test_texels_are_met_at_their_centres_and_srgb_is_decoded_before_filtering():
    image = picture(3, 4)
    centres = [((x + 0.5) / 4, (y + 0.5) / 3) for y in range(3) for x in range(4)]
    expected = np.concatenate([srgb_to_linear(image[..., :3] / 255), image[..., 3:] / 255], 2).reshape(-1, 4)
    for kind in ("nearest", "bilinear", "trilinear"):
        assert np.allclose(sample(Texture(image, filter=kind), centres), expected, atol=1e-5)
    between = sample(Texture(image, filter="bilinear"), [(0.25, 0.5 / 3)])[0]
    assert np.allclose(between, (expected[0] + expected[1]) / 2, atol=1e-6)


def test_nearest_takes_the_texel_that_holds_the_place():
    image = picture(4, 4)
    for shift in (-2, 0, 3):
        shown = sample(Texture(image, srgb=False, filter="nearest"), [(0.26 + shift, 0.74), (0.49 + shift, 0.51), (0.0 + shift, 0.999)])
        assert np.allclose(shown * 255, [image[2, 1], image[2, 1], image[3, 0]], atol=1e-3)


@pytest.mark.parametrize("channels", [1, 2, 3, 4])
def test_grey_is_spread_and_missing_alpha_is_one(channels):
    image = picture(2, 2, channels)
    for stored in (image, (image / 255).astype(np.float32)):
        shown = sample(Texture(stored, srgb=False, filter="nearest"), [(0.25, 0.25)])[0] * 255
        texel = image[0, 0].astype(int)
        assert np.allclose(shown, [*(texel[:3] if channels > 2 else texel[[0, 0, 0]]), texel[-1] if channels in (2, 4) else 255], atol=1e-3)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e30, -1e30])
@pytest.mark.parametrize("kind", ["nearest", "bilinear", "trilinear"])
def test_wild_coordinates_give_some_texel(value, kind):
    image = np.full((4, 8, 3), 51, np.uint8)
    for wrap in ("repeat", "clamp", "mirror"):
        texture = Texture(image, srgb=False, wrap=(wrap, wrap), filter=kind)
        with np.errstate(all="ignore"):
            assert np.allclose(sample(texture, [(value, 0.5), (0.5, value)]), [0.2, 0.2, 0.2, 1], atol=1e-6)
            assert np.allclose(sample(texture, [(0.5, 0.5)], (value, 0, 0, value)), [0.2, 0.2, 0.2, 1], atol=1e-6)


def test_trilinear_goes_through_the_levels_of_detail():
    image = picture(64, 64)
    texture = Texture(image, srgb=False)
    middle = [(0.5, 0.5)]
    levels = [sample(texture, middle, (s / 64, 0, 0, s / 64))[0] for s in (0.5, 1, 2, 4, 8, 16, 32, 64, 1000)]
    assert np.array_equal(levels[0], levels[1])
    for k in range(7):  # a footprint of 2^k texels: level k alone, sampled at its centre
        stored = level(texture, k)
        assert np.allclose(levels[k + 1], oracle(stored, ("repeat", "repeat"), middle)[0], atol=1e-6)
    assert np.array_equal(levels[7], levels[8])
    between = sample(texture, middle, (2**1.5 / 64, 0, 0, 2**1.5 / 64))[0]
    assert np.allclose(between, (levels[2] + levels[3]) / 2, atol=1e-5)


def test_long_footprints_keep_detail_across():
    # Stripes along u, seen at a grazing angle along u: four probes keep them where one isotropic sample gives plain grey.
    stripes = np.repeat(np.array([[[0]], [[255]]], np.uint8), 8, 0).repeat(64, 1)
    texture = Texture(stripes, srgb=False)
    assert np.allclose(sample(texture, [(0.5, 0.25), (0.5, 0.75)], (4 / 64, 0, 0, 0.5 / 16))[:, 0], [0, 1], atol=1e-6)
    assert np.allclose(sample(texture, [(0.5, 0.25)], (16 / 64, 0, 0, 16 / 16))[0, 0], 0.5, atol=0.01)


@pytest.mark.parametrize("size", [(8, 8), (5, 7), (1, 6), (9, 1), (3, 2), (13, 4)])
def test_every_level_keeps_the_mean(size):
    for dtype, atol in ((np.uint8, 0.7 / 255), (np.float32, 1e-6)):
        texture = Texture(picture(*size, dtype=dtype), srgb=False)
        top = expand(texture.image).astype(np.float64) / (255 if dtype == np.uint8 else 1)
        linear = top.astype(np.float32)
        for k in range(1, max(size).bit_length()):
            linear = halve(linear)
            assert np.allclose(linear.mean((0, 1)), top.mean((0, 1)), atol=1e-6)
            if dtype == np.uint8:
                assert np.allclose(level(texture, k), linear, atol=atol * (1 + 0.2 * k))
            else:
                pool = pack_textures(scene_with(texture))
                start = pool.levels[0, k]
                assert np.allclose(pool.radiance[start : start + linear.shape[0] * linear.shape[1]], linear.reshape(-1, 4))


def test_mipmaps_average_linear_light():
    board = np.array([[[0], [255]], [[255], [0]]], np.uint8)
    assert np.allclose(level(Texture(board), 1)[0, 0, :3], srgb_to_linear(188 / 255), atol=1e-6)  # 188: half the light, not 128
    assert np.allclose(level(Texture(board, srgb=False), 1)[0, 0, :3], 128 / 255, atol=1e-6)


def test_transparent_texels_do_not_bleed_their_colour():
    image = np.zeros((2, 2, 4), np.uint8)
    image[0, 0] = 200, 100, 50, 255
    image[0, 1] = 0, 255, 0, 0
    shown = level(Texture(image, srgb=False), 1, alpha_mode="MASK")[0, 0]
    assert np.allclose(shown * 255, [200, 100, 50, 64], atol=0.6)
    plain = level(Texture(image, srgb=False), 1)[0, 0]
    assert np.allclose(plain * 255, [50, 89, 13, 64], atol=0.6)
    clear = np.full((2, 2, 4), (90, 80, 70, 0), np.uint8)
    assert np.allclose(level(Texture(clear, srgb=False), 1, alpha_mode="BLEND")[0, 0] * 255, [90, 80, 70, 0], atol=0.01)
    wide = halve(expand((image / 255).astype(np.float32)), weighted=True)[0, 0]
    assert np.allclose(wide * 255, [200, 100, 50, 63.75], atol=0.01)


@settings(deadline=None, max_examples=30)
@given(st.floats(-3, 3), st.floats(0.25, 3), st.floats(0.25, 3), st.floats(-1, 1), st.floats(-1, 1))
def test_texture_transform_scales_turns_and_moves(turn, sx, sy, ox, oy):
    ref = TextureRef(0, offset=(ox, oy), rotation=turn, scale=(sx, sy))
    scene = Scene(textures=[Texture(np.zeros((1, 1, 3), np.uint8))], materials=[Material(base_color_texture=ref)])
    a, b, c_, d, e, f = pack_materials(scene).floats[0, 16:22]
    u, v = 0.3, 0.8
    s, t = sx * u, sy * v
    assert a * u + b * v + c_ == pytest.approx(np.cos(turn) * s + np.sin(turn) * t + ox, abs=1e-5)
    assert d * u + e * v + f == pytest.approx(-np.sin(turn) * s + np.cos(turn) * t + oy, abs=1e-5)


def test_the_extensions_own_example_takes_the_lower_left_quarter():
    ref = TextureRef(0, offset=(0, 1), rotation=np.pi / 2, scale=(0.5, 0.5))
    scene = Scene(textures=[Texture(np.zeros((1, 1, 3), np.uint8))], materials=[Material(base_color_texture=ref)])
    a, b, c_, d, e, f = pack_materials(scene).floats[0, 16:22]
    corners = np.array([(a * u + b * v + c_, d * u + e * v + f) for u in (0, 1) for v in (0, 1)])
    assert np.allclose([corners.min(0), corners.max(0)], [(0, 0.5), (0.5, 1)], atol=1e-6)
