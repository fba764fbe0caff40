"""Runs inside Blender's Python: bakes the diffuse light of a scene with Cycles. Called by `blender.py`.

    python blender_bake.py SCENE.glb OUT.npz WIDTH HEIGHT THREADS SAMPLES...

Every material becomes plain diffuse with its colour and emission, without textures. OUT.npz has `seconds` and, for each number of samples, `light`:
(k, h, w, 3) float32, radiance off white surfaces, row 0 at the top.
"""

import sys
import time

import bpy
import numpy as np


def main() -> None:
    scene, out, width, height, threads, *samples = sys.argv[1:]
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=scene)
    for other in [thing for thing in bpy.data.objects if thing.type != "MESH"]:
        bpy.data.objects.remove(other)
    image = bpy.data.images.new("light", int(width), int(height), alpha=False, float_buffer=True)
    for material in bpy.data.materials:
        make_diffuse(material, image)
    join()
    settings = bpy.context.scene
    settings.render.engine = "CYCLES"
    settings.render.threads_mode, settings.render.threads = "FIXED", int(threads)
    cycles = settings.cycles
    cycles.device, cycles.use_adaptive_sampling, cycles.use_denoising = "CPU", False, False
    cycles.max_bounces = cycles.diffuse_bounces = 64
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
    bake(1)  # builds what is built once
    seconds, pages = [], []
    for count in samples:
        start = time.perf_counter()
        bake(int(count))
        seconds.append(time.perf_counter() - start)
        pixels = np.empty(int(width) * int(height) * 4, np.float32)
        image.pixels.foreach_get(pixels)
        pages.append(pixels.reshape(int(height), int(width), 4)[::-1, :, :3])
    np.savez(out, seconds=seconds, light=np.array(pages))


def make_diffuse(material, image) -> None:  # type: ignore[no-untyped-def]
    """Replace the surface by colour and emission alone, and let the bake go to `image`."""
    nodes, links = material.node_tree.nodes, material.node_tree.links
    old = next((node for node in nodes if node.type == "BSDF_PRINCIPLED"), None)
    output = next(node for node in nodes if node.type == "OUTPUT_MATERIAL")
    diffuse = nodes.new("ShaderNodeBsdfDiffuse")
    surface = diffuse.outputs[0]
    if old is not None:
        diffuse.inputs["Color"].default_value = old.inputs["Base Color"].default_value
        glow, strength = old.inputs["Emission Color"].default_value, old.inputs["Emission Strength"].default_value
        if strength > 0 and max(glow[:3]) > 0:
            emission, add = nodes.new("ShaderNodeEmission"), nodes.new("ShaderNodeAddShader")
            emission.inputs["Color"].default_value, emission.inputs["Strength"].default_value = glow, strength
            links.new(surface, add.inputs[0])
            links.new(emission.outputs[0], add.inputs[1])
            surface = add.outputs[0]
    links.new(surface, output.inputs["Surface"])
    target = nodes.new("ShaderNodeTexImage")
    target.image = image
    nodes.active = target


def join() -> None:
    """One object of all meshes, with no texture coordinates but the last, which are the lightmap's."""
    things = list(bpy.data.objects)
    for thing in things:
        layers = thing.data.uv_layers
        while len(layers) > 1:
            layers.remove(layers[0])
        layers[0].name = "lightmap"
        thing.select_set(True)
    bpy.context.view_layer.objects.active = things[0]
    if len(things) > 1:
        bpy.ops.object.join()


def bake(samples: int) -> None:
    bpy.context.scene.cycles.samples = samples
    bpy.ops.object.bake(type="DIFFUSE", pass_filter={"DIRECT", "INDIRECT"}, margin=0, use_clear=True)


if __name__ == "__main__":
    main()
