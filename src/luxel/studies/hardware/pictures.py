"""Pictures of the interpolator next to exact ones, and how scan conversion over blocks fares."""

from __future__ import annotations

import numpy as np

from luxel.arrays import Array
from luxel.hardware import float24
from luxel.hardware.interpolator import LUXEL, PAPER, Precision, draw
from luxel.hardware.scan import BLOCK, blocks, edges, scan
from luxel.raster.constants import SUBPIXEL
from luxel.studies.report import Report
from luxel.studies.study import HERE, Context

_GREY = 0.08  # linear, behind
_MAGNIFIED = 2.0**16
_CUBE = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], np.float64)
_FACES = ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5))


def triangle(size: int) -> tuple[Array, Array]:
    """The paper's smooth-shaded triangle: corners (1, 3, 2) and colours (1, 3, 3), red, green and blue."""
    corners = np.array([[[0.08, 0.9], [0.92, 0.86], [0.46, 0.07]]]) * size * SUBPIXEL
    return np.rint(corners).astype(np.int64), np.eye(3)[None]


def cube(size: int) -> tuple[Array, Array]:
    """The paper's smooth-shaded cube, as triangles (m, 3, 2) that are seen, and colours (m, 3, 3): every corner of the cube has its own."""
    tilt, turn = 0.55, 0.7
    about_y = np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]])
    about_x = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    seen = _CUBE @ about_y.T @ about_x.T
    screen = np.rint((0.5 + seen[:, :2] * [1, -1] * 1.1 / (5.2 - seen[:, 2:])) * size * SUBPIXEL).astype(np.int64)
    faces = np.array([corner for a, b, c, d in _FACES for corner in ((a, b, c), (a, c, d))])
    corners = screen[faces]
    front = ~edges(corners).flipped
    return corners[front], ((_CUBE + 1) / 2)[faces[front]]


def drawn(corners: Array, colors: Array, size: int, precision: Precision = LUXEL) -> Array:
    """(size, size, 3) float64, linear: triangles in their order, by the model."""
    picture = np.full((size, size, 3), _GREY)
    for place, color in zip(corners, colors, strict=True):
        found = draw(place, float24.from_float(color), size, size, precision)
        picture[found.y, found.x] = float24.to_float(found.colors)
    return picture


def exactly(corners: Array, colors: Array, size: int) -> Array:
    """The same, with exact weights."""
    picture = np.full((size, size, 3), _GREY)
    for place, color in zip(corners, colors, strict=True):
        found = scan(place, size, size)
        picture[found.y, found.x] = found.edges / float(edges(place).area) @ float24.to_float(float24.from_float(color))
    return picture


def shown(context: Context, report: Report) -> None:
    """Triangle and cube: by the model, exact, and the difference, magnified."""
    from luxel.scene.colour import bytes_from_linear

    size, rows = 160 if context.quick else 320, []
    for name, made in (("triangle", triangle(size)), ("cube", cube(size))):
        exact = exactly(*made, size)
        bytes_exact = bytes_from_linear(exact.astype(np.float32))
        panels = []
        for precision in (LUXEL, PAPER):
            ours = drawn(*made, size, precision)
            apart, bytes_ours = np.abs(ours - exact), bytes_from_linear(np.maximum(ours, 0).astype(np.float32))
            covered = (exact != _GREY).any(-1)
            rows.append({
                "picture": name, "edge": precision.edge, "1 / area": precision.reciprocal, "source": HERE, "fragments": int(covered.sum()),
                "largest error, 2^-16": apart.max() * 2**16, "RMS error, 2^-16": np.sqrt((apart[covered] ** 2).mean()) * 2**16,
                "bytes that differ, %": (bytes_ours != bytes_exact)[covered].mean() * 100,
                "by at most": int(np.abs(bytes_ours.astype(int) - bytes_exact).max()),
            })  # fmt: skip
            panels += [bytes_ours, (np.clip(apart * _MAGNIFIED, 0, 1) * 255).astype(np.uint8)]
        image = np.concatenate([panels[0], bytes_exact, panels[1], panels[3]], 1)
        note = f"From left to right: by the model; exact; their difference times {_MAGNIFIED:,.0f}; the same of float24 throughout. White is 2^-16."
        report.picture(name, f"A smooth-shaded {name}", image, note)
    report.table("pictures", "Pictures beside exact ones", rows, "Bytes are sRGB.")


def blocks_row(rng: np.random.Generator, side: float, count: int) -> dict[str, object]:
    """Blocks and fragments of random triangles up to `side` pixels wide."""
    tried = rejected = accepted = empty = fragments = 0
    for _ in range(count):
        corners = rng.integers(0, int(side * SUBPIXEL) + 1, (3, 2)) + rng.integers(0, BLOCK * SUBPIXEL, 2)
        found, seen = blocks(corners, 4096, 4096), scan(corners, 4096, 4096)
        held = len(np.unique(seen.y // BLOCK * 4096 + seen.x // BLOCK))
        tried, rejected, accepted = tried + len(found.x), rejected + int(found.rejected.sum()), accepted + int(found.accepted.sum())
        empty, fragments = empty + int((~found.rejected).sum()) - held, fragments + len(seen.x)
    walked = tried - rejected
    shares = {"rejected, %": rejected, "accepted, %": accepted, "kept in vain, %": empty}
    return {
        "up to, pixels": side, "source": HERE, "triangles": count, "fragments each": fragments / count, "blocks each": tried / count,
        **{name: 100 * number / tried for name, number in shares.items()},
        "fragments a kept block": fragments / walked, "fragments a block tried": fragments / tried,
    }  # fmt: skip


def blocks_table(context: Context, report: Report) -> None:
    """How many blocks a triangle's bounding box has, and what becomes of them."""
    rng = np.random.default_rng(5)
    count = 60 if context.quick else 400
    rows = [blocks_row(rng, side, count) for side in (2, 4, 8, 16, 32, 64, 128, 256)]
    note = (
        "Blocks of 8 x 8 pixels that the bounding box touches. Rejected: all centres lie beyond one edge; accepted: all lie inside. Where a block "
        "tried has more than one fragment on average, a circuit that tries one block a clock keeps a pipeline of one fragment a clock busy."
    )
    report.table("blocks", "Scan conversion over blocks", rows, note)
