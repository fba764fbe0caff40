import json
import struct

import numpy as np
import pytest
from io_samples import FACES, TETRAHEDRON, Gltf, data_uri, full_gltf, png

import luxel.io
from luxel.errors import FileError, LuxelWarning, UnsupportedError
from luxel.scene.colour import linear_from_srgb


@pytest.fixture
def load(tmp_path):
    """A function that writes a Gltf and loads it."""

    def write_and_load(g, name="scene.gltf", **options):
        return luxel.io.load(g.write(tmp_path / name), **options)

    return write_and_load


def one_node(**node):
    g = Gltf()
    g.node(mesh=g.mesh(g.primitive()), **node)
    return g


@pytest.mark.parametrize("name", ["scene.gltf", "scene.glb"])
def test_positions_and_triangles(load, name):
    scene = load(one_node(), name, normals=False)
    mesh = scene.meshes[0]
    assert np.array_equal(mesh.positions, TETRAHEDRON)
    assert np.array_equal(mesh.triangles, FACES)
    assert mesh.positions.flags.writeable
    assert mesh.positions.flags.aligned
    assert mesh.normals is None


def test_missing_normals_are_flat_as_the_specification_asks(load):
    mesh = load(one_node()).meshes[0]
    corners = mesh.positions[mesh.triangles]
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    assert np.allclose(mesh.normals[mesh.triangles], flat[:, None], atol=1e-6)


def test_translation_rotation_scale_apply_in_this_order(load):
    g = one_node(translation=[10, 0, 0], rotation=[0, 0, np.sqrt(0.5), np.sqrt(0.5)], scale=[2, 3, 4])
    matrix = load(g).instances[0].world_from_mesh
    assert np.allclose(matrix @ [1, 1, 1, 1], [10 - 3, 2, 4, 1])


def test_matrix_is_column_major_and_parents_multiply_from_the_left(load):
    g = Gltf()
    mesh = g.mesh(g.primitive())
    g.node(children=[1], scale=[2, 2, 2])
    g.node(mesh=mesh, matrix=[1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 5, 6, 7, 1])
    scene = load(g)
    assert np.allclose(scene.instances[0].world_from_mesh @ [0, 0, 0, 1], [10, 12, 14, 1])


def test_instances_share_a_mesh_and_primitives_share_an_object(load):
    g = Gltf()
    mesh = g.mesh(g.primitive(), g.primitive(TETRAHEDRON + 1))
    g.node(mesh=mesh, name="left")
    g.node(mesh=mesh, name="right")
    scene = load(g)
    assert [(i.mesh, i.object, i.name) for i in scene.instances] == [(0, 0, "left"), (1, 0, "left"), (0, 1, "right"), (1, 1, "right")]


def test_only_the_default_scene_is_loaded(load):
    g = one_node()
    g.node(mesh=0, translation=[1, 0, 0])
    g.json["scenes"], g.json["scene"] = [{"nodes": [0]}, {"nodes": [1], "name": "second"}], 1
    with pytest.warns(LuxelWarning, match="of 2 scenes, scene 1 is loaded"):
        scene = load(g)
    assert scene.name == "second"
    assert scene.instances[0].world_from_mesh[0, 3] == 1


@pytest.mark.parametrize(
    ("dtype", "expected"),
    [("i1", [-1, -1, 0, 1]), ("u1", [128 / 255, 129 / 255, 0, 127 / 255]), ("i2", [-1, -1, 0, 1]), ("u2", None), ("f4", None)],
)
def test_normalised_components(load, dtype, expected):
    g = Gltf()
    limits = np.iinfo(dtype) if dtype != "f4" else None
    values = (
        [limits.min, -limits.max, 0, limits.max]
        if dtype[0] == "i"
        else [128, 129, 0, 127]
        if dtype == "u1"
        else [0, 1, 65535 if dtype == "u2" else 0.5, 0]
    )
    uv = np.array([values, values]).T.astype(dtype)
    scene = load(_with(g, TEXCOORD_0=g.accessor(uv, normalized=dtype != "f4")))
    wanted = expected or (uv / (65535 if dtype == "u2" else 1)).tolist()
    assert np.allclose(scene.meshes[0].texcoords, np.array(wanted).reshape(4, -1) * np.ones((1, 2)), atol=1e-6)


