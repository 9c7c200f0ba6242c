#!/usr/bin/env python3
"""Writes a scene of many copies of the built-in nave, for measuring memory: no part of the tests.

    target/release/manylight scene nave --out /tmp/nave
    tests/size/many_naves.py /tmp/nave /tmp/naves --copies 34
    /usr/bin/time -v target/release/manylight render /tmp/naves/run.ron --out /tmp/naves/out

The nave is one mesh of a GLB file and each copy a node, moved to a place of its own; every copy has its 120 lamps. 34
copies are 5 million triangles, and run.ron asks for 10 million virtual lights.
"""

import argparse
import json
import os
import re
import shutil
import struct

NUMBER = r"[-+0-9.eE]+"
# More than the nave is wide and long, in metres.
SPACING = (60.0, 40.0)


def read_mtl(path):
    materials = {}
    for line in open(path):
        key, _, rest = line.strip().partition(" ")
        if key == "newmtl":
            current = materials.setdefault(rest, {})
        elif key:
            current[key] = rest
    return materials


def read_obj(path):
    """Rows by key, and corners of triangles by material: numbers of place, texture coordinates and normal, -1 where absent."""
    table, faces = {"v": [], "vt": [], "vn": []}, {}
    for line in open(path):
        key, *rest = line.split()
        if key in table:
            table[key].append([float(x) for x in rest])
        elif key == "usemtl":
            triangles = faces.setdefault(rest[0], [])
        elif key == "f":
            corners = [tuple(int(i or 0) - 1 for i in (corner + "//").split("/")[:3]) for corner in rest]
            triangles += [(corners[0], a, b) for a, b in zip(corners[1:], corners[2:])]
    return table, faces


class Glb:
    def __init__(self):
        self.bin = bytearray()
        self.json = {"asset": {"version": "2.0"}, "scene": 0, "accessors": [], "bufferViews": [], "images": [],
                     "textures": [], "materials": []}

    def push(self, items, item):
        self.json[items].append(item)
        return len(self.json[items]) - 1

    def accessor(self, form, kind, rows):
        data = b"".join(struct.pack(form, *row) for row in rows)
        view = self.push("bufferViews", {"buffer": 0, "byteOffset": len(self.bin), "byteLength": len(data)})
        self.bin += data
        component = 5125 if "I" in form else 5126
        return self.push("accessors", {"bufferView": view, "componentType": component, "count": len(rows), "type": kind})

    def material(self, name, mtl):
        colour = [float(x) for x in mtl["Kd"].split()]
        pbr = {"baseColorFactor": colour + [1], "metallicFactor": 0}
        if "map_Kd" in mtl:
            image = self.push("images", {"uri": mtl["map_Kd"]})
            pbr["baseColorTexture"] = {"index": self.push("textures", {"source": image})}
        return self.push("materials", {"name": name, "pbrMetallicRoughness": pbr})

    def write(self, path):
        self.json["buffers"] = [{"byteLength": len(self.bin)}]
        text = json.dumps(self.json).encode()
        text += b" " * (-len(text) % 4)
        with open(path, "wb") as file:
            file.write(struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(self.bin)))
            file.write(struct.pack("<I4s", len(text), b"JSON") + text)
            file.write(struct.pack("<I4s", len(self.bin), b"BIN\0") + self.bin)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("nave")
    parser.add_argument("out")
    parser.add_argument("--copies", type=int, default=34)
    parser.add_argument("--lights", type=int, default=10_000_000)
    given = parser.parse_args()
    at = lambda name: os.path.join(given.nave, name)
    to = lambda name: os.path.join(given.out, name)
    os.makedirs(given.out, exist_ok=True)
    shutil.copytree(at("textures"), to("textures"), dirs_exist_ok=True)

    table, faces = read_obj(at("scene.obj"))
    materials = read_mtl(at("scene.mtl"))
    glb = Glb()
    primitives = []
    for name, triangles in faces.items():
        # glTF has one index for all that a corner has.
        corners = {corner: i for i, corner in enumerate(dict.fromkeys(c for t in triangles for c in t))}
        attributes = {}
        # v points down there.
        for i, (key, name_there, kind) in enumerate((("v", "POSITION", "VEC3"), ("vt", "TEXCOORD_0", "VEC2"), ("vn", "NORMAL", "VEC3"))):
            if all(corner[i] >= 0 for corner in corners):
                rows = [table[key][corner[i]] for corner in corners]
                rows = [(u, 1 - v) for u, v, *_ in rows] if key == "vt" else rows
                attributes[name_there] = glb.accessor("<2f" if key == "vt" else "<3f", kind, rows)
        primitives.append({
            "attributes": attributes,
            "indices": glb.accessor("<I", "SCALAR", [(corners[c],) for t in triangles for c in t]),
            "material": glb.material(name, materials[name]),
        })
    columns = round(given.copies ** 0.5)
    offsets = [(SPACING[0] * (i % columns), 0.0, SPACING[1] * (i // columns)) for i in range(given.copies)]
    glb.json["meshes"] = [{"primitives": primitives}]
    glb.json["nodes"] = [{"mesh": 0, "translation": offset} for offset in offsets]
    glb.json["scenes"] = [{"nodes": list(range(given.copies))}]
    glb.write(to("scene.glb"))

    lamps = re.findall(rf"position: \(({NUMBER}), ({NUMBER}), ({NUMBER})\), intensity: (\([^)]*\))", open(at("lights.ron")).read())
    with open(to("lights.ron"), "w") as file:
        file.write("[\n")
        for offset in offsets:
            for *place, intensity in lamps:
                place = ", ".join(f"{float(p) + o:.6g}" for p, o in zip(place, offset))
                file.write(f"    (position: ({place}), intensity: {intensity}),\n")
        file.write("]\n")
    scene = open(at("scene.ron")).read()
    open(to("scene.ron"), "w").write(scene.replace("scene.obj", "scene.glb"))
    open(to("run.ron"), "w").write(
        f'(scene: "scene.ron", image: (width: 320, height: 180, spp: 8), lights: Virtual(count: {given.lights}))\n')
    print(f"{given.copies} copies, {given.copies * sum(map(len, faces.values()))} triangles, {len(offsets) * len(lamps)} lamps")


if __name__ == "__main__":
    main()
