"""Rectangles in the world with rectangular charts: an atlas whose luxels can be written down."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np

from luxel.scene import Material, Mesh, Scene


@dataclass
class Sheet:
    """A rectangle at `corner` along `right` and `down`, both (3,); its chart's corner and size in texels, both (2,)."""

    corner: tuple
    right: tuple
    down: tuple
    at: tuple
    texels: tuple
    page: int = 0
    material: Material | None = None


def atlas_of(sheets, size=(32, 32)):
    """The atlas of the sheets, one instance and one chart each."""
    scene = Scene()
    for sheet in sheets:
        corner, right, down = (np.array(v, np.float32) for v in (sheet.corner, sheet.right, sheet.down))
        at, texels = np.array(sheet.at, np.float32), np.array(sheet.texels, np.float32)
        normal = np.cross(down, right)
        steps = np.float32([[0, 0], [0, 1], [1, 1], [1, 0]])
        places = corner + steps[:, :1] * right + steps[:, 1:] * down
        uv = (at + steps * texels) / np.float32(size)
        normals = np.tile(normal / np.linalg.norm(normal), (4, 1))
        scene.add(Mesh(places, [[0, 1, 2], [0, 2, 3]], normals=normals, texcoords1=uv, texcoords=steps), sheet.material or Material())
    pages = np.array([sheet.page for sheet in sheets], np.int32)
    chart = np.repeat(np.arange(len(sheets), dtype=np.int32), 2)
    return SimpleNamespace(scene=scene, instance_page=pages, pages=int(pages.max()) + 1, size=size, chart=chart)


def luxels_of(sheets, size=(32, 32)):
    """Every texel that a chart touches, at the middle of the part that it covers."""
    rows = []
    for chart, sheet in enumerate(sheets):
        low, high = np.array(sheet.at, float), np.array(sheet.at, float) + sheet.texels
        for row in range(int(np.floor(low[1])), int(np.ceil(high[1]))):
            for column in range(int(np.floor(low[0])), int(np.ceil(high[0]))):
                texel = np.array([column, row])
                middle = (np.maximum(texel, low) + np.minimum(texel + 1, high)) / 2
                x, y = (middle - low) / sheet.texels
                place = np.array(sheet.corner, float) + x * np.array(sheet.right) + y * np.array(sheet.down)
                face = np.cross(sheet.down, sheet.right)
                rows.append((sheet.page, row, column, chart, *place, *face / np.linalg.norm(face)))
    table = np.array(sorted(rows))
    shape = (max(sheet.page for sheet in sheets) + 1, size[1], size[0])
    texel, chart = table[:, :3].astype(np.int32), table[:, 3].astype(np.int32)
    place, face = table[:, 4:7].astype(np.float32), table[:, 7:].astype(np.float32)
    return SimpleNamespace(texel=texel, chart=chart, position=place, face_normal=face, shape=shape)


def shown(atlas, pages, instance, s, t):
    """What a renderer shows at a place of an instance's sheet, s along `right` and t along `down`, each 0..1: bilinear, (k, c)."""
    uv = atlas.scene.meshes[atlas.scene.instances[instance].mesh].texcoords1.astype(float)
    point = (uv[0] + np.asarray(s)[:, None] * (uv[3] - uv[0]) + np.asarray(t)[:, None] * (uv[1] - uv[0])) * atlas.size - 0.5
    page = pages[atlas.instance_page[instance]]
    corner = np.floor(point).astype(int)
    x, y = (point - corner).T
    total = 0
    for dx, dy, weight in ((0, 0, (1 - x) * (1 - y)), (1, 0, x * (1 - y)), (0, 1, (1 - x) * y), (1, 1, x * y)):
        column, row = (np.clip(corner[:, k] + d, 0, atlas.size[k] - 1) for k, d in ((0, dx), (1, dy)))
        total = total + page[row, column] * weight[:, None]
    return total