def _with(g, **attributes):
    """`g` with a mesh of smooth normals, so that vertices stay as they are, and more attributes."""
    normals = g.accessor(np.tile(np.float32([0, 0, 1]), (4, 1)))
    g.node(mesh=g.mesh(g.primitive(NORMAL=normals, **attributes)))
    return g


def test_quantized_positions(load):
    g = Gltf()
    g.json["extensionsUsed"] = g.json["extensionsRequired"] = ["KHR_mesh_quantization"]
    view = g.view(np.pad((TETRAHEDRON * 100).astype(np.int16), ((0, 0), (0, 1))).tobytes(), byteStride=8)
    position = g.append("accessors", {"bufferView": view, "componentType": 5122, "type": "VEC3", "count": 4})
    normals = g.view(np.pad(np.tile(np.int8([0, 0, 127]), (4, 1)), ((0, 0), (0, 1))).tobytes(), byteStride=4)
    normal = g.append("accessors", {"bufferView": normals, "componentType": 5120, "type": "VEC3", "count": 4, "normalized": True})
    g.node(mesh=g.mesh({"attributes": {"POSITION": position, "NORMAL": normal}, "indices": g.accessor(FACES.astype(np.uint8).reshape(-1))}))
    mesh = load(g).meshes[0]
    assert np.array_equal(mesh.positions, TETRAHEDRON * 100)
    assert np.allclose(mesh.normals, [0, 0, 1])


def test_interleaved_attributes(load):
    g = Gltf()
    rows = np.zeros(4, [("p", "<f4", 3), ("n", "<f4", 3), ("uv", "<u2", 2)])
    rows["p"], rows["n"], rows["uv"] = TETRAHEDRON, [0, 1, 0], [[0, 65535]] * 4
    view = g.view(rows.tobytes(), byteStride=28)
    at = {
        "POSITION": g.append("accessors", {"bufferView": view, "componentType": 5126, "type": "VEC3", "count": 4}),
        "NORMAL": g.append("accessors", {"bufferView": view, "byteOffset": 12, "componentType": 5126, "type": "VEC3", "count": 4}),
        "TEXCOORD_0": g.append(
            "accessors", {"bufferView": view, "byteOffset": 24, "componentType": 5123, "type": "VEC2", "count": 4, "normalized": True}
        ),
    }
    g.node(mesh=g.mesh({"attributes": at, "indices": g.accessor(FACES.astype(np.uint32).reshape(-1))}))
    mesh = load(g).meshes[0]
    assert np.array_equal(mesh.positions, TETRAHEDRON)
    assert np.array_equal(mesh.normals, np.tile([0, 1, 0], (4, 1)))
    assert np.array_equal(mesh.texcoords, np.tile([0, 1], (4, 1)))


@pytest.mark.parametrize("base", [True, False])
def test_sparse_accessors(load, base):
    g = Gltf()
    rows, values = g.view(np.uint8([1, 3]).tobytes()), g.view(np.float32([[7, 7, 7], [8, 8, 8]]).tobytes())
    sparse = {"count": 2, "indices": {"bufferView": rows, "componentType": 5121}, "values": {"bufferView": values}}
    position = {"componentType": 5126, "type": "VEC3", "count": 4, "sparse": sparse}
    if base:
        position["bufferView"] = g.view(TETRAHEDRON.tobytes())
    number = g.append("accessors", position)
    g.node(mesh=g.mesh({"attributes": {"POSITION": number}, "indices": g.accessor(FACES.astype(np.uint16).reshape(-1))}))
    expected = TETRAHEDRON.copy() if base else np.zeros((4, 3), np.float32)
    expected[[1, 3]] = [[7] * 3, [8] * 3]
    assert np.array_equal(load(g, normals=False).meshes[0].positions, expected)


