#!/usr/bin/env python3
"""Renders a scene with Mitsuba 3 and with manylight's path tracer, and compares the pictures.

    pip install mitsuba OpenEXR        # in an environment of its own; no part of the tests
    tests/peers/against_mitsuba.py SCENE_FOLDER --lights points --out /tmp/peer

The scene is made matte (Ks 0) for both unless --glossy is given, and its lights are either the file's points or its
emissive triangles. With --glossy, Kd + Ks of an MTL file are a diffuse and a GGX lobe without Fresnel side by side, which
Mitsuba has as a blend of diffuse and roughconductor; its masking and shadowing are uncorrelated where manylight's are
correlated by height, which differs by Λ²: keep to Ns of 30 and more. Each renderer makes two pictures of different seeds, so that
the noise of either is known. Mitsuba chooses lights uniformly: with many of them it needs --peer-spp of several times --spp, or what few
samples hold of the light of rare paths makes its pictures too bright or too dark by more than their halves' difference tells; or
--every N, by which both render under every N-th of the points alone; or --lamp-by-lamp, by which it has nothing to choose.
Where interpolated normals face away from the viewer, as on arches in Sponza, manylight bends them to the visible side and
Mitsuba turns them around: --facets renders by the triangles' own.
SCENE_FOLDER holds scene.ron, one OBJ file and its MTL file. Mitsuba's area
lights shine to one side: each emissive triangle becomes two, a little apart.
"""

import argparse
import os
import re
import subprocess
import time

import mitsuba as mi
import numpy as np

from scene_files import fov_y_deg, pixels, points, triple


def read_mtl(path):
    materials, current = {}, None
    for line in open(path, errors="replace"):
        key, _, rest = line.strip().partition(" ")
        rest = rest.strip()
        if key == "newmtl":
            current = materials.setdefault(rest, {"Kd": None, "Ks": [0, 0, 0], "Ke": [0, 0, 0], "Ns": 1, "map_Kd": None, "map_d": None})
        elif key == "Ns":
            current[key] = float(rest)
        elif key in ("Kd", "Ks", "Ke"):
            numbers = [float(x) for x in rest.split()]
            current[key] = (numbers * 3)[:3]
        elif key in ("map_Kd", "map_d"):
            current[key] = rest.split()[-1].replace("\\", "/")
    return materials


def read_obj(path):
    """Positions, texture coordinates, normals, and corners by material as (position, uv, normal), -1 where absent."""
    table = {"v": [], "vt": [], "vn": []}
    faces, material = {}, ""
    for line in open(path, errors="replace"):
        words = line.split()
        if not words:
            continue
        if words[0] in table:
            table[words[0]].append([float(x) for x in words[1:4]])
        elif words[0] == "usemtl":
            material = line.split(maxsplit=1)[1].strip()
        elif words[0] == "f":
            corners = []
            for word in words[1:]:
                parts = (word.split("/") + ["", ""])[:3]
                counts = [len(table[key]) for key in ("v", "vt", "vn")]
                corners.append([
                    -1 if not p else int(p) - 1 if int(p) > 0 else n + int(p) for p, n in zip(parts, counts)
                ])
            for i in range(1, len(corners) - 1):
                faces.setdefault(material, []).append([corners[0], corners[i], corners[i + 1]])
    return table, faces


def mesh(name, positions, uvs, normals, props):
    """A Mitsuba mesh of unshared vertices."""
    n = len(positions)
    made = mi.Mesh(name, n, n // 3, has_vertex_normals=normals is not None, has_vertex_texcoords=uvs is not None,
                   props=props)
    params = mi.traverse(made)
    params["vertex_positions"] = array_like(params["vertex_positions"], positions, np.float32)
    params["faces"] = array_like(params["faces"], np.arange(n), np.uint32)
    if uvs is not None:
        params["vertex_texcoords"] = array_like(params["vertex_texcoords"], uvs, np.float32)
    if normals is not None:
        params["vertex_normals"] = array_like(params["vertex_normals"], normals, np.float32)
    params.update()
    return made


