"""Checkpoints are of one scene, one quality and one solver; the light of others is not mixed into it."""

import numpy as np
import pytest
from closed import box, matte

from luxel import FileError, InputError, LuxelWarning, Material, Mesh, Texture, TextureRef
from luxel.radiosity import checkpoint
from luxel.radiosity.bake import bake


def begin(scene, state, **more):
    """A bake that is stopped after its first step; returns how to go on."""
    options = {"density": 10, "quality": "draft", "checkpoint": state, **more}
    assert not bake(scene, seconds=1e-9, **options).finished
    return options


def leaf():
    """A box with a lamp, and in it a leaf, whose alpha is cut out in part."""
    scene = box([matte(0.5)] * 3 + [matte(0.5, 1.0)] + [matte(0.5)] * 2)
    image = np.full((512, 512, 4), 255, np.uint8)
    image[:, :256, 3] = 0
    scene.textures.append(Texture(image))
    corners = np.array([[0.3, 0.5, 0.3], [0.3, 0.5, 0.7], [0.7, 0.5, 0.7], [0.7, 0.5, 0.3]], np.float32)
    places = np.array([[0, 0], [0, 1], [1, 1], [1, 0]], np.float32)
    cut_out = Material(base_color_texture=TextureRef(0), alpha_mode="MASK")
    scene.add(Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), texcoords=places), cut_out)
    return scene


def two_sided(scene):
    scene.materials[0].double_sided = True  # what lies behind it is dark, but what it hides is not the same


def blended(scene):
    scene.materials[-1].alpha_mode = "BLEND"


def with_a_smaller_hole(scene):
    scene.textures[0].image[9, 9, 3] = 255  # so small that no luxel is another for it


@pytest.mark.parametrize("change", [two_sided, blended, with_a_smaller_hole])
def test_other_sides_and_holes_are_another_scene(tmp_path, change):
    options = begin(leaf(), tmp_path / "state")
    changed = leaf()
    change(changed)
    with pytest.raises(InputError, match="of another scene or other settings; delete it, or bake without --resume"):
        bake(changed, resume=True, **options)
    assert bake(leaf(), resume=True, **options).finished


def test_another_sky_is_another_bake(tmp_path):
    """Also where none of it comes in."""
    dark = "have 0.00% of the light that they would have under the open sky"
    with pytest.warns(LuxelWarning, match=dark):
        options = begin(leaf(), tmp_path / "state", sky=1.0)
    with pytest.raises(InputError, match="other settings"):
        bake(leaf(), resume=True, **{**options, "sky": 2.0})
    with pytest.warns(LuxelWarning, match=dark):
        assert bake(leaf(), resume=True, **options).finished


def test_a_checkpoint_of_another_version_is_refused(tmp_path, monkeypatch):
    state = tmp_path / "state"
    options = begin(leaf(), state)
    monkeypatch.setattr(checkpoint, "SOLVER", checkpoint.SOLVER + 1)
    with pytest.raises(InputError, match=r"state: the checkpoint is of another version of luxel, .* delete it, or bake without --resume"):
        bake(leaf(), resume=True, **options)
    monkeypatch.undo()
    with np.load(state) as kept:
        arrays = {name: kept[name] for name in kept.files if name != "version"}
    with open(state, "wb") as file:
        np.savez(file, **arrays)  # as they were before they had one
    with pytest.raises(InputError, match="another version"):
        bake(leaf(), resume=True, **options)
    with open(state, "wb") as file:
        np.savez(file, something=np.zeros(3))
    with pytest.raises(FileError, match="expected a checkpoint"):
        bake(leaf(), resume=True, **options)