@pytest.mark.parametrize(
    ("mode", "indices", "expected"),
    [
        (4, None, [[0, 1, 2]]),
        (5, None, [[0, 1, 2], [1, 3, 2]]),
        (6, None, [[0, 1, 2], [0, 2, 3]]),
        (5, [0, 1, 2, 2, 3, 3, 1, 0], [[0, 1, 2], [3, 0, 1]]),
        (6, [0, 1, 1, 2, 3], [[0, 1, 2], [0, 2, 3]]),
    ],
)
def test_strips_fans_and_no_indices(load, mode, indices, expected):
    g = Gltf()
    g.node(mesh=g.mesh(g.primitive(TETRAHEDRON[: 3 if mode == 4 else 4], indices) | {"mode": mode}))
    assert load(g, normals=False).meshes[0].triangles.tolist() == expected


@pytest.mark.parametrize("mode", [0, 1, 2, 3])
def test_points_and_lines_are_dropped_and_said(load, mode):
    g = Gltf()
    g.node(mesh=g.mesh(g.primitive() | {"mode": mode}, g.primitive()))
    with pytest.warns(LuxelWarning, match="mesh 0, primitive 0: (points|lines) are dropped"):
        assert len(load(g).meshes) == 1


def test_materials_have_the_defaults_of_the_specification(load):
    g = one_node()
    scene = load(g)
    material = scene.materials[scene.meshes[0].material]
    assert (material.base_color, material.metallic, material.roughness, material.shading) == ((1, 1, 1, 1), 1, 1, "pbr")
    assert (material.alpha_mode, material.alpha_cutoff, material.double_sided) == ("OPAQUE", 0.5, False)


def test_materials(load, tmp_path):
    (tmp_path / "a picture.png").write_bytes(png(value=10))
    g = Gltf()
    g.json["images"] = [{"uri": "a%20picture.png"}, {"uri": data_uri(png(3, 4, 99, 4), "image/png")}]
    g.json["samplers"] = [{"wrapS": 33071, "wrapT": 33648, "minFilter": 9729, "magFilter": 9729}]
    g.json["textures"] = [{"source": 0, "sampler": 0}, {"source": 1}]
    g.json["extensionsUsed"] = ["KHR_texture_transform", "KHR_materials_emissive_strength", "MOZ_lightmap", "KHR_materials_unlit"]
    transform = {"KHR_texture_transform": {"offset": [0.1, 0.2], "rotation": 0.3, "scale": [4, 5], "texCoord": 1}}
    pbr = {"baseColorFactor": [0.1, 0.2, 0.3, 0.4], "metallicFactor": 0.5, "roughnessFactor": 0.6}
    pbr |= {"baseColorTexture": {"index": 0, "extensions": transform}, "metallicRoughnessTexture": {"index": 1, "texCoord": 1}}
    g.json["materials"] = [
        {
            "name": "all",
            "pbrMetallicRoughness": pbr,
            "normalTexture": {"index": 0, "scale": 0.7},
            "occlusionTexture": {"index": 0, "strength": 0.8},
            "emissiveTexture": {"index": 1},
            "emissiveFactor": [1, 0.5, 0],
            "alphaMode": "MASK",
            "alphaCutoff": 0.9,
            "doubleSided": True,
            "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 10}, "MOZ_lightmap": {"index": 1, "texCoord": 1, "intensity": 3}},
        },
        {"extensions": {"KHR_materials_unlit": {}}},
    ]
    g.node(mesh=g.mesh(g.primitive() | {"material": 0}))
    scene = load(g)
    m = scene.materials[0]
    assert (m.name, m.base_color, m.metallic, m.roughness, m.emissive) == ("all", (0.1, 0.2, 0.3, 0.4), 0.5, 0.6, (10, 5, 0))
    assert (m.normal_scale, m.occlusion_strength, m.alpha_mode, m.alpha_cutoff, m.double_sided) == (0.7, 0.8, "MASK", 0.9, True)
    assert scene.materials[1].shading == "unlit"
    base, data = m.base_color_texture, m.normal_texture
    assert (base.offset, base.rotation, base.scale, base.texcoord) == ((0.1, 0.2), 0.3, (4, 5), 1)
    assert base.texture != data.texture  # one image, as colour and as data
    assert [scene.textures[r.texture].srgb for r in (base, data, m.metallic_roughness_texture, m.emissive_texture)] == [True, False, False, True]
    assert data.texture == m.occlusion_texture.texture
    assert (m.lightmap_texture.texcoord, m.lightmap_scale, scene.textures[m.lightmap_texture.texture].srgb) == (1, 3, False)
    texture = scene.textures[base.texture]
    assert (texture.wrap, texture.filter, texture.image.shape, texture.image.dtype) == (("clamp", "mirror"), "bilinear", (2, 2, 3), np.uint8)
    assert (texture.image == 10).all()
    assert scene.textures[m.emissive_texture.texture].image.shape == (4, 3, 4)
    assert scene.textures[m.emissive_texture.texture].filter == "trilinear"