def array_like(old, numbers, of):
    """`numbers` as an array of the kind that Mitsuba's variant keeps at the place of `old`."""
    flat = np.ascontiguousarray(numbers.ravel().astype(of))
    return flat if isinstance(old, np.ndarray) else type(old)(flat)


def reflection(material, texels):
    """Mitsuba's form of Kd, times `texels` in linear light if there are any, beside Ks; both sides."""
    kd = np.array(material["Kd"] or ([1, 1, 1] if material["map_Kd"] else [0, 0, 0]), dtype=np.float32)
    ks = np.array(material["Ks"], dtype=np.float32)
    # Each part is chosen with a probability, which its reflectance is divided by.
    share = ks.max() / max(ks.max() + kd.max(), 1e-30)
    if share < 1:
        kd = kd / (1 - share)
    if texels is None:
        colour = {"type": "rgb", "value": kd.tolist()}
    else:
        # Mitsuba has the first row at the bottom.
        colour = {"type": "bitmap", "raw": True, "wrap_mode": "repeat",
                  "bitmap": mi.Bitmap(np.ascontiguousarray((texels * kd)[::-1]))}
    bsdf = {"type": "diffuse", "reflectance": colour}
    if share > 0:
        lobe = {"type": "roughconductor", "material": "none", "distribution": "ggx",
                "alpha": (2 / (material["Ns"] + 2)) ** 0.5,
                "specular_reflectance": {"type": "rgb", "value": (ks / share).tolist()}}
        bsdf = lobe if share == 1 else {"type": "blendbsdf", "weight": float(share), "a": bsdf, "b": lobe}
    return {"type": "twosided", "bsdf": bsdf}


def shapes(folder, obj, mtl, emissive, glossy):
    table, faces = read_obj(obj)
    materials = read_mtl(mtl)
    arrays = {key: np.array(rows, dtype=np.float64) for key, rows in table.items()}
    size = np.ptp(arrays["v"], axis=0).max()
    found = {}
    for name, triangles in faces.items():
        material = materials[name]
        corners = np.array(triangles)
        positions = arrays["v"][corners[:, :, 0]]
        edges = np.cross(positions[:, 1] - positions[:, 0], positions[:, 2] - positions[:, 0])
        area = np.linalg.norm(edges, axis=1, keepdims=True)
        keep = area[:, 0] > 0
        corners, positions, facing = corners[keep], positions[keep], (edges / np.maximum(area, 1e-300))[keep]
        if len(corners) == 0:
            continue
        has_uv = (corners[:, :, 1] >= 0).all()
        has_normal = (corners[:, :, 2] >= 0).all()
        uvs = arrays["vt"][corners[:, :, 1]][:, :, :2] if has_uv else None
        normals = arrays["vn"][corners[:, :, 2]] if has_normal else None
        texels = None
        if material["map_Kd"] and has_uv:
            bitmap = mi.Bitmap(os.path.join(folder, material["map_Kd"]))
            texels = np.array(bitmap.convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, srgb_gamma=False))
        if not glossy:
            material["Ks"] = [0, 0, 0]
        bsdf = reflection(material, texels)
        if material["map_d"] and has_uv:
            # Below one half the surface is not there: alpha, or the first channel where there is none.
            texels = np.array(mi.Bitmap(os.path.join(folder, material["map_d"])))
            texels = texels.reshape(*texels.shape[:2], -1)
            opacity = texels[:, :, -1 if texels.shape[2] in (2, 4) else 0]
            there = (opacity >= 128).astype(np.float32)[::-1, :, None]
            bsdf = {"type": "mask", "bsdf": bsdf,
                    "opacity": {"type": "bitmap", "raw": True, "wrap_mode": "repeat", "filter_type": "nearest",
                                "bitmap": mi.Bitmap(np.ascontiguousarray(there))}}
        props = mi.Properties()
        props["bsdf"] = mi.load_dict(bsdf)
        flat = lambda a: None if a is None else a.reshape(len(corners) * 3, -1)
        if emissive and max(material["Ke"]) > 0:
            for sign in (1, -1):
                light = mi.Properties()
                light["bsdf"] = mi.load_dict(bsdf)
                light["emitter"] = mi.load_dict(
                    {"type": "area", "radiance": {"type": "rgb", "value": material["Ke"]}})
                moved = positions + sign * 1e-5 * size * facing[:, None, :]
                # The winding makes the side that shines.
                moved = moved if sign > 0 else moved[:, ::-1]
                found[f"{name}{sign}"] = mesh(name, flat(moved), None, None, light)
        else:
            found[name] = mesh(name, flat(positions), flat(uvs), flat(normals), props)
    return found


