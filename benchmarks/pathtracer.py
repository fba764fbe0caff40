"""Mitsuba as the truth about a baked scene: irradiance averaged over the footprint of single luxels, by path tracing.

A tiny orthographic camera hangs just above each luxel and sees nothing but its texel's parallelogram; a diffuse surface shows albedo * E / pi.
"""

from __future__ import annotations

import itertools
import math
import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from luxel.radiosity.bake import Baked
from luxel.radiosity.elements import frames_of_texels
from luxel.radiosity.rays import Occluders
from luxel.raster.geometry import flatten
from luxel.scene.material import Material
from luxel.scene.normals import vertex_normals

_LIFT = 1e-4  # of the scene's diagonal: the cameras' height
_BEHIND = 0.1  # of that: how far the back of a two-sided lamp is from its front
_SHRINK = 0.98  # of a texel, when it is looked whether something stands on it
_LYING = 0.1  # of a texel's side
_AT_ONCE = 64  # cameras of one picture


class Missing(Exception):
    """The peer is not there; the message says why."""


class Mitsuba:
    """A baked scene in Mitsuba's scalar variant.

    Args:
        baked: Without textures, masks or lights that have no surface.
        sky: Constant radiance, or None.
    """

    def __init__(self, baked: Baked, sky: float | None = None) -> None:
        try:
            import mitsuba
        except ImportError as error:
            raise Missing(f"mitsuba: {error}") from None
        mitsuba.set_variant("scalar_rgb")
        mitsuba.set_log_level(mitsuba.LogLevel.Error)
        self.mi, self.name = mitsuba, f"Mitsuba {mitsuba.__version__}, scalar_rgb"
        self.baked, self.geometry = baked, flatten(baked.atlas.scene, "none")
        self.right, self.up = (sides.astype(float) for sides in frames_of_texels(baked.atlas, self.geometry, baked.luxels))
        self.lift = _LIFT * float(np.linalg.norm(np.ptp(self.geometry.positions, axis=0)))
        self.scene = self._scene(sky)

    def _scene(self, sky: float | None) -> Any:
        parts: dict[str, Any] = {"type": "scene", "integrator": {"type": "path", "max_depth": 64, "rr_depth": 16}}
        materials = [*self.baked.atlas.scene.materials, Material()]
        for p, material in enumerate(self.geometry.part_material):
            triangles = self.geometry.triangles[self.geometry.part_start[p] : self.geometry.part_start[p + 1]]
            if len(triangles):
                parts[f"part {p}"] = self._mesh(f"part {p}", triangles, materials[material])
                if materials[material].double_sided and max(materials[material].emissive) > 0:  # Mitsuba's lamps shine from their fronts only
                    parts[f"back {p}"] = self._mesh(f"back {p}", triangles[:, ::-1], materials[material], _BEHIND * self.lift)
        if sky is not None:
            parts["sky"] = {"type": "constant", "radiance": {"type": "rgb", "value": [sky] * 3}}
        return self.mi.load_dict(parts)

    def _mesh(self, name: str, triangles: Any, material: Material, above: float = 0.0) -> Any:
        """Triangles, moved by so many metres to the side they face."""
        mi = self.mi
        surface: dict[str, Any] = {"type": "diffuse", "reflectance": {"type": "rgb", "value": list(material.base_color[:3])}}
        properties = mi.Properties()
        properties["bsdf"] = mi.load_dict({"type": "twosided", "bsdf": surface} if material.double_sided else surface)
        if max(material.emissive) > 0:
            properties["glow"] = mi.load_dict({"type": "area", "radiance": {"type": "rgb", "value": list(material.emissive)}})
        used, corners = np.unique(triangles, return_inverse=True)
        mesh = mi.Mesh(name, len(used), len(triangles), props=properties)
        arrays = mi.traverse(mesh)
        places = self.geometry.positions[used].astype(float)
        if above:
            places += above * vertex_normals(places, corners.reshape(-1, 3)).astype(float)
        arrays["vertex_positions"] = np.ascontiguousarray(places.astype(np.float32).ravel())
        arrays["faces"] = np.ascontiguousarray(corners.astype(np.uint32).ravel())
        arrays.update()
        return mesh

    def comparable(self) -> Any:
        """(n,) bool: whole texels that are no lamps, and on which nothing stands: where a wall's foot or a leg covers a part, two renderers may
        well differ in what the rest stands for; nor those that stand for other texels too, whose footprint would reach beyond the surface."""
        luxels = self.baked.luxels
        ok = self.baked.valid & (luxels.coverage > 0.999) & (luxels.emission.sum(1) == 0)
        ok &= np.abs(luxels.area / self._texel_areas() - 1) < 0.01
        chosen = np.flatnonzero(ok)
        middle = luxels.position[chosen] + self.lift * luxels.face_normal[chosen].astype(float)
        around = [middle + _SHRINK / 2 * (a * self.right[chosen] + b * self.up[chosen]) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        sight = Occluders.of_scene(self.baked.atlas.scene)
        for k in range(4):
            ok[chosen] &= sight.visible(middle, around[k]) & sight.visible(around[k], around[(k + 1) % 4])
        return ok

    def alone(self, chosen: Any) -> Any:
        """(k,) bool: chosen luxels with no other chart's in the same place: of two surfaces that lie in each other either may be what a ray meets;
        nor with something lying on them, at a tenth of their side or less: the light of such a luxel is that of what is not covered."""
        from scipy.spatial import KDTree

        luxels, side = self.baked.luxels, np.sqrt(self.baked.luxels.area)
        sight, open_ = Occluders.of_scene(self.baked.atlas.scene), np.ones(len(chosen), bool)
        normal = luxels.face_normal[chosen].astype(float)
        for a, b in itertools.product((-_SHRINK / 2, 0.0, _SHRINK / 2), repeat=2):
            spot = luxels.position[chosen] + self.lift * normal + a * self.right[chosen] + b * self.up[chosen]
            open_ &= sight.visible(spot, spot + _LYING * side[chosen, None] * normal)
        near = KDTree(luxels.position).query_ball_point(luxels.position[chosen], 0.75 * side[chosen])
        return open_ & np.array([not any(self._coincide(i, np.array(others))) for i, others in zip(chosen, near, strict=True)])

    def _coincide(self, i: int, others: Any) -> Any:
        luxels = self.baked.luxels
        height = np.abs((luxels.position[others] - luxels.position[i]) @ luxels.face_normal[i])
        parallel = np.abs(luxels.face_normal[others] @ luxels.face_normal[i]) > 0.99
        across = np.linalg.norm(luxels.position[others] - luxels.position[i], axis=1)
        beside = (luxels.chart[others] != luxels.chart[i]) & (across < 0.75 * np.sqrt(luxels.area[i]))
        return beside & parallel & (height < 2 * self.lift)

    def _texel_areas(self) -> Any:
        """(n,) m2 of surface that a whole texel of each luxel's triangle has."""
        triangles = self.geometry.triangles[self.baked.luxels.triangle]
        a, b, c = (self.geometry.positions[triangles[:, k]].astype(float) for k in range(3))
        p, q, r = (self.geometry.texcoords1[triangles[:, k]].astype(float) * self.baked.atlas.size for k in range(3))
        texels = (q[:, 0] - p[:, 0]) * (r[:, 1] - p[:, 1]) - (q[:, 1] - p[:, 1]) * (r[:, 0] - p[:, 0])
        return np.linalg.norm(np.cross(b - a, c - a), axis=1) / np.maximum(np.abs(texels), 1e-12)

    def irradiance(self, chosen: Any, samples: int, seed: int) -> Any:
        """(k, 3) W/m2 of the chosen luxels, from so many paths each."""
        albedo = self.baked.luxels.albedo[chosen].astype(float)
        parts = [self._look(chosen[i : i + _AT_ONCE], samples, seed * 7919 + i) for i in range(0, len(chosen), _AT_ONCE)]
        return np.concatenate(parts) * math.pi / albedo

    def _look(self, chosen: Any, samples: int, seed: int) -> Any:
        mi, luxels = self.mi, self.baked.luxels
        film = {"type": "hdrfilm", "width": len(chosen), "height": 1, "rfilter": {"type": "box"}, "pixel_format": "rgb"}
        film["component_format"] = "float32"
        batch: dict[str, Any] = {"type": "batch", "film": film, "sampler": {"type": "independent", "sample_count": samples}}
        for i in chosen:
            normal, place = luxels.face_normal[i].astype(float), np.eye(4)
            place[:3] = np.stack([self.right[i] / 2, self.up[i] / 2, -normal, luxels.position[i] + self.lift * normal], 1)
            near = {"near_clip": self.lift * 1e-3, "far_clip": self.lift * 10}
            batch[f"luxel {i}"] = {"type": "orthographic", "to_world": mi.ScalarTransform4f(place), **near}
        return np.array(mi.render(self.scene, sensor=mi.load_dict(batch), spp=samples, seed=seed))[0, :, :3].astype(float)


@dataclass(frozen=True)
class Truth:
    """Irradiance (k, 3) of the `chosen` luxels, of which every value has a standard error of `noise`, on the average (root mean square)."""

    chosen: Any
    irradiance: Any
    noise: float
    seconds: float

    @property
    def mean(self) -> float:
        return float(self.irradiance.mean())

    def error(self, irradiance: Any) -> float:
        """Root mean square error over luxels and channels, by the mean, without what the reference's own noise adds to it."""
        apart = float(((irradiance[self.chosen] - self.irradiance) ** 2).mean())
        return math.sqrt(max(apart - self.noise**2, 0.0)) / self.mean


def truth(mitsuba: Mitsuba, chosen: Any, samples: int) -> Truth:
    """From two independent halves, whose difference tells the noise."""
    start = time.perf_counter()
    one, other = (mitsuba.irradiance(chosen, samples // 2, seed) for seed in (1, 2))
    noise = math.sqrt(float(((one - other) ** 2).mean()) / 4)
    return Truth(chosen, (one + other) / 2, noise, time.perf_counter() - start)