def test_colors(load):
    g = Gltf()
    color = g.accessor(np.uint16([[65535, 0, 0]] * 4), normalized=True)
    assert np.array_equal(load(_with(g, COLOR_0=color)).meshes[0].colors, [[1, 0, 0, 1]] * 4)


def test_cameras_and_lights_stand_where_their_nodes_are(load):
    g = Gltf()
    g.json["cameras"] = [
        {"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1, "zfar": 50, "aspectRatio": 1.5}},
        {"type": "orthographic", "orthographic": {"xmag": 3, "ymag": 2, "znear": 0, "zfar": 9}},
    ]
    spot = {"type": "spot", "color": [1, 0.5, 0], "intensity": 40, "range": 7, "spot": {"innerConeAngle": 0.2, "outerConeAngle": 0.4}}
    g.json["extensions"] = {"KHR_lights_punctual": {"lights": [spot, {"type": "directional"}]}}
    g.json["extensionsUsed"] = ["KHR_lights_punctual"]
    g.node(children=[1, 2], scale=[2, 2, 2], translation=[0, 1, 0])
    g.node(camera=0, translation=[1, 0, 0], rotation=[0, 1, 0, 0], extensions={"KHR_lights_punctual": {"light": 0}})
    g.node(camera=1, extensions={"KHR_lights_punctual": {"light": 1}})
    scene = load(g)
    first, second = scene.cameras
    assert np.allclose(first.world_from_camera, [[-1, 0, 0, 2], [0, 1, 0, 1], [0, 0, -1, 0], [0, 0, 0, 1]])
    assert (first.yfov, first.near, first.far, first.aspect) == (0.8, 0.1, 50, 1.5)
    assert (second.yfov, second.height, second.aspect, second.near, second.far) == (None, 4, 1.5, 0, 9)
    light = scene.lights[0]
    assert (light.kind, light.color, light.intensity, light.range, light.inner_cone, light.outer_cone) == ("spot", (1, 0.5, 0), 40, 7, 0.2, 0.4)
    assert np.allclose(light.world_from_light, first.world_from_camera)
    assert (scene.lights[1].kind, scene.lights[1].intensity) == ("directional", 1)


def test_extensions(load):
    g = one_node()
    g.json["extensionsUsed"] = ["KHR_materials_sheen"]
    with pytest.warns(LuxelWarning, match="the extension KHR_materials_sheen is ignored"):
        load(g)
    g.json["extensionsRequired"] = ["KHR_draco_mesh_compression"]
    with pytest.raises(UnsupportedError, match=r"scene.gltf: requires the extension KHR_draco_mesh_compression"):
        load(g)


def test_missing_files_are_named(load):
    g = one_node()
    g.json["buffers"] = [{"byteLength": len(g.data), "uri": "../nowhere/mesh.bin"}]
    with pytest.raises(FileError, match=r"scene.gltf, buffer 0: cannot read .*nowhere/mesh.bin"):
        load(g)
    g = one_node()
    g.json["images"], g.json["textures"] = [{"uri": "nowhere.png"}], [{"source": 0}]
    g.json["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
    with pytest.warns(LuxelWarning, match=r"scene.gltf, image 0: cannot read .*nowhere.png.*the texture is left out"):
        scene = load(g)
    assert scene.materials[0].base_color_texture is None


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda j: j["accessors"][0].update(count=9), r"accessor 0: count 9 needs 108 bytes from byte 0 of a buffer view of 48"),
        (lambda j: j["accessors"][0].update(type="VEC7"), r"accessor 0: type: expected VEC3, got 'VEC7'"),
        (lambda j: j["accessors"][0].update(componentType=1), r"accessor 0: componentType: expected one of .*, got 1"),
        (lambda j: j["bufferViews"][0].update(byteOffset=10**9), r"buffer view 0: bytes 1000000000 .. 1000000048 of a buffer of"),
        (lambda j: j["bufferViews"][0].update(byteOffset=-4), r"buffer view 0: byteOffset: expected an integer in 0.."),
        (lambda j: j["nodes"][0].update(mesh=4), r"node 0: names mesh 4, the file has 1"),
        (lambda j: j["nodes"][0].update(rotation=[0, 0, 0, 0]), r"node 0: rotation: expected a unit quaternion"),
        (lambda j: j.update(nodes="abc"), r"x.gltf: nodes: expected a list, got \"abc\""),
        (lambda j: j.update(meshes=[7]), r"mesh 0: expected an object, got 7"),
        (lambda j: j["asset"].update(version="1.0"), r"x.gltf: glTF version 1.0; luxel reads 2.0"),
    ],
)
def test_faults_are_named(load, tmp_path, change, message):
    g = one_node()
    g.write(tmp_path / "x.gltf")
    change(g.json)
    (tmp_path / "x.gltf").write_text(json.dumps(g.json))
    with pytest.raises(FileError, match=message):
        luxel.io.load(tmp_path / "x.gltf")


