#!/usr/bin/env python3
"""Compares pictures under virtual lights with pictures by paths: how much light spheres of each size lose, and how much they blur.

    pip install mitsuba numpy        # to read EXR files; no part of the tests
    tests/peers/spheres_against_paths.py scenes/nave/scene.ron --size 96 54

Prints one row for each kind of virtual lights. The mean ratio has the standard error over the sets of lights. `relmse` is that of
single pictures and has all their noise; `blur` has none: it is the mean of products of the errors of two different sets
against two different references, which are independent. Where few paths carry much of the light, references are too noisy for
either, and the mean alone says something.
"""

import argparse
import itertools
import os
import subprocess

import mitsuba as mi
import numpy as np

mi.set_variant("scalar_rgb")

KINDS = [("Vsl", count) for count in (1_000, 10_000, 100_000, 1_000_000)]
CLAMPED = [("Vpl(clamp: 1)", 100_000), ("Vpl(clamp: 1, compensate: true)", 100_000)]


def pixels(path):
    """An EXR's radiance in f64."""
    bitmap = mi.Bitmap(path)
    names = [field.name for field in bitmap.struct_()]
    return np.array(bitmap, dtype=np.float64)[:, :, [names.index(channel) for channel in "RGB"]]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("--radii", type=float, nargs="*", default=[], help="also 100,000 spheres of these radii")
    parser.add_argument("--bounces", type=int, default=4)
    parser.add_argument("--size", type=int, nargs=2, default=[64, 64])
    parser.add_argument("--spp", type=int, default=64)
    parser.add_argument("--reference-spp", type=int, default=512)
    parser.add_argument("--sets", type=int, default=3, help="sets of virtual lights, 2 or more")
    parser.add_argument("--manylight", default="target/release/manylight")
    parser.add_argument("--out", default="out/spheres")
    given = parser.parse_args()
    os.makedirs(given.out, exist_ok=True)
    run = os.path.join(given.out, "run.ron")
    open(run, "w").write(f'(scene: "{os.path.abspath(given.scene)}")\n')

    def rendered(name, spp, seed, setting):
        subprocess.run([given.manylight, "render", run, "--size", "x".join(map(str, given.size)), "--spp", str(spp), "--seed", str(seed),
                        "--set", setting, "--out", given.out, "--name", name, "--quiet"], check=True)
        return pixels(os.path.join(given.out, f"{name}.exr"))

    paths = f"integrator=Path(max_bounces: {given.bounces})"
    references = [rendered(f"paths{seed}", given.reference_spp, seed, paths) for seed in (77, 78)]
    mean = sum(references) / 2
    scale = mean**2 + 0.01 * mean.mean() ** 2
    difference = references[0] - references[1]
    deviation = np.sqrt(((difference.sum(axis=2) / 2) ** 2).sum()) / mean.sum()
    print(f"{given.scene}: standard error of the reference's mean {deviation:.4f}, relmse between references {(difference**2 / scale).mean() / 2:.2e}")
    for kind, count in KINDS + [(f"Vsl(radius: {r})", 100_000) for r in given.radii] + CLAMPED:
        sets = []
        for seed in range(1, given.sets + 1):
            lights = f"lights=Virtual(kind: {kind}, count: {count}, max_bounces: {given.bounces}, seed: {seed})"
            sets.append(rendered("virtual", given.spp, seed, lights))
        ratios = [picture.mean() / mean.mean() for picture in sets]
        error = np.std(ratios, ddof=1) / len(sets) ** 0.5
        relmse = np.mean([((picture - mean) ** 2 / scale).mean() for picture in sets])
        errors = [[picture - reference for reference in references] for picture in sets]
        pairs = itertools.permutations(range(len(sets)), 2)
        blur = np.mean([(errors[i][0] * errors[j][1] / scale).mean() for i, j in pairs])
        print(f"{count:9} {kind:32} mean ratio {np.mean(ratios):.4f} +- {error:.4f}, relmse {relmse:.2e}, blur {blur:+.2e}", flush=True)


if __name__ == "__main__":
    main()
