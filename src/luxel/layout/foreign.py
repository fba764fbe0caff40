"""trimesh objects laid out: new ones of the same kind, with what they carry for vertices and faces."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

from luxel.arrays import Array, checked
from luxel.layout import clean
from luxel.layout.measure import Draw, measure
from luxel.layout.optimize import Options, Progress, Report, lay_out


def optimize_trimesh(source: Any, options: Options, report: Report, measures: bool, progress: Progress | None) -> Any:
    """A trimesh.Trimesh or trimesh.Scene like `source`, laid out; what is no mesh in a scene stays as it is."""
    trimesh = sys.modules["trimesh"]
    if isinstance(source, trimesh.Trimesh):
        made = {"": _optimized(source, options, report, progress)}
        before, result = {"": source}, made[""]
    else:
        before = {name: item for name, item in source.geometry.items() if isinstance(item, trimesh.Trimesh)}
        made = {name: _optimized(item, options, report, progress) for name, item in before.items()}
        result = source.copy()
        result.geometry.update(made)
    report.refuse_nothing()
    if measures:
        report.before, report.after = (measure([_draw(item) for item in items.values()], _seen(items), options.threads) for items in (before, made))
    return result


def _vertex_arrays(mesh: Any) -> dict[str, Array]:
    """Everything of one row a vertex, by a name of its own."""
    n = len(mesh.vertices)
    arrays = {"vertices": np.asarray(mesh.vertices)}
    if "vertex_normals" in mesh._cache:  # given, and not to be made anew
        arrays["normals"] = np.asarray(mesh.vertex_normals)
    if mesh.visual.kind == "vertex":
        arrays["colors"] = np.asarray(mesh.visual.vertex_colors)
    uv = getattr(mesh.visual, "uv", None)
    if uv is not None and len(uv) == n:
        arrays["uv"] = np.asarray(uv)
    own = {f"attribute {key}": np.asarray(value) for key, value in mesh.vertex_attributes.items()}
    return arrays | {key: value for key, value in own.items() if value.shape[:1] == (n,)}


def _optimized(mesh: Any, options: Options, report: Report, progress: Progress | None) -> Any:
    arrays = _vertex_arrays(mesh)
    points = checked(arrays["vertices"], ("n", 3), np.float32, "vertices")
    faces = checked(mesh.faces, ("m", 3), np.int32, "faces")
    laid = lay_out([faces], len(points), options, report, points, lambda: clean.vertex_rows(list(arrays.values())), progress=progress)
    vertices, triangles = laid.vertex_source, laid.triangle_source[0]
    report.triangle_source.append(triangles)
    report.vertex_source.append(vertices)
    result = type(mesh)(vertices=arrays["vertices"][vertices], faces=laid.triangles[0], process=False, metadata=dict(mesh.metadata))
    if "normals" in arrays:
        result.vertex_normals = arrays["normals"][vertices]
    if mesh.visual.kind == "vertex":
        result.visual.vertex_colors = arrays["colors"][vertices]
    elif mesh.visual.kind == "face":
        result.visual.face_colors = np.asarray(mesh.visual.face_colors)[triangles]
    elif mesh.visual.kind == "texture":
        result.visual = mesh.visual.copy()
        if "uv" in arrays:
            result.visual.uv = arrays["uv"][vertices]
    result.vertex_attributes.update({key.removeprefix("attribute "): arrays[key][vertices] for key in arrays if key.startswith("attribute ")})
    result.face_attributes.update({key: np.asarray(value)[triangles] for key, value in mesh.face_attributes.items()})
    return result


def _draw(mesh: Any) -> Draw:
    arrays = _vertex_arrays(mesh)
    size = sum(4 * array[:1].size if array.dtype.kind == "f" else array[:1].nbytes for array in arrays.values())
    return Draw(np.asarray(mesh.faces, np.int32), len(mesh.vertices), max(size, 12))


def _seen(meshes: dict[str, Any]) -> tuple[Array, Array, Array] | None:
    """The mesh, if it is one alone: nodes place those of a scene."""
    if len(meshes) != 1:
        return None
    (mesh,) = meshes.values()
    return np.asarray(mesh.vertices, np.float32), np.asarray(mesh.faces, np.int32), np.ones(len(mesh.faces), bool)