def test_morph_targets_are_added_at_their_weights(load):
    g = Gltf()
    primitive = g.primitive() | {"targets": [{"POSITION": g.accessor(np.full((4, 3), v, np.float32))} for v in (1, 10)]}
    mesh = g.mesh(primitive, weights=[0.5, 0])
    g.node(mesh=mesh)
    g.node(mesh=mesh, weights=[0, 2])
    scene = load(g, normals=False)
    assert np.array_equal(scene.meshes[scene.instances[0].mesh].positions, TETRAHEDRON + 0.5)
    assert np.array_equal(scene.meshes[scene.instances[1].mesh].positions, TETRAHEDRON + 20)


def test_skins_are_applied_in_their_pose(load):
    g = Gltf()
    joints = g.accessor(np.uint8([[0, 1, 0, 0]] * 4))
    weights = g.accessor(np.float32([[1, 0, 0, 0], [0, 1, 0, 0], [0.5, 0.5, 0, 0], [0.5, 0.5, 0, 0]]))
    normal = g.accessor(np.tile(np.float32([1, 0, 0]), (4, 1)))
    bind = g.accessor(np.stack([np.eye(4, dtype=np.float32).reshape(16)] * 2))
    g.node(mesh=g.mesh(g.primitive(NORMAL=normal, JOINTS_0=joints, WEIGHTS_0=weights)), skin=0, translation=[99, 0, 0])
    g.node(translation=[0, 0, 5])
    g.node(rotation=[0, 0, np.sqrt(0.5), np.sqrt(0.5)])
    g.json["skins"] = [{"joints": [1, 2], "inverseBindMatrices": bind}]
    scene = load(g)
    mesh = scene.meshes[scene.instances[0].mesh]
    assert np.array_equal(scene.instances[0].world_from_mesh, np.eye(4))
    assert np.allclose(mesh.positions, [[0, 0, 5], [0, 1, 0], [-0.5, 0.5, 2.5], [0, 0, 3.5]], atol=1e-6)
    assert np.allclose(mesh.normals[:2], [[1, 0, 0], [0, 1, 0]], atol=1e-6)


def test_gpu_instancing(load):
    g = Gltf()
    places = g.accessor(np.float32([[1, 0, 0], [2, 0, 0], [3, 0, 0]]))
    g.node(mesh=g.mesh(g.primitive()), extensions={"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": places}}})
    g.json["extensionsUsed"] = g.json["extensionsRequired"] = ["EXT_mesh_gpu_instancing"]
    assert [i.world_from_mesh[0, 3] for i in load(g).instances] == [1, 2, 3]