def sensor(text, size):
    """The camera of a scene file for a picture of `size`, with a box filter."""
    look = {key: triple(text, key) for key in ("origin", "target", "up")}
    return {
        "type": "perspective", "fov": fov_y_deg(text), "fov_axis": "y",
        "near_clip": 1e-4, "far_clip": 1e6,
        "to_world": mi.ScalarTransform4f().look_at(look["origin"], look["target"], look["up"]),
        "film": {"type": "hdrfilm", "width": size[0], "height": size[1],
                 "rfilter": {"type": "box"}, "pixel_format": "rgb", "component_format": "float32"},
    }


def without_normals(path):
    for line in open(path, errors="replace"):
        words = line.split()
        if words[:1] == ["f"]:
            yield " ".join(["f", *("/".join(corner.split("/")[:2]) for corner in words[1:])]) + "\n"
        elif words[:1] != ["vn"]:
            yield line


def move_lamp(loaded, lamp):
    """Makes the only lamp, light0, the given one."""
    parameters = mi.traverse(loaded)
    for key, name, kind in (("position", "position", mi.Point3f), ("intensity.value", "intensity", mi.Color3f)):
        value = kind(triple(lamp, name))
        if mi.variant() != "scalar_rgb":
            import drjit

            # As a constant it would be compiled into the kernel, anew for each lamp.
            drjit.make_opaque(value)
        parameters["light0." + key] = value
    parameters.update()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder")
    parser.add_argument("--lights", choices=["points", "emissive"], default="points")
    parser.add_argument("--glossy", action="store_true")
    parser.add_argument("--bounces", type=int, default=5)
    parser.add_argument("--size", type=int, nargs=2, default=[128, 128])
    parser.add_argument("--spp", type=int, default=256)
    parser.add_argument("--peer-spp", type=int, help="Mitsuba's; --spp where not given")
    parser.add_argument("--facets", action="store_true", help="without the file's normals")
    parser.add_argument("--lamp-by-lamp", action="store_true", help="Mitsuba lights one point at a time, each with --peer-spp, and adds up")
    parser.add_argument("--every", type=int, default=1, help="of the file's points only every so many-th")
    parser.add_argument("--method", default="stochastic-lightcuts")
    parser.add_argument("--manylight", default="target/release/manylight")
    parser.add_argument("--out", default="out/peer")
    parser.add_argument("--variant", default="scalar_rgb", help="Mitsuba's; llvm_ad_rgb is several times faster where LLVM is")
    given = parser.parse_args()
    mi.set_variant(given.variant)
    peer_spp = given.peer_spp or given.spp
    os.makedirs(given.out, exist_ok=True)
    text = open(os.path.join(given.folder, "scene.ron")).read()
    files = os.listdir(given.folder)
    obj = os.path.join(given.folder, next(f for f in files if f.endswith(".obj")))
    mtl = os.path.join(given.folder, next(f for f in files if f.endswith(".mtl")))
    emissive = given.lights == "emissive"

    # A copy for manylight, matte unless asked otherwise: files that do not change are linked.
    copy = os.path.join(given.out, "scene")
    os.makedirs(copy, exist_ok=True)
    for name in files:
        link = os.path.join(copy, name)
        if os.path.lexists(link):
            os.remove(link)
        source = os.path.abspath(os.path.join(given.folder, name))
        if name == os.path.basename(mtl) and not given.glossy:
            lines = [line for line in open(source, errors="replace") if line.split()[:1] != ["Ks"]]
            open(link, "w").writelines(lines)
        elif name == os.path.basename(obj) and given.facets:
            open(link, "w").writelines(without_normals(source))
        elif name not in ("scene.ron", "lights.ron"):
            os.symlink(source, link)
    lamps = []
    if not emissive:
        lamps = points(os.path.join(given.folder, "lights.ron"))[::given.every]
        open(os.path.join(copy, "lights.ron"), "w").write("[" + ",\n".join(lamps) + "]\n")
    lights = "lights: [Emissive]" if emissive else "lights: [Points(\"lights.ron\")]"
    open(os.path.join(copy, "scene.ron"), "w").write(re.sub(r"lights:\s*\[[^\]]*\]", lights, text))
    run = os.path.join(given.out, "run.ron")
    open(run, "w").write(
        f'(scene: "scene/scene.ron", integrator: Path(max_bounces: {given.bounces}),'
        f' image: (width: {given.size[0]}, height: {given.size[1]}, spp: {given.spp}))\n')
    ours, peers = [[os.path.join(given.out, f"{who}{seed}.exr") for seed in (1, 2)] for who in ("manylight", "mitsuba")]
    for seed in (1, 2):
        subprocess.run([given.manylight, "render", run, "--method", given.method, "--out", given.out,
                        "--name", f"manylight{seed}", "--seed", str(seed), "--quiet"], check=True)

    cut_out = any(material["map_d"] for material in read_mtl(mtl).values())
    scene = {
        "type": "scene",
        # Counts edges: light seen directly is 1, lit by a light 2. Shadow rays of "path" stop at what is cut out.
        "integrator": {"type": "volpath" if cut_out else "path", "max_depth": given.bounces + 2, "rr_depth": 3},
        "sensor": sensor(text, given.size),
    }
    scene.update({f"shape{i}": s for i, s in enumerate(shapes(given.folder, os.path.join(copy, os.path.basename(obj)), mtl, emissive, given.glossy).values())})
    by_lamp = lamps if given.lamp_by_lamp else [None]
    for i, point in enumerate(lamps[:1] if given.lamp_by_lamp else lamps):
        scene[f"light{i}"] = {"type": "point", "position": triple(point, "position"),
                              "intensity": {"type": "rgb", "value": triple(point, "intensity")}}
    loaded = mi.load_dict(scene)
    started = time.time()
    for seed, path in enumerate(peers):
        # In passes, since a wavefront holds all of a pass's paths.
        passes = 1 if given.variant == "scalar_rgb" else max(1, peer_spp // 1024)
        sums = 0.0
        for i, lamp in enumerate(by_lamp):
            if lamp:
                move_lamp(loaded, lamp)
            for k in range(passes):
                stream = (seed * len(by_lamp) + i) * passes + k
                sums = sums + np.array(mi.render(loaded, seed=stream, spp=peer_spp // passes), dtype=np.float64)
        mi.Bitmap((sums / passes).astype(np.float32)).write(path)
    seconds = time.time() - started
    halves = [[pixels(path) for path in paths] for paths in (ours, peers)]
    mean = [(a + b) / 2 for a, b in halves]
    scale = mean[1] ** 2 + 0.01 * mean[1].mean() ** 2
    # The mean of two halves is off by half their difference, in the mean over many pixels.
    noise = sum((((a - b) / 2) ** 2 / scale).mean() for a, b in halves)
    relmse = ((mean[0] - mean[1]) ** 2 / scale).mean()
    ratio = mean[0].mean() / mean[1].mean()
    # Pixels are independent, channels of one are not: what the differences of the halves say of the mean over all.
    deviations = [np.sqrt((((a - b).sum(axis=2) / 2) ** 2).sum()) / mean[1].sum() for a, b in halves]
    print(f"{given.folder} {len(lamps) or 'emissive'} lights{' glossy' * given.glossy}, {given.bounces} bounces, {given.size[0]}x{given.size[1]}, "
          f"2 x {given.spp} spp, Mitsuba 2 x {peer_spp}: mean ratio {ratio:.5f} +- {np.hypot(*deviations):.5f} "
          f"(manylight {deviations[0]:.5f}, Mitsuba {deviations[1]:.5f}), relmse {relmse:.3e}, noise {noise:.3e}; "
          f"Mitsuba {seconds:.0f} s")
    difference = mean[0] - mean[1]
    mi.Bitmap((difference / np.sqrt(scale)).astype(np.float32)).write(os.path.join(given.out, "difference.exr"))


if __name__ == "__main__":
    main()
