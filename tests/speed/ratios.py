#!/usr/bin/env python3
"""What speed should be, and what it is: ratios of what one machine does in one run.

    tests/speed/ratios.py --manylight target/release/manylight
    pip install embreex            # holds Embree 4, in embreex.libs; no part of the tests
    tests/speed/ratios.py --manylight target/release/manylight --embree PATH/libembree4.so

- choosing / rays: `cut` + `select` over `shadow` of the report's thread seconds, one thread;
- set-up: the report's `seconds` and `bytes`, two threads;
- a light sample: `cut`, `select`, `evaluate` and `shadow` over the number of light samples, in the same renders;
- two threads: seconds of the render by one thread over those by two;
- what a scene lacks: seconds for lights, tree and render of a plain scene over those of the same with a feature forced on that brings it nothing
  (`MATERIALS` and what follows); the report must list it as skipped and as needed, and pixels be the same to the bit but where `OTHER_BITS` says why not;
- rays: rates over those of Embree's single rays, by `tests/peers/against_embree.rs`, which `cargo` builds.

All but the last are clocks of threads: the machine should do nothing else. What is compared takes turns, round by round, each round with a
seed of its own; printed are medians, and the least and the greatest. Sibenik, Sponza and Conference are measured where MANYLIGHT_SCENES
is set.
"""

import argparse
import json
import operator
import os
import random
import re
import statistics
import struct
import subprocess
import zlib

HERE = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..")
METHODS = ("stochastic-lightcuts", "best")
COMPARED = {"<": operator.lt, "<=": operator.le, ">=": operator.ge}
# From so many lights on the time of a light sample should hardly grow.
FEW = 1_000
MILLION = 1_000_000


def row(what, target, values):
    """Prints a line of the table; `target` is `<= 1`, and perhaps a unit."""
    sign, limit = target.split()[:2]
    median = statistics.median(values)
    met = "yes" if COMPARED[sign](median, float(limit)) else "no"
    print(f"| {what} | {target} | {median:.3g} | {min(values):.3g} to {max(values):.3g} | {met} |", flush=True)


class Renders:
    """Runs the program and reads what it reports."""

    def __init__(self, given):
        self.given = given

    def report(self, scene, method, threads, *more):
        config = os.path.join(HERE, "configs", scene + ".ron")
        subprocess.run([self.given.manylight, "render", config, "--method", method, "--threads", str(threads), "--size", self.given.size, "--spp",
                        str(self.given.spp), "--out", self.given.out, "--name", "ratios", "--quiet", *more], check=True)
        with open(os.path.join(self.given.out, "ratios.json")) as report:
            return json.load(report)

    def by_turns(self, contestants):
        """The reports of each contestant (arguments of `report`, by name), a round at a time."""
        reports = {name: [] for name in contestants}
        for seed in range(1, self.given.rounds + 1):
            for name, arguments in contestants.items():
                reports[name].append(self.report(*arguments, "--seed", str(seed)))
        return reports


def choosing(renders, scenes):
    """Choosing ten lights against their shadow rays."""
    targets = {"nave": "<= 1", "sibenik": "<= 1", "sponza": "<= 0.5"}
    for scene in (s for s in targets if s in scenes):
        reports = renders.by_turns({method: (scene, method, 1) for method in METHODS})
        for method, found in reports.items():
            seconds = [r["thread_seconds"] for r in found]
            count = sum(found[0]["lights"].values())
            row(f"choosing / shadow rays, {scene}, {count} lights, `{method}`", targets[scene], [(s["cut"] + s["select"]) / s["shadow"] for s in seconds])


def light_sample(report):
    """Thread seconds of one light sample."""
    return sum(report["thread_seconds"][phase] for phase in ("cut", "select", "evaluate", "shadow")) / report["light_samples"]


def by_count(renders, scene, most):
    """Set-up, memory, and how the time of a light sample grows."""
    counts = sorted({FEW, MILLION, most})
    contestants = {(method, count): (scene, method, 2, "--set", f"lights.count={count}") for method in METHODS for count in counts}
    reports = renders.by_turns(contestants)
    for count in counts[1:]:
        limit = f"< {max(1, count / MILLION):g} s"
        of_count = [r for method in METHODS for r in reports[method, count]]
        row(f"{count} virtual lights traced and stored, {scene}", limit, [r["seconds"]["lights"] for r in of_count])
        for method in METHODS:
            found = reports[method, count]
            row(f"tree of {count}, {scene}, `{method}`", limit, [r["seconds"]["tree"] for r in found])
            per_light = [sum(r["bytes"][part] for part in ("lights", "tree", "wide_tree")) / sum(r["lights"].values()) for r in found]
            row(f"memory of a light with its share of the tree, {count}, {scene}, `{method}`", "< 100 B", per_light)
    for method in METHODS:
        pairs = zip(reports[method, most], reports[method, FEW])
        row(f"a light sample of {most} / of {FEW}, {scene}, `{method}`", "< 3", [light_sample(a) / light_sample(b) for a, b in pairs])