def _packed(g, data: bytes, mode, count, stride, length, **more):
    """A buffer view compressed by EXT_meshopt_compression, with a fallback buffer that is not there."""
    view = g.view(data)
    source = g.json["bufferViews"][view]
    packed = {"buffer": 0, "byteOffset": source["byteOffset"], "byteLength": len(data), "mode": mode, "count": count, "byteStride": stride, **more}
    g.json["bufferViews"][view] = {"buffer": 1, "byteLength": length, "extensions": {"EXT_meshopt_compression": packed}}
    if mode == "ATTRIBUTES":
        g.json["bufferViews"][view]["byteStride"] = stride
    return view


def _meshopt_file(mode="TRIANGLES", index_dtype="<u2"):
    meshoptimizer = pytest.importorskip("meshoptimizer")
    g = Gltf()
    g.json["extensionsUsed"] = g.json["extensionsRequired"] = ["EXT_meshopt_compression"]
    data = bytes(meshoptimizer.encode_vertex_buffer(TETRAHEDRON, 4, 12))
    position = _packed(g, data, "ATTRIBUTES", 4, 12, 48)
    encode = meshoptimizer.encode_index_buffer if mode == "TRIANGLES" else meshoptimizer.encode_index_sequence
    indices = _packed(g, bytes(encode(FACES.reshape(-1).astype(np.uint32), 12, 4)), mode, 12, int(index_dtype[-1]), 12 * int(index_dtype[-1]))
    primitive = {
        "attributes": {"POSITION": g.append("accessors", {"bufferView": position, "componentType": 5126, "type": "VEC3", "count": 4})},
        "indices": g.append(
            "accessors", {"bufferView": indices, "componentType": 5123 if index_dtype == "<u2" else 5125, "type": "SCALAR", "count": 12}
        ),
    }
    g.node(mesh=g.mesh(primitive))
    return g


def _with_buffers(g):
    fallback = {"byteLength": 4096, "extensions": {"EXT_meshopt_compression": {"fallback": True}}}
    g.json["buffers"] = [{"byteLength": len(g.data), "uri": data_uri(bytes(g.data))}, fallback]
    return g


@pytest.mark.parametrize("mode", ["TRIANGLES", "INDICES"])
@pytest.mark.parametrize("index_dtype", ["<u2", "<u4"])
def test_meshopt(load, mode, index_dtype):
    mesh = load(_with_buffers(_meshopt_file(mode, index_dtype)), normals=False).meshes[0]
    assert np.array_equal(mesh.positions, TETRAHEDRON)
    # The codec may turn a triangle around its corners, never flip it.
    turned = [min(t[k:] + t[:k] for k in range(3)) for t in mesh.triangles.tolist()]
    assert sorted(turned) == sorted(min(t[k:] + t[:k] for k in range(3)) for t in FACES.tolist())


def test_meshopt_filters(load):
    meshoptimizer = pytest.importorskip("meshoptimizer")
    g = _meshopt_file()
    # Octahedral, 8 bits: x, y on the octahedron, 127 for one, and an unused byte.
    octahedral = np.int8([[127, 0, 127, 0], [0, 127, 127, 0], [0, 0, 127, 0], [-127, 0, 127, 0]])
    packed = bytes(meshoptimizer.encode_vertex_buffer(octahedral.view(np.uint8), 4, 4))
    view = _packed(g, packed, "ATTRIBUTES", 4, 4, 16, filter="OCTAHEDRAL")
    normal = g.append("accessors", {"bufferView": view, "componentType": 5120, "type": "VEC3", "count": 4, "normalized": True})
    # Exponential: 24 bits of mantissa, 8 of exponent; 3 * 2^-1 and -1 * 2^2.
    exponential = np.array([[(-1 & 0xFF) << 24 | 3, 2 << 24 | (-1 & 0xFFFFFF)]] * 4, np.uint32)
    packed = bytes(meshoptimizer.encode_vertex_buffer(exponential.view(np.uint8), 4, 8))
    view = _packed(g, packed, "ATTRIBUTES", 4, 8, 32, filter="EXPONENTIAL")
    uv = g.append("accessors", {"bufferView": view, "componentType": 5126, "type": "VEC2", "count": 4})
    g.json["meshes"][0]["primitives"][0]["attributes"] |= {"NORMAL": normal, "TEXCOORD_0": uv}
    mesh = load(_with_buffers(g)).meshes[0]
    assert np.allclose(mesh.normals, [[1, 0, 0], [0, 1, 0], [0, 0, 1], [-1, 0, 0]], atol=0.01)
    assert np.array_equal(mesh.texcoords, [[1.5, -4]] * 4)


