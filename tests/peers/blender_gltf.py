"""Exports a scene from Blender as GLB, renders the file as it is, and compares with Cycles' picture of the same scene.

    python3.11 -m venv /tmp/venv && /tmp/venv/bin/pip install bpy numpy
    /tmp/venv/bin/python tests/peers/blender_gltf.py --binary target/release/manylight

No part of `cargo test`. Prints the ratio of mean radiance for each kind of light alone; exit code 1 if one is off by more
than 5 %.
"""

import argparse
import math
import pathlib
import subprocess
import sys
import tempfile

import bpy
import numpy

WIDTH, HEIGHT = 96, 54


def material(name, colour, roughness, metallic=0.0, image=None):
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    nodes, links = made.node_tree.nodes, made.node_tree.links
    principled = nodes["Principled BSDF"]
    principled.inputs["Base Color"].default_value = (*colour, 1)
    principled.inputs["Roughness"].default_value = roughness
    principled.inputs["Metallic"].default_value = metallic
    if image:
        texture = nodes.new("ShaderNodeTexImage")
        texture.image = image
        texture.interpolation = "Linear"
        links.new(texture.outputs["Color"], principled.inputs["Base Color"])
    return made, principled


def checker(path):
    """A picture of grey and orange squares, in sRGB."""
    size = 64
    image = bpy.data.images.new("checker", size, size)
    y, x = numpy.mgrid[:size, :size]
    squares = ((x // 8 + y // 8) % 2)[..., None]
    pixels = numpy.where(squares, [0.8, 0.4, 0.1, 1.0], [0.3, 0.3, 0.3, 1.0])
    image.pixels = pixels.astype(numpy.float32).ravel()
    image.filepath_raw, image.file_format = str(path), "PNG"
    image.save()
    return image


def room(folder):
    """A floor, a wall, a turned box, two instances of a ball, and a camera; returns the lights, hidden, by name."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.world = bpy.data.worlds.new("black")
    scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0, 0, 0, 1)

    def put(add, look, **place):
        add(**place)
        thing = bpy.context.object
        thing.data.materials.append(look)
        return thing

    floor, _ = material("floor", (1, 1, 1), 0.9, image=checker(folder / "checker.png"))
    put(bpy.ops.mesh.primitive_plane_add, floor, size=8)
    wall, _ = material("wall", (0.2, 0.4, 0.7), 0.8)
    put(bpy.ops.mesh.primitive_plane_add, wall, size=8, location=(0, 3, 2), rotation=(math.pi / 2, 0, 0))
    metal, _ = material("metal", (0.9, 0.7, 0.3), 0.4, metallic=1.0)
    box = put(bpy.ops.mesh.primitive_cube_add, metal, size=1.2, location=(-1.2, 0.5, 0.7), rotation=(0.1, 0.2, 0.6))
    box.scale = (1, 0.7, 1.4)
    red, _ = material("red", (0.7, 0.1, 0.1), 0.5)
    ball = put(bpy.ops.mesh.primitive_uv_sphere_add, red, radius=0.6, location=(0.9, 0.2, 0.6))
    bpy.ops.object.shade_smooth()
    again = bpy.data.objects.new("again", ball.data)
    again.location, again.scale = (2.0, 1.5, 0.9), (1.5, 1.5, 1.5)
    scene.collection.objects.link(again)

    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.location, camera.rotation_euler = (0.3, -6, 2.2), (math.radians(78), 0, math.radians(2))
    scene.collection.objects.link(camera)
    scene.camera = camera

    lights = {}
    for kind, energy, place, turn in [
        ("POINT", 300, (0.5, -1.5, 3), (0, 0, 0)),
        ("SPOT", 900, (-2, -2, 3.5), (math.radians(35), 0, math.radians(-45))),
        ("SUN", 3, (0, 0, 5), (math.radians(40), math.radians(20), 0)),
    ]:
        data = bpy.data.lights.new(kind, kind)
        data.energy, data.color = energy, (1.0, 0.9, 0.7)
        if kind == "SUN":
            data.angle = 0
        else:
            data.shadow_soft_size = 0
        if kind == "SPOT":
            data.spot_size, data.spot_blend = math.radians(60), 0.3
        lights[kind.lower()] = bpy.data.objects.new(kind, data)
        lights[kind.lower()].location, lights[kind.lower()].rotation_euler = place, turn
    glow, principled = material("glow", (0, 0, 0), 1.0)
    principled.inputs["Emission Color"].default_value = (1.0, 0.8, 0.6, 1)
    principled.inputs["Emission Strength"].default_value = 12
    lamp = put(bpy.ops.mesh.primitive_plane_add, glow, size=0.8, location=(1.0, -1, 3.2), rotation=(math.pi, 0, 0))
    scene.collection.objects.unlink(lamp)
    lights["emissive"] = lamp
    return lights


def cycles(path, spp, seed):
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device, scene.cycles.samples, scene.cycles.seed = "CPU", spp, seed
    scene.cycles.use_adaptive_sampling = scene.cycles.use_denoising = False
    scene.cycles.pixel_filter_type, scene.cycles.filter_width = "BOX", 1.0
    scene.cycles.max_bounces = scene.cycles.diffuse_bounces = scene.cycles.glossy_bounces = 5
    scene.cycles.sample_clamp_indirect = 0
    scene.cycles.blur_glossy = 0
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = WIDTH, HEIGHT, 100
    scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR", "32"
    scene.render.threads_mode, scene.render.threads = "FIXED", 1
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)


def pixels(path):
    """Linear RGB by Blender's reader."""
    image = bpy.data.images.load(str(path))
    image.colorspace_settings.name = "Non-Color"
    flat = numpy.empty(WIDTH * HEIGHT * 4, dtype=numpy.float32)
    image.pixels.foreach_get(flat)
    bpy.data.images.remove(image)
    return flat.reshape(HEIGHT, WIDTH, 4)[..., :3].astype(numpy.float64)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--binary", default="target/release/manylight")
    parser.add_argument("--spp", type=int, default=64)
    arguments = parser.parse_args()
    worst = 0.0
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        for kind, light in room(folder).items():
            bpy.context.scene.collection.objects.link(light)
            glb = folder / f"{kind}.glb"
            bpy.ops.export_scene.gltf(filepath=str(glb), export_format="GLB", export_cameras=True, export_lights=True)
            cycles(folder / f"{kind}-cycles.exr", arguments.spp, 1)
            command = [
                arguments.binary, "render", glb, "--size", f"{WIDTH}x{HEIGHT}", "--spp", str(arguments.spp), "--out", folder,
                "--quiet", "--set", "lights=AsGiven", "--set", "integrator=Path(max_bounces: 5)", "--threads", "1",
            ]
            subprocess.run(command, check=True)
            ours, theirs = pixels(folder / f"{kind}.exr"), pixels(folder / f"{kind}-cycles.exr")
            ratio = ours.mean() / theirs.mean()
            off = numpy.sqrt(((ours - theirs) ** 2 / (theirs**2 + 0.01 * theirs.mean() ** 2)).mean())
            print(f"{kind}: mean {ratio:.3f} of Cycles', typical pixel off by {off:.3f}")
            worst = max(worst, abs(ratio - 1))
            bpy.context.scene.collection.objects.unlink(light)
    sys.exit("error: a mean is off by more than 5 %" if worst > 0.05 else 0)


main()
