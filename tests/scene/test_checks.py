"""Values that cannot be drawn with are refused before drawing, by the name of the thing and the value."""

import numpy as np
import pytest

import luxel
from luxel import Ambient, InputError, Instance, Light, Material, Scene, Texture, TextureRef
from luxel.scene.builtin import box

GREY = np.full((4, 4, 3), 128, np.uint8)


def scene(material=None, texture=None, ref=None, **rest):
    made = Scene.from_mesh(box(), Material(**(material or {})))
    if texture is not None:
        made.textures.append(Texture(GREY, **texture))
        made.materials[0].base_color_texture = TextureRef(0, **(ref or {}))
    for name, value in rest.items():
        setattr(made, name, value)
    return made


def lit(**values):
    light = Light("spot")
    for name, value in values.items():
        setattr(light, name, value)
    return {"lights": [light]}


WRONG = [
    ({"material": {"base_color": (1, 0, 0)}}, r"material 0, base_color: expected 4 finite numbers, got \(1, 0, 0\)"),
    ({"material": {"base_color": "grey"}}, "base_color"), ({"material": {"emissive": (1, 1, np.nan)}}, "emissive"),
    ({"material": {"emissive": 1}}, "emissive"), ({"material": {"specular": (1,)}}, "specular"), ({"material": {"shininess": "x"}}, "shininess"),
    ({"material": {"roughness": np.nan}}, "roughness: expected a finite number, got nan"), ({"material": {"metallic": None}}, "metallic"),
    ({"material": {"alpha_mode": "blend"}}, "alpha_mode: expected one of OPAQUE, MASK, BLEND, got 'blend'"),
    ({"material": {"shading": "toon"}}, "shading: expected one of flat"), ({"material": {"shading": ["pbr"]}}, "shading"),
    ({"material": {"base_color_texture": TextureRef(0)}}, "0 textures, got 0"), ({"material": {"base_color_texture": TextureRef("a")}}, "got str"),
    ({"material": {"normal_texture": 3}}, "TextureRef"),
    ({"texture": {"wrap": "repeat"}}, "pair"), ({"texture": {"wrap": ("repeat", "tile")}}, "got 'tile'"),
    ({"texture": {"filter": "linear"}}, "nearest, bilinear, trilinear"), ({"texture": {}, "ref": {"texcoord": 2}}, "texcoord: expected 0 or 1"),
    ({"texture": {}, "ref": {"scale": 2}}, "scale"), ({"texture": {}, "ref": {"offset": (0, np.inf)}}, "offset"),
    ({"texture": {}, "ref": {"rotation": "x"}}, "rotation"), ({"textures": [GREY]}, "texture 0: expected a Texture, got ndarray"),
    ({"materials": ["red"]}, "material 0: expected a Material, got str"), ({"lights": ["sun"]}, "light 0: expected a Light"),
    (lit(color=(1, 1)), "light 0, color"), (lit(intensity=np.nan), "intensity"), (lit(kind="sun"), "kind"), (lit(range=0), "range.*above 0"),
    (lit(inner_cone="x"), "inner_cone"), (lit(outer_cone=np.nan), "outer_cone"), (lit(world_from_light=np.full((4, 4), np.nan)), "world_from_light"),
    ({"ambient": Ambient(sky=(1, 1))}, "ambient, sky"), ({"ambient": Ambient(ground="blue")}, "ambient, ground"), ({"ambient": (1, 1, 1)}, "Ambient"),
    ({"instances": [Instance("a")]}, "instance 0: mesh 'a' of 1"), ({"instances": [3]}, "instance 0: expected a Instance"),
    ({"instances": [Instance(0), Instance(0, np.full((4, 4), np.inf))]}, "instance 1, world_from_mesh"), ({"meshes": ["box"]}, "mesh 0"),
]  # fmt: skip


@pytest.mark.parametrize(("values", "message"), WRONG)
def test_wrong_values_are_refused_by_name(values, message):
    with pytest.raises(InputError, match=message):
        luxel.render(scene(**values), size=(8, 8))


def test_what_is_right_passes():
    everything = {"texture": {"wrap": ["mirror", "clamp"], "filter": "nearest"}, "ref": {"texcoord": 1, "scale": np.ones(2)}}
    made = scene({"base_color": np.ones(4), "specular": (0, 0, 0), "shininess": np.float32(3), "shading": "phong"}, **everything)
    made.lights.append(Light("point", range=float("inf")))
    made.check()


@pytest.mark.parametrize("call", [
    lambda: Scene.from_mesh("box"), lambda: Scene.from_mesh(box(), "red"), lambda: luxel.inspect("box.glb"), lambda: luxel.frame("box.glb"),
    lambda: luxel.frame(scene(), azimuth="left"), lambda: luxel.frame(scene(), size=5), lambda: luxel.frame(scene(), margin=None),
    lambda: luxel.frame(scene(), distance="far"), lambda: luxel.turntable(scene(), "many"), lambda: luxel.turntable(scene(), 2.5),
    lambda: luxel.Camera(yfov="45"), lambda: luxel.Camera(near="a"), lambda: luxel.Camera(far=None), lambda: luxel.Camera(aspect="wide"),
    lambda: luxel.Camera(yfov=None, height="tall"), lambda: luxel.load((np.eye(3), [[0, 1, 2]]), crease_angle="x"),
    lambda: luxel.render_to_png("a.jpg", scene()),
])  # fmt: skip
def test_wrong_arguments_are_refused(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(luxel.LuxelError, match="expected"):
        call()