def loading(renders, scene):
    """Files and the hierarchy of rays."""
    found = renders.by_turns({scene: (scene, "uniform", 2, "--set", "lights=AsGiven")})[scene]
    row(f"{found[0]['triangles']} triangles loaded and made ready for rays, {scene}", "< 1 s", [r["seconds"]["load"] + r["seconds"]["bvh"] for r in found])


def threads(renders, scene):
    """What a second thread brings."""
    for method in METHODS:
        reports = renders.by_turns({n: (scene, method, n) for n in (1, 2)})
        pairs = zip(reports[1], reports[2])
        row(f"one thread / two, {scene}, `{method}`", ">= 1.9", [a["seconds"]["render"] / b["seconds"]["render"] for a, b in pairs])


def white(path):
    """Writes a PNG of four white pixels that may be seen through, but cannot."""
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    pixels = zlib.compress(2 * (b"\0" + 8 * b"\xff"))
    header = struct.pack(">IIBBBBB", 2, 2, 8, 6, 0, 0, 0)
    with open(path, "wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", pixels) + chunk(b"IEND", b""))


# How Conference, without its own gloss, is made to need what it lacks, by what brings nothing a picture could hold: white textures, an opacity map
# without holes, gloss that is lost in rounding, and spots of every direction in place of points.
MATERIALS = {
    "textures": ["map_Kd white.png"],
    "cut-outs": ["map_d white.png"],
    "glossy surfaces": ["Ks 1e-30 1e-30 1e-30", "Ns 0"],
}
# Lamps below a ceiling. Paths go on from it and meet nothing, virtual lights on it are on its horizon, and a sun is lost in rounding. Lamps are so
# many that none of their clusters are near the depth where the tree halves lights by count, which other lights' subtrees bring nearer.
LAMPS = 30_000
SUN = "Directional(direction: (0.3, 1, 0.2), irradiance: (1e-30, 1e-30, 1e-30))"
CEILING = {
    "eye paths that bounce": ("--set", "integrator=Path(max_bounces: 5)"),
    "virtual lights": ("--set", f"lights=Virtual(count: {LAMPS})"),
}
# Lights that bring nothing are left out of the sums, but not everywhere out of the choice: other lights are drawn, and the picture is as noisy.
# `best` shares cuts among points, so that dark clusters have places in them as well, and does not tell a light that shines anywhere from lights
# that face anywhere. Of a cut the sun takes a place; of a single light drawn from the whole tree it takes less than rounding does.
OTHER_BITS = {("best", "spot lights"), ("best", "directional lights"), ("best", "virtual lights")}
ONE_LIGHT = {("stochastic-lightcuts", "directional lights"): ("--set", "method.cut=1")}


def conference(folder, material=(), lights=None):
    """Writes a matte Conference, with these lines for each material, and with these lights or its own; returns its run file without its end."""
    source = os.path.join(os.environ["MANYLIGHT_SCENES"], "conference")
    os.makedirs(folder, exist_ok=True)
    white(os.path.join(folder, "white.png"))
    corner = re.compile(r"(?<= )(\d+)(?:/\d*)?")
    own = '[Points("lights.ron")]'
    for name in ("scene.obj", "scene.mtl", "scene.ron", "lights.ron"):
        with open(os.path.join(source, name)) as read, open(os.path.join(folder, name), "w") as write:
            if name == "scene.obj":
                write.write("vt 0.5 0.5\n")
            for line in read:
                if line.startswith(("Ks ", "Ns ")):
                    continue
                write.write(corner.sub(r"\1/1", line) if line.startswith("f ") else line.replace(own, lights or own))
                if line.startswith("newmtl "):
                    write.writelines(added + "\n" for added in material)
    return run_file(folder)


def ceiling(folder, more=""):
    """Writes lamps, and perhaps more lights, below a ceiling; returns its run file without its end."""
    os.makedirs(folder, exist_ok=True)
    draw = random.Random(1).uniform
    place = lambda: (draw(-1.5, 1.5), draw(-8.1, -7.9), draw(-1.5, 1.5))
    lamps = [f"(position: {place()}, intensity: {tuple(draw(0.01, 0.1) for _ in range(3))})" for _ in range(LAMPS)]
    files = {
        "scene.mtl": "newmtl ceiling\nKd 0.5 0.5 0.5\n",
        "scene.obj": "mtllib scene.mtl\nusemtl ceiling\nv -8 0 -8\nv -8 0 8\nv 8 0 8\nv 8 0 -8\nf 1 2 3 4\n",
        "lights.ron": "[" + ",\n".join(lamps) + "]\n",
        "scene.ron": '(geometry: ["scene.obj"], lights: [Points("lights.ron"), ' + more + '],\n'
                     "camera: (origin: (0, -6, 0.1), target: (0, 0, 0), up: (0, 1, 0), fov_y_deg: 30))\n",
    }
    for name, text in files.items():
        with open(os.path.join(folder, name), "w") as file:
            file.write(text)
    return run_file(folder)


