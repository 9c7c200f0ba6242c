#!/usr/bin/env python3
"""How much sooner a picture under many point lights is clean here than in another renderer: direct light, one thread each.

    pip install bpy OpenEXR          # or mitsuba OpenEXR; in an environment of its own, no part of the tests
    tests/peers/race.py cycles $MANYLIGHT_SCENES/sponza
    tests/peers/race.py mitsuba $MANYLIGHT_SCENES/sponza

Each renderer is compared with a reference of its own, of two halves whose difference says how noisy it is; that noise is
subtracted. The scene is matte, without cut-outs, for all. Seconds are the processor's: what the largest picture took beyond one of a
single sample, by sample, so that loading and building do not count. What each needs to reach the goal is read off between the
two pictures about it in log-log, or from the last one as if its error were noise alone. The renderers take turns. As single bright
pixels near lamps can decide an error, all is told once more without the worst hundredth of the pixels of each picture.
"""

import argparse
import math
import os
import subprocess
import time

import numpy as np

from scene_files import fov_y_deg, pixels, points, triple


def relmse(image, reference):
    """Of all pixels, and without the worst hundredth of them."""
    scale = reference**2 + 0.01 * reference.mean() ** 2
    errors = np.sort(((image - reference) ** 2 / scale).mean(axis=-1).ravel())
    return np.array([errors.mean(), errors[:len(errors) * 99 // 100].mean()])


class Here:
    """manylight with `method`."""

    def __init__(self, given, method):
        self.name = f"manylight, {method}"
        self.given, self.method = given, method
        self.run = os.path.join(given.out, "run.ron")
        open(self.run, "w").write('(scene: "scene/scene.ron", lights: AsGiven, integrator: Direct)\n')

    def render(self, spp, seed):
        name = f"manylight-{self.method}-{seed}-{spp}"
        size = "x".join(map(str, self.given.size))
        before = os.times()
        subprocess.run([self.given.manylight, "render", self.run, "--method", self.method, "--spp", str(spp), "--seed", str(seed),
                        "--size", size, "--threads", "1", "--out", self.given.out, "--name", name, "--quiet"], check=True)
        after = os.times()
        seconds = after.children_user + after.children_system - before.children_user - before.children_system
        return pixels(os.path.join(self.given.out, name + ".exr")), seconds


class Cycles:
    """Blender's renderer on the processor, by its light tree or by each light's power."""

    def __init__(self, given, tree):
        import bpy
        from mathutils import Matrix

        self.name = "Cycles, " + ("light tree" if tree else "lights by power")
        self.given, self.tree = given, tree
        if bpy.data.objects.get("manylight camera"):
            return
        bpy.ops.wm.read_factory_settings(use_empty=True)
        folder = os.path.join(given.out, "scene")
        text = open(os.path.join(folder, "scene.ron")).read()
        obj = next(f for f in os.listdir(folder) if f.endswith(".obj"))
        # Axes that leave coordinates as they are.
        bpy.ops.wm.obj_import(filepath=os.path.join(folder, obj), forward_axis="Y", up_axis="Z")
        for material in bpy.data.materials:
            make_matte(material)
        look = {key: np.array(triple(text, key)) for key in ("origin", "target", "up")}
        back = look["origin"] - look["target"]
        back /= np.linalg.norm(back)
        right = np.cross(look["up"], back)
        right /= np.linalg.norm(right)
        rows = np.stack([right, np.cross(back, right), back, look["origin"]], axis=1)
        camera = bpy.data.objects.new("manylight camera", bpy.data.cameras.new("camera"))
        camera.matrix_world = Matrix([*rows.tolist(), [0, 0, 0, 1]])
        camera.data.sensor_fit = "VERTICAL"
        camera.data.angle = math.radians(fov_y_deg(text))
        camera.data.clip_start, camera.data.clip_end = 1e-3, 1e6
        scene = bpy.context.scene
        scene.collection.objects.link(camera)
        scene.camera = camera
        for point in points(os.path.join(folder, "lights.ron")):
            intensity = triple(point, "intensity")
            light = bpy.data.lights.new("point", "POINT")
            light.shadow_soft_size = 0
            light.color = [x / max(intensity) for x in intensity]
            # Blender's watts are those of light that goes everywhere.
            light.energy = 4 * math.pi * max(intensity)
            placed = bpy.data.objects.new("point", light)
            placed.location = triple(point, "position")
            scene.collection.objects.link(placed)
        scene.render.engine = "CYCLES"
        scene.render.resolution_x, scene.render.resolution_y = given.size
        scene.render.resolution_percentage = 100
        scene.render.threads_mode, scene.render.threads = "FIXED", 1
        scene.render.use_persistent_data = True
        scene.render.image_settings.file_format = "OPEN_EXR"
        scene.render.image_settings.color_depth = "32"
        scene.render.image_settings.color_mode = "RGB"
        cycles = scene.cycles
        cycles.device = "CPU"
        cycles.max_bounces = 0
        cycles.use_adaptive_sampling = cycles.use_denoising = False
        cycles.light_sampling_threshold = 0
        cycles.sample_clamp_direct = 0
        cycles.pixel_filter_type = "BOX"
        scene.render.filter_size = cycles.filter_width = 1

    def render(self, spp, seed):
        import bpy

        scene = bpy.context.scene
        scene.cycles.use_light_tree = self.tree
        scene.cycles.samples, scene.cycles.seed = spp, seed
        path = os.path.join(self.given.out, f"cycles-{int(self.tree)}-{seed}-{spp}.exr")
        scene.render.filepath = path
        before = time.process_time()
        bpy.ops.render.render(write_still=True)
        return pixels(path), time.process_time() - before


def make_matte(material):
    """Kd, times its texture if it has one, as a diffuse surface."""
    nodes, links = material.node_tree.nodes, material.node_tree.links
    base = nodes["Principled BSDF"].inputs["Base Color"]
    image = next((link.from_node.image for link in base.links if link.from_node.type == "TEX_IMAGE"), None)
    kd = list(base.default_value) if image is None else kd_of(material)
    nodes.clear()
    output, diffuse = nodes.new("ShaderNodeOutputMaterial"), nodes.new("ShaderNodeBsdfDiffuse")
    links.new(diffuse.outputs[0], output.inputs["Surface"])
    if image is None:
        diffuse.inputs["Color"].default_value = kd
        return
    texture, product = nodes.new("ShaderNodeTexImage"), nodes.new("ShaderNodeVectorMath")
    texture.image = image
    product.operation = "MULTIPLY"
    product.inputs[1].default_value = kd[:3]
    links.new(texture.outputs["Color"], product.inputs[0])
    links.new(product.outputs[0], diffuse.inputs["Color"])


def kd_of(material):
    """Blender's importer drops Kd where there is a texture."""
    return KD.get(material.name, [1, 1, 1])


KD = {}


class Mitsuba:
    """Mitsuba 3 compiled by LLVM, lights by power."""

    def __init__(self, given):
        import against_mitsuba
        import mitsuba as mi

        self.name = "Mitsuba, lights by power"
        self.given, self.mi = given, mi
        mi.set_variant("llvm_ad_rgb")
        import drjit

        drjit.set_thread_count(1)
        folder = os.path.join(given.out, "scene")
        obj, mtl = (os.path.join(folder, next(f for f in os.listdir(folder) if f.endswith(end))) for end in (".obj", ".mtl"))
        scene = {"type": "scene", "integrator": {"type": "path", "max_depth": 2},
                 "sensor": against_mitsuba.sensor(open(os.path.join(folder, "scene.ron")).read(), given.size)}
        shapes = against_mitsuba.shapes(folder, obj, mtl, False, False)
        scene.update({f"shape{i}": shape for i, shape in enumerate(shapes.values())})
        for i, point in enumerate(points(os.path.join(folder, "lights.ron"))):
            intensity = triple(point, "intensity")
            scene[f"light{i}"] = {"type": "point", "position": triple(point, "position"),
                                  "sampling_weight": sum(intensity),
                                  "intensity": {"type": "rgb", "value": intensity}}
        self.scene = mi.load_dict(scene)

    def render(self, spp, seed):
        before = time.process_time()
        # In passes, since a wavefront holds all of a pass's paths.
        passes = max(1, spp // 64)
        total = sum(np.array(self.mi.render(self.scene, seed=seed * 100_000 + k, spp=spp // passes), dtype=np.float64)
                    for k in range(passes))
        return total / passes, time.process_time() - before


class MitsubaAllLights:
    """Mitsuba 3 compiled by LLVM: a loop over all lights at each point, by its rays and its BSDFs."""

    def __init__(self, given, mitsuba):
        import drjit

        mi = mitsuba.mi
        self.name = "Mitsuba, all lights"
        self.given, self.scene, self.mi, self.dr = given, mitsuba.scene, mi, drjit
        lamps = points(os.path.join(given.out, "scene", "lights.ron"))
        columns = [np.array([triple(lamp, what) for lamp in lamps], dtype=np.float32).T for what in ("position", "intensity")]
        self.positions, self.intensities = mi.Point3f(columns[0]), mi.Color3f(columns[1])
        self.count = len(lamps)

    def render(self, spp, seed):
        before = time.process_time()
        image = sum(self.one_sample(seed * 100_000 + k) for k in range(spp))
        return image / spp, time.process_time() - before

    def one_sample(self, seed):
        mi, dr = self.mi, self.dr
        width, height = self.given.size
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(seed, width * height)
        pixel = dr.arange(mi.UInt32, width * height)
        place = (mi.Vector2f(pixel % width, pixel // width) + sampler.next_2d()) / mi.Vector2f(width, height)
        ray, _ = self.scene.sensors()[0].sample_ray(0, 0.5, place, mi.Point2f(0.5))
        hit = self.scene.ray_intersect(ray)
        bsdf, context = hit.bsdf(ray), mi.BSDFContext()

        def add(i, light):
            position = dr.gather(mi.Point3f, self.positions, i)
            offset = position - hit.p
            dist2 = dr.squared_norm(offset)
            active = hit.is_valid() & ~self.scene.ray_test(hit.spawn_ray_to(position))
            reflected = bsdf.eval(context, hit, hit.to_local(offset * dr.rsqrt(dist2)), active)
            brought = reflected * dr.gather(mi.Color3f, self.intensities, i) / dist2
            return i + 1, light + dr.select(active, brought, 0)

        _, light = dr.while_loop((mi.UInt32(0), mi.Color3f(0)), lambda i, _: i < self.count, add)
        return np.array(light, dtype=np.float64).T.reshape(height, width, 3)


def copy_matte(source, target):
    """The scene without highlights and cut-outs; files that do not change are linked."""
    os.makedirs(target, exist_ok=True)
    for name in os.listdir(source):
        link = os.path.join(target, name)
        if os.path.lexists(link):
            os.remove(link)
        if not name.endswith(".mtl"):
            os.symlink(os.path.abspath(os.path.join(source, name)), link)
            continue
        current = None
        with open(link, "w") as out:
            for line in open(os.path.join(source, name), errors="replace"):
                words = line.split()
                if words[:1] == ["newmtl"]:
                    current = words[1]
                elif words[:1] == ["Kd"]:
                    KD[current] = [float(x) for x in words[1:4]]
                if not words or words[0] not in ("Ks", "map_Ks", "map_d", "d", "map_Bump", "map_bump", "bump"):
                    out.write(line)


def time_to(goal, rows):
    """Seconds to an error of `goal`, from rising seconds and their errors: between two in log-log, or as noise falls, by 1 / seconds."""
    for (t0, e0), (t1, e1) in zip(rows, rows[1:]):
        if e0 >= goal > e1:
            return t0 * (t1 / t0) ** (math.log(goal / e0) / math.log(e1 / e0))
    seconds, error = rows[-1] if rows[-1][1] > goal else rows[0]
    return seconds * error / goal


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("peer", choices=["cycles", "mitsuba"])
    parser.add_argument("folder")
    parser.add_argument("--size", type=int, nargs=2, default=[240, 135])
    parser.add_argument("--goal", type=float, default=1e-2)
    parser.add_argument("--peer-spp", type=int, nargs="+", default=[64, 128, 256, 512, 1024], help="powers of two, rising")
    parser.add_argument("--spp", type=int, nargs="+", default=[2, 4, 8, 16, 32], help="manylight's")
    parser.add_argument("--reference", type=int, default=8, help="times the most samples, in each half")
    parser.add_argument("--manylight", default="target/release/manylight")
    parser.add_argument("--out", default="out/race")
    given = parser.parse_args()
    os.makedirs(given.out, exist_ok=True)
    copy_matte(given.folder, os.path.join(given.out, "scene"))
    ours = [Here(given, method) for method in ("stratified-lightcuts", "stochastic-lightcuts", "all-lights")]
    if given.peer == "cycles":
        peers = [Cycles(given, True), Cycles(given, False)]
        judge = peers[0]
    else:
        peers = [Mitsuba(given)]
        # By power the brightest pixels, near lamps, stay noisy for hours.
        judge = MitsubaAllLights(given, peers[0])
        peers.append(judge)
    ladders = [(racer, given.spp) for racer in ours[:2]] + [(racer, given.peer_spp) for racer in peers]
    # What takes every light has few samples.
    ladders = [(racer, given.spp[:3] if "all" in racer.name else ladder) for racer, ladder in ladders + [(ours[2], given.spp)]]
    references = {}
    for racer, ladder in ladders:
        if racer not in (ours[0], judge):
            continue
        halves = [racer.render(given.reference * ladder[-1], seed)[0] for seed in (101, 102)]
        mean = (halves[0] + halves[1]) / 2
        references[racer] = (mean, relmse(halves[0], mean))
        print(f"reference of {racer.name}: 2 x {given.reference * ladder[-1]} spp, noise {references[racer][1]}", flush=True)
    means = [mean.mean() for mean, _ in references.values()]
    print(f"mean of manylight's reference over {given.peer}'s: {means[0] / means[1]:.4f}")
    found = {racer: [] for racer, _ in ladders}
    idle = {racer: racer.render(1, 1)[1] for racer, _ in ladders}
    for step in range(max(len(ladder) for _, ladder in ladders)):
        for racer, ladder in ladders:
            if step >= len(ladder):
                continue
            image, seconds = racer.render(ladder[step], 1)
            reference, noise = references[ours[0] if racer in ours else judge]
            error = relmse(image, reference) - noise
            found[racer].append((ladder[step], seconds, error))
            print(f"{racer.name}: {ladder[step]} spp, {seconds:.2f} s, relmse {error[0]:.2e}, {error[1]:.2e}", flush=True)
    for which, words in enumerate(("", ", without the worst hundredth")):
        print(f"\nprocessor seconds to relmse {given.goal}{words}, {given.folder}, {given.size[0]}x{given.size[1]}, direct light")
        first = None
        for racer, rows in found.items():
            most, seconds, _ = rows[-1]
            a_sample = (seconds - idle[racer]) / (most - 1)
            needed = time_to(given.goal, [(a_sample * spp, error[which]) for spp, _, error in rows])
            first = first or needed
            print(f"{racer.name:36s} {needed:8.2f} s   {needed / first:6.2f} x")


if __name__ == "__main__":
    main()
