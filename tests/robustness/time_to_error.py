#!/usr/bin/env python3
"""How soon each method reaches a given error.

    tests/robustness/time_to_error.py configs/nave.ron configs/sponza.ron --manylight target/release/manylight

Each method renders each run file for a while and is measured after every pass against a picture of another seed by the default method,
whose own noise, 1 over its number of samples of what one sample has, is taken off. Seconds are the processor's, one thread, without set-up; between
passes they are interpolated, on logarithmic scales. Behind `~` stands what a method that was not there in time would take if its
error went on falling as 1 over time, which that of a biased method does not: of it is said only that it was not there after `> s`.
"""

import argparse
import json
import math
import os
import subprocess

METHODS = {
    "all-lights": ["all-lights"],
    "uniform": ["uniform"],
    "power": ["power"],
    "importance": ["importance"],
    "lightcuts 10": ["lightcuts", "--set", "method.cut=10"],
    "lightcuts 1000": ["lightcuts", "--set", "method.cut=1000"],
    "multidimensional": ["multidimensional"],
    "adaptive-splitting": ["adaptive-splitting"],
    "stochastic-lightcuts": ["stochastic-lightcuts"],
    "stratified-lightcuts": ["stratified-lightcuts"],
}
BIASED = ("lightcuts 10", "lightcuts 1000", "multidimensional")
TARGETS = (1e-2, 1e-3)


def reached(curve, target, is_biased):
    """Seconds at which a curve of (seconds, error) falls to `target`, as text."""
    for (s0, e0), (s1, e1) in zip([(0, math.inf), *curve], curve):
        if e1 <= target:
            if not math.isfinite(e0):
                return f"{s1:.2g}"
            share = math.log(e0 / target) / math.log(e0 / e1)
            return f"{s0 * (s1 / s0) ** share:.2g}"
    seconds, error = curve[-1]
    return f"> {seconds:.2g}" if is_biased else f"~ {seconds * error / target:.2g}"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", nargs="+", metavar="RUN.ron")
    parser.add_argument("--manylight", default="target/release/manylight")
    parser.add_argument("--size", default="240x135")
    parser.add_argument("--seconds", type=float, default=60, help="of rendering, for each method")
    parser.add_argument("--reference-spp", type=int, default=512)
    parser.add_argument("--out", default="out/time_to_error")
    given = parser.parse_args()

    def render(run, name, spp, seed, *more):
        """User seconds of a render, and what it reports."""
        virtual = ["--set", "lights.seed=1"] if "Virtual" in open(run).read() else []
        before = os.times()
        subprocess.run([given.manylight, "render", run, "--threads", "1", "--size", given.size, "--spp", str(spp), "--seed", str(seed), "--out",
                        given.out, "--name", name, "--quiet", *virtual, *more], check=True)
        after = os.times()
        with open(os.path.join(given.out, name + ".json")) as report:
            return after.children_user - before.children_user, json.load(report)

    for run in given.runs:
        scene = os.path.splitext(os.path.basename(run))[0]
        reference = f"{scene}-reference"
        if not os.path.exists(os.path.join(given.out, reference + ".exr")):
            render(run, reference, given.reference_spp, 99)
        path = os.path.join(given.out, reference + ".exr")
        noise = 0.0
        print(f"\n| {scene} | " + " | ".join(f"s to {t:g}" for t in TARGETS) + " | at the end: samples, s, relmse |", flush=True)
        print("| --- |" + " ---: |" * len(TARGETS) + " --- |", flush=True)
        # The default first: it tells the reference's noise.
        for name in reversed(METHODS):
            settings = ["--method", *METHODS[name]]
            first, _ = render(run, f"{scene}-first", 1, 1, *settings)
            whole, report = render(run, f"{scene}-{name.replace(' ', '-')}", 1 << 14, 1, *settings, "--max-seconds", str(given.seconds), "--reference", path)
            passes = report["error"]["passes"]
            if name == "stratified-lightcuts":
                last = passes[-1]
                noise = last["relmse"] * last["spp"] / (last["spp"] + given.reference_spp)
            # What the clock says, in the processor's seconds; the first pass is in both runs.
            wall = passes[-1]["seconds"]
            scale = (whole - first) / (wall - passes[0]["seconds"]) if len(passes) > 1 else 1.0
            curve = [(p["seconds"] * scale, max(p["relmse"] - noise, 1e-12)) for p in passes]
            seconds, error = curve[-1]
            cells = " | ".join(reached(curve, t, name in BIASED) for t in TARGETS)
            print(f"| `{name}` | {cells} | {passes[-1]['spp']}, {seconds:.3g}, {error:.2g} |", flush=True)


if __name__ == "__main__":
    main()
