#!/usr/bin/env python3
"""How the default method fares against plain stochastic lightcuts in rooms made to defeat it.

    pip install numpy OpenEXR            # in an environment of its own; no part of the tests
    tests/robustness/race.py --manylight target/release/manylight

Each room is rendered with both methods and five seeds. Errors are relmse against a picture of another seed with sixteen times the
samples by the default method, whose own share is subtracted; seconds are the processor's for the render alone, one thread, as what a
picture takes beyond one of a single sample. Printed are medians, and how much greater error x seconds of the plain method are.
"""

import argparse
import os
import random
import statistics
import subprocess
import sys

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(__file__), "..", "peers"))
from scene_files import pixels

METHODS = ("stochastic-lightcuts", "stratified-lightcuts")


class Room:
    """Boxes of axis-parallel quads by material."""

    def __init__(self):
        self.corners, self.faces = [], []

    def quad(self, material, *corners):
        first = len(self.corners) + 1
        self.corners += corners
        self.faces.append((material, [first + i for i in range(4)]))

    def box(self, material, lo, hi):
        (a, b, c), (d, e, f) = lo, hi
        self.quad(material, (a, b, c), (d, b, c), (d, b, f), (a, b, f))
        self.quad(material, (a, e, c), (a, e, f), (d, e, f), (d, e, c))
        self.quad(material, (a, b, c), (a, e, c), (d, e, c), (d, b, c))
        self.quad(material, (a, b, f), (d, b, f), (d, e, f), (a, e, f))
        self.quad(material, (a, b, c), (a, b, f), (a, e, f), (a, e, c))
        self.quad(material, (d, b, c), (d, e, c), (d, e, f), (d, b, f))

    def write(self, folder, lights):
        os.makedirs(folder, exist_ok=True)
        with open(os.path.join(folder, "room.obj"), "w") as out:
            out.write("mtllib room.mtl\n")
            out.writelines(f"v {x} {y} {z}\n" for x, y, z in self.corners)
            for material, corners in self.faces:
                out.write(f"usemtl {material}\nf {' '.join(map(str, corners))}\n")
        with open(os.path.join(folder, "room.mtl"), "w") as out:
            out.write("newmtl matte\nKd 0.6 0.6 0.6\nnewmtl glossy\nKd 0.2 0.2 0.2\nKs 0.5 0.5 0.5\nNs 800\n")
        points = ",\n".join(f"(position: {p}, intensity: ({i}, {i}, {i}))" for p, i in lights)
        open(os.path.join(folder, "lights.ron"), "w").write(f"[{points}]\n")
        open(os.path.join(folder, "scene.ron"), "w").write(
            '(geometry: ["room.obj"], lights: [Points("lights.ron")],\n'
            " camera: (origin: (0, 1.7, 4.8), target: (0, 1.2, 0), up: (0, 1, 0), fov_y_deg: 60))\n")
        open(os.path.join(folder, "run.ron"), "w").write('(scene: "scene.ron", lights: AsGiven, integrator: Direct)\n')


def room(floor="matte"):
    """10 x 3 x 10 m with a few pillars."""
    made = Room()
    made.quad(floor, (-5, 0, -5), (-5, 0, 5), (5, 0, 5), (5, 0, -5))
    made.quad("matte", (-5, 3, -5), (5, 3, -5), (5, 3, 5), (-5, 3, 5))
    for a, b in (((-5, -5), (5, -5)), ((5, -5), (5, 5)), ((5, 5), (-5, 5)), ((-5, 5), (-5, -5))):
        made.quad("matte", (a[0], 0, a[1]), (b[0], 0, b[1]), (b[0], 3, b[1]), (a[0], 3, a[1]))
    return made


def scattered(count, lo, hi, intensity, seed=1):
    draw = random.Random(seed)
    return [(tuple(round(draw.uniform(a, b), 4) for a, b in zip(lo, hi)), intensity) for _ in range(count)]


def rooms():
    doors = room()
    # A wall with six slits of 8 cm.
    edges = [-5, *(x for i in range(6) for x in (-4 + 1.5 * i, -3.92 + 1.5 * i)), 5]
    for left, right in zip(edges[::2], edges[1::2]):
        doors.box("matte", (left, 0, -1.1), (right, 3, -1))
    yield "5000 lights behind slits", doors, scattered(5000, (-4.9, 0.1, -4.9), (4.9, 2.9, -1.3), 0.05)
    pillars = room()
    for x in (-3, -1, 1, 3):
        pillars.box("matte", (x - 0.2, 0, -1.2), (x + 0.2, 3, -0.8))
    lights = scattered(2000, (-4.9, 2, -4.9), (4.9, 2.9, 4.9), 0.01)
    yield "one light of 2000 dominates", pillars, [*lights, ((0.5, 2.5, -3), 100.0)]
    yield "2000 lights, all in sight", room(), scattered(2000, (-4.9, 2.5, -4.9), (4.9, 2.9, 4.9), 0.05)
    yield "10 lights", pillars, scattered(10, (-4, 2, -4), (4, 2.8, 4), 3.0)
    yield "2000 lights over a glossy floor", room("glossy"), scattered(2000, (-4.9, 2.5, -4.9), (4.9, 2.9, 4.9), 0.05)


def relmse(image, reference):
    scale = reference**2 + 0.01 * reference.mean() ** 2
    return ((image - reference) ** 2 / scale).mean()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--manylight", default="target/release/manylight")
    parser.add_argument("--size", default="160x90")
    parser.add_argument("--spp", type=int, default=16)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--out", default="out/robustness")
    given = parser.parse_args()

    def render(folder, method, spp, seed):
        name = f"{method}-{spp}-{seed}"
        before = os.times()
        subprocess.run([given.manylight, "render", os.path.join(folder, "run.ron"), "--method", method, "--spp", str(spp), "--seed",
                        str(seed), "--size", given.size, "--threads", "1", "--out", folder, "--name", name, "--quiet"], check=True)
        after = os.times()
        return pixels(os.path.join(folder, name + ".exr")), after.children_user - before.children_user

    print("| room | stochastic-lightcuts: relmse, s | stratified-lightcuts: relmse, s | ratio of relmse x s |")
    print("| --- | --- | --- | ---: |")
    for number, (title, made, lights) in enumerate(rooms()):
        folder = os.path.join(given.out, str(number))
        made.write(folder, lights)
        reference, _ = render(folder, METHODS[1], 16 * given.spp, 99)
        found = {}
        for seed in range(1, given.seeds + 1):
            for method in METHODS:
                image, seconds = render(folder, method, given.spp, seed)
                seconds -= render(folder, method, 1, seed)[1]
                found.setdefault(method, []).append((relmse(image, reference), seconds * given.spp / (given.spp - 1)))
        median = {m: [statistics.median(x) for x in zip(*rows)] for m, rows in found.items()}
        noise = median[METHODS[1]][0] / 17
        plain, best = ((e - noise, s) for e, s in (median[m] for m in METHODS))
        print(f"| {title} | {plain[0]:.2g}, {plain[1]:.2f} | {best[0]:.2g}, {best[1]:.2f} | {plain[0] * plain[1] / (best[0] * best[1]):.1f} |",
              flush=True)


if __name__ == "__main__":
    main()