def run_file(folder):
    """Writes the run file of the scene in `folder`; returns it without its end."""
    run = os.path.join(os.path.abspath(folder), "run")
    with open(run + ".ron", "w") as file:
        file.write('(scene: "scene.ron", seed: 1)\n')
    return run


def lacking(renders, has_scenes):
    """What a scene without a feature saves: the same scene with and without its code path forced on."""
    folder = lambda name: os.path.join(renders.given.out, name)
    bare = ceiling(folder("ceiling"))
    pairs = {feature: (bare, bare, settings) for feature, settings in CEILING.items()}
    pairs["directional lights"] = (bare, ceiling(folder("sun"), SUN), ())
    if has_scenes:
        with open(os.path.join(os.environ["MANYLIGHT_SCENES"], "conference", "lights.ron")) as file:
            points = re.findall(r"\(position: (\(.*?\)), intensity: (\(.*?\))\)", file.read())
        spots = [f"Spot(position: {p}, direction: (0, -1, 0), intensity: {i}, cos_inner: -1, cos_outer: -1)" for p, i in points]
        plain = conference(folder("plain"))
        dressed = {feature: conference(folder(feature), material=lines) for feature, lines in MATERIALS.items()}
        dressed["spot lights"] = conference(folder("spot lights"), lights="[" + ", ".join(spots) + "]")
        pairs |= {feature: (plain, run, ()) for feature, run in dressed.items()}
    for feature, (plain, run, settings) in pairs.items():
        for method in METHODS:
            without_and_with(renders, feature, method, (plain, run), settings)


def without_and_with(renders, feature, method, runs, settings):
    """The row of one feature and method: `settings` come with the feature."""
    one_light = ONE_LIGHT.get((method, feature), ())
    seconds = ([], [])
    for _ in range(renders.given.rounds):
        for run, more, taken, lists in zip(runs, ((), settings), seconds, ("skipped", "needs")):
            report = renders.report(run, method, 1, "--seed", "1", *one_light, *more)
            assert feature in report[lists], f"{feature}: {report}"
            taken.append(sum(report["seconds"][part] for part in ("lights", "tree", "render")))
            os.replace(os.path.join(renders.given.out, "ratios.exr"), os.path.join(renders.given.out, lists + ".exr"))
    same = (method, feature) not in OTHER_BITS
    if same:
        pictures = [os.path.join(renders.given.out, lists + ".exr") for lists in ("skipped", "needs")]
        subprocess.run([renders.given.manylight, "compare", *pictures, "--max-relmse", "0"], check=True, stdout=subprocess.DEVNULL)
    what = f"without {feature} / with, {'same' if same else 'other'} bits, `{method}`{', one light a point' if one_light else ''}"
    # Two runs of the same differ by so much.
    row(what, "<= 1.02", [a / b for a, b in zip(*seconds)])


def rays(library, scenes):
    """Rates of rays against Embree's."""
    folders = [os.path.join(HERE, "scenes/nave") if s == "nave" else os.path.join(os.environ["MANYLIGHT_SCENES"], s) for s in scenes]
    command = ["cargo", "run", "--release", "--quiet", "-p", "manylight-scene", "--example", "against_embree", "--", os.path.abspath(library)]
    command += [os.path.join(folder, "scene.ron") for folder in folders]
    header, *lines = subprocess.run(command, cwd=HERE, check=True, stdout=subprocess.PIPE, text=True).stdout.splitlines()
    for scene, line in zip(scenes, lines):
        figures = dict(zip(header.split(", "), line.split(", ")))
        row(f"any hit, queued / Embree, {scene}", ">= 1.5", [float(figures["queued / Embree"])])
        row(f"closest hit / Embree, {scene}", ">= 0.85", [float(figures["closest / Embree"])])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--manylight", default="target/release/manylight")
    parser.add_argument("--embree", metavar="PATH/libembree4.so")
    parser.add_argument("--size", default="240x135")
    parser.add_argument("--spp", type=int, default=16)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--most", type=int, default=10_000_000, help="lights, a million or more")
    parser.add_argument("--out", default="out/speed")
    given = parser.parse_args()
    renders = Renders(given)
    has_scenes = bool(os.environ.get("MANYLIGHT_SCENES"))
    scenes = ["nave", *(["sibenik", "sponza", "conference"] if has_scenes else [])]

    print("| what | target | median | least to greatest | met |\n| --- | --- | ---: | --- | --- |")
    if given.embree:
        rays(given.embree, scenes)
    choosing(renders, scenes)
    for scene in (s for s in ("nave", "sibenik") if s in scenes):
        by_count(renders, scene, given.most)
    for scene in (s for s in ("nave", "sponza") if s in scenes):
        loading(renders, scene)
        threads(renders, scene)
    lacking(renders, has_scenes)
    if not has_scenes:
        print("\nSkipped: Sibenik, Sponza and Conference; set MANYLIGHT_SCENES.")
    if not given.embree:
        print("\nSkipped: rays against Embree's; give --embree.")


if __name__ == "__main__":
    main()
