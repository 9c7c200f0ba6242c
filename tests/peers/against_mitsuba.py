#!/usr/bin/env python3
"""Renders a scene with Mitsuba 3 and with manylight's path tracer, and compares the pictures.

    pip install mitsuba numpy        # in an environment of its own; no part of the tests
    tests/peers/against_mitsuba.py SCENE_FOLDER --lights points --out /tmp/peer

The scene is made matte (Ks 0) for both, as the two do not share a glossy model by name, and its lights are either the
file's points or its emissive triangles. SCENE_FOLDER holds scene.ron, one OBJ file and its MTL file. Mitsuba's area
lights shine to one side: each emissive triangle becomes two, a little apart.
"""

import argparse
import json
import os
import re
import subprocess
import time

import mitsuba as mi
import numpy as np

mi.set_variant("scalar_rgb")

NUMBER = r"[-+0-9.eE]+"


def triple(text, name):
    """The three numbers of field `name` in RON text."""
    found = re.search(name + rf":\s*\(\s*({NUMBER})\s*,\s*({NUMBER})\s*,\s*({NUMBER})\s*\)", text)
    return [float(x) for x in found.groups()]


def read_mtl(path):
    materials, current = {}, None
    for line in open(path, errors="replace"):
        key, _, rest = line.strip().partition(" ")
        rest = rest.strip()
        if key == "newmtl":
            current = materials.setdefault(rest, {"Kd": None, "Ke": [0, 0, 0], "map_Kd": None, "map_d": None})
        elif key in ("Kd", "Ke"):
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
    params["vertex_positions"] = positions.ravel().astype(np.float32)
    params["faces"] = np.arange(n, dtype=np.uint32)
    if uvs is not None:
        params["vertex_texcoords"] = uvs.ravel().astype(np.float32)
    if normals is not None:
        params["vertex_normals"] = normals.ravel().astype(np.float32)
    params.update()
    return made


def shapes(folder, obj, mtl, emissive):
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
        reflectance = {"type": "rgb", "value": material["Kd"] or ([1, 1, 1] if material["map_Kd"] else [0, 0, 0])}
        if material["map_Kd"] and has_uv:
            # map_Kd multiplies Kd: the product is made here, in linear light.
            bitmap = mi.Bitmap(os.path.join(folder, material["map_Kd"]))
            bitmap = bitmap.convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, srgb_gamma=False)
            texels = np.array(bitmap) * np.array(reflectance["value"], dtype=np.float32)
            # Mitsuba has the first row at the bottom.
            reflectance = {"type": "bitmap", "raw": True, "wrap_mode": "repeat",
                           "bitmap": mi.Bitmap(np.ascontiguousarray(texels[::-1]))}
        bsdf = {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": reflectance}}
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


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder")
    parser.add_argument("--lights", choices=["points", "emissive"], default="points")
    parser.add_argument("--bounces", type=int, default=5)
    parser.add_argument("--size", type=int, nargs=2, default=[128, 128])
    parser.add_argument("--spp", type=int, default=256)
    parser.add_argument("--method", default="stochastic-lightcuts")
    parser.add_argument("--manylight", default="target/release/manylight")
    parser.add_argument("--out", default="out/peer")
    given = parser.parse_args()
    os.makedirs(given.out, exist_ok=True)
    text = open(os.path.join(given.folder, "scene.ron")).read()
    files = os.listdir(given.folder)
    obj = os.path.join(given.folder, next(f for f in files if f.endswith(".obj")))
    mtl = os.path.join(given.folder, next(f for f in files if f.endswith(".mtl")))
    emissive = given.lights == "emissive"

    # A matte copy for manylight: files that do not change are linked.
    copy = os.path.join(given.out, "scene")
    os.makedirs(copy, exist_ok=True)
    for name in files:
        link = os.path.join(copy, name)
        if os.path.lexists(link):
            os.remove(link)
        source = os.path.abspath(os.path.join(given.folder, name))
        if name == os.path.basename(mtl):
            lines = [line for line in open(source, errors="replace") if line.split()[:1] != ["Ks"]]
            open(link, "w").writelines(lines)
        elif name != "scene.ron":
            os.symlink(source, link)
    lights = "lights: [Emissive]" if emissive else "lights: [Points(\"lights.ron\")]"
    open(os.path.join(copy, "scene.ron"), "w").write(re.sub(r"lights:\s*\[[^\]]*\]", lights, text))
    run = os.path.join(given.out, "run.ron")
    open(run, "w").write(
        f'(scene: "scene/scene.ron", integrator: Path(max_bounces: {given.bounces}),'
        f' image: (width: {given.size[0]}, height: {given.size[1]}, spp: {given.spp}))\n')
    subprocess.run([given.manylight, "render", run, "--method", given.method, "--out", given.out,
                    "--name", "manylight", "--quiet"], check=True)

    look = {key: triple(text, key) for key in ("origin", "target", "up")}
    fov = float(re.search(rf"fov_y_deg:\s*({NUMBER})", text).group(1))
    scene = {
        "type": "scene",
        # Counts edges: light seen directly is 1, lit by a light 2.
        "integrator": {"type": "path", "max_depth": given.bounces + 2, "rr_depth": 3},
        "sensor": {
            "type": "perspective", "fov": fov, "fov_axis": "y",
            "near_clip": 1e-4, "far_clip": 1e6,
            "to_world": mi.ScalarTransform4f().look_at(look["origin"], look["target"], look["up"]),
            "film": {"type": "hdrfilm", "width": given.size[0], "height": given.size[1],
                     "rfilter": {"type": "box"}, "pixel_format": "rgb", "component_format": "float32"},
            "sampler": {"type": "independent", "sample_count": given.spp},
        },
    }
    scene.update({f"shape{i}": s for i, s in enumerate(shapes(given.folder, obj, mtl, emissive).values())})
    if not emissive:
        points = open(os.path.join(given.folder, "lights.ron")).read()
        for i, entry in enumerate(re.findall(r"\(position:.*?\)\s*\)", points)):
            scene[f"light{i}"] = {"type": "point", "position": triple(entry, "position"),
                                  "intensity": {"type": "rgb", "value": triple(entry, "intensity")}}
    loaded = mi.load_dict(scene)
    started = time.time()
    picture = mi.render(loaded)
    seconds = time.time() - started
    peer = os.path.join(given.out, "mitsuba.exr")
    mi.Bitmap(picture).write(peer)
    ours = os.path.join(given.out, "manylight.exr")
    compared = subprocess.run([given.manylight, "compare", ours, peer, "--json"], check=True, capture_output=True)
    figures = json.loads(compared.stdout)
    print(f"{given.folder} {given.lights}, {given.bounces} bounces, {given.size[0]}x{given.size[1]}, {given.spp} spp: "
          f"mean ratio {figures['mean_ratio']:.5f}, relmse {figures['relmse']:.3e}; Mitsuba {seconds:.0f} s")


if __name__ == "__main__":
    main()