@pytest.mark.parametrize("key", ["count", "byteStride", "mode", "filter", "byteLength", "byteOffset", "buffer"])
@pytest.mark.parametrize("value", [0, 1, 3, 5, 256, 10**6, 2**31 - 1, "NONE", "OCTAHEDRAL", "QUATERNION", "x"])
def test_meshopt_faults_are_errors(load, key, value):
    g = _with_buffers(_meshopt_file())
    for view in g.json["bufferViews"]:
        packed = view["extensions"]["EXT_meshopt_compression"]
        packed[key] = value
        if key in ("count", "byteStride") and isinstance(value, int):
            view["byteLength"] = packed["count"] * packed["byteStride"]
    if (key, value) == ("filter", "NONE") or (key, value) in (("buffer", 0), ("byteOffset", 0)):
        return
    with pytest.raises(FileError, match=r"scene.gltf, "):
        load(g)


def test_meshopt_broken_data_is_an_error_or_loads(load):
    g = _meshopt_file()
    rng = np.random.default_rng(3)
    whole = bytes(g.data)
    failures = 0
    for _ in range(200):
        g.data = bytearray(whole)
        for at in rng.integers(0, len(whole), 3):
            g.data[at] = rng.integers(0, 256)
        try:
            with np.errstate(all="ignore"):
                import warnings

                with warnings.catch_warnings():
                    warnings.simplefilter("ignore", LuxelWarning)
                    load(_with_buffers(g))
        except FileError:
            failures += 1
    assert failures > 20


def test_sixteen_bit_and_palette_pictures(load, tmp_path):
    from PIL import Image

    Image.fromarray(np.full((2, 2), 32768, np.uint16)).save(tmp_path / "deep.png")
    palette = Image.new("P", (2, 2), 1)
    palette.putpalette([0, 0, 0, 10, 20, 30])
    palette.save(tmp_path / "palette.png")
    g = one_node()
    g.json["images"] = [{"uri": "deep.png"}, {"uri": "palette.png"}]
    g.json["textures"] = [{"source": 0}, {"source": 1}]
    pbr = {"baseColorTexture": {"index": 0}, "metallicRoughnessTexture": {"index": 0}}
    g.json["materials"] = [{"pbrMetallicRoughness": pbr, "emissiveTexture": {"index": 1}}]
    scene = load(g)
    colour, data, indexed = (scene.textures[k].image for k in range(3))
    value = 32768 / 65535
    assert colour.dtype == data.dtype == np.float32
    assert np.allclose(colour, linear_from_srgb(np.float32(value)))
    assert np.allclose(data, value)
    assert (indexed == [10, 20, 30]).all()


def test_glb_header_faults(tmp_path):
    path = full_gltf().write(tmp_path / "x.glb")
    data = path.read_bytes()
    for broken, message in (
        (data[:4] + struct.pack("<I", 1) + data[8:], "GLB version 1"),
        (data[:8] + struct.pack("<I", len(data) + 4) + data[12:], f"the header says {len(data) + 4} bytes"),
        (data[:12] + struct.pack("<I", 10**6) + data[16:], "the chunk at byte 12 says 1000000 bytes"),
        (data[:16] + b"NOPE" + data[20:], "without a JSON chunk"),
    ):
        path.write_bytes(broken)
        with pytest.raises(FileError, match=message):
            luxel.io.load(path)
