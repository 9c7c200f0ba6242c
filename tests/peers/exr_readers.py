"""Reads a render's EXR with other people's readers: OpenEXR's Python module, and exrheader and oiiotool where they are.

    python3 -m venv /tmp/venv && /tmp/venv/bin/pip install OpenEXR numpy
    apt-get install openexr openimageio-tools
    /tmp/venv/bin/python tests/peers/exr_readers.py --binary target/release/manylight configs/nave.ron

No part of `cargo test`. Exit code 1 and a message at the first thing that does not come through.
"""

import argparse
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

import numpy
import OpenEXR

LAYERS = {
    "": "RGB", "direct": "RGB", "indirect": "RGB", "albedo": "RGB", "normal": "XYZ", "variance": "RGB",
    "depth": "Z", "samples": "Y",
}
TEXTS = ["version", "commit", "scene", "scene_content", "camera", "lights", "integrator", "tree", "method", "spp", "seed", "config"]


def expect(condition, message):
    if not condition:
        sys.exit(f"error: {message}")


def channel_names():
    return [f"{layer}.{c}" if layer else c for layer, letters in LAYERS.items() for c in letters]


def read_with_openexr(path):
    """Channels and header by OpenEXR's Python module."""
    with OpenEXR.File(str(path), separate_channels=True) as file:
        channels = {name: numpy.array(channel.pixels) for name, channel in file.channels().items()}
        return channels, dict(file.header())


def check_module(path, spp):
    channels, header = read_with_openexr(path)
    expect(sorted(channels) == sorted(channel_names()), f"channels are {sorted(channels)}")
    for name, pixels in channels.items():
        wanted = numpy.uint32 if name == "samples.Y" else numpy.float32
        expect(pixels.dtype == wanted, f"{name} is {pixels.dtype}")
    layer = lambda name: numpy.stack([channels[f"{name}.{c}" if name else c] for c in LAYERS[name]], axis=-1).astype(numpy.float64)
    beauty, direct, indirect = layer(""), layer("direct"), layer("indirect")
    expect(beauty.max() > 0, "the picture is black")
    off = numpy.abs(direct + indirect - beauty).max() / beauty.max()
    expect(off < 1e-6, f"direct and indirect light are off the whole by {off} of its maximum")
    expect(direct.min() >= 0 and indirect.min() >= 0, "a part is negative")
    albedo, normal, depth = layer("albedo"), layer("normal"), channels["depth.Z"]
    expect(albedo.min() >= 0 and albedo.max() <= 1, "albedo beyond 0 to 1")
    expect(numpy.linalg.norm(normal, axis=-1).max() < 1 + 1e-5, "normals longer than 1")
    expect(depth.min() >= 0, "a depth below 0")
    expect((channels["samples.Y"] == spp).all(), "sample counts")
    expect(layer("variance").min() >= 0, "a variance below 0")

    texts = {name: header.get(f"manylight.{name}") for name in TEXTS}
    expect(all(texts.values()), f"texts are {texts}")
    expect(f"spp: {spp}" in texts["config"], f"the run file is {texts['config']}")
    to_camera = numpy.array(header["worldToCamera"]).reshape(4, 4)
    to_ndc = numpy.array(header["worldToNDC"]).reshape(4, 4)
    numbers = lambda name: numpy.array([float(x) for x in re.search(rf"{name}: Vec3\(([^)]*)\)", texts["camera"])[1].split(",")])
    origin, target = numbers("origin"), numbers("target")
    local = numpy.append(target, 1) @ to_camera
    expect(numpy.allclose(local[:2], 0, atol=1e-4) and numpy.isclose(local[2], numpy.linalg.norm(target - origin), rtol=1e-4),
           f"the target is at {local} for the camera")
    middle = numpy.append(target, 1) @ to_ndc
    expect(numpy.allclose(middle[:2] / middle[3], 0.5, atol=1e-4), f"the target is at {middle} in the picture")
    return channels, texts


def check_points(channels, path):
    """What depth says lies where the matrices say: pixel centres, sent back by the inverse of worldToNDC, at their depth."""
    _, header = read_with_openexr(path)
    back = numpy.linalg.inv(numpy.array(header["worldToNDC"], dtype=numpy.float64).reshape(4, 4))
    height, width = channels["depth.Z"].shape
    x, y = numpy.meshgrid((numpy.arange(width) + 0.5) / width, (numpy.arange(height) + 0.5) / height)
    far = numpy.stack([x, y, 0 * x + 1e-3, 0 * x + 1], axis=-1) @ back
    near = numpy.stack([x, y, 0 * x + 1e3, 0 * x + 1], axis=-1) @ back
    direction = far[..., :3] / far[..., 3:] - near[..., :3] / near[..., 3:]
    direction /= numpy.linalg.norm(direction, axis=-1, keepdims=True)
    normal = numpy.stack([channels[f"normal.{c}"] for c in "XYZ"], axis=-1)
    facing = (direction * normal).sum(axis=-1)
    hit = channels["depth.Z"] > 0
    expect((facing[hit] < 0.05).mean() > 0.98, "normals do not face the camera of the matrices")


def check_exrheader(path):
    text = subprocess.run(["exrheader", path], check=True, capture_output=True, text=True).stdout
    for name in channel_names():
        expect(re.search(rf"^\s+{re.escape(name)}, ", text, re.M), f"exrheader shows no {name}")
    for name in [f"manylight.{name}" for name in TEXTS] + ["worldToCamera", "worldToNDC", "chromaticities"]:
        expect(name in text, f"exrheader shows no {name}")


def check_oiiotool(path, channels):
    """Names and means by OpenImageIO, whose reader is its own code over OpenEXR's core library."""
    text = subprocess.run(["oiiotool", "--info", "-v", "--stats", path], check=True, capture_output=True, text=True).stdout
    listed = re.search(r"channel list: (.*)", text)[1]
    names = [re.sub(r" \(.*\)", "", name) for name in listed.split(", ")]
    expect(sorted(names) == sorted(channel_names()), f"oiiotool lists {names}")
    averages = [float(x) for x in re.search(r"Stats Avg:\s+(.*?)\s*\((?:float|half|uint|of)", text)[1].split()]
    expect(len(averages) == len(names), f"oiiotool gives {len(averages)} means")
    for name, average in zip(names, averages):
        if name == "samples.Y":
            continue  # whole numbers are shares of the greatest one to it
        mean = channels[name].astype(numpy.float64).mean()
        expect(abs(average - mean) <= 1e-4 * max(abs(mean), 0.01), f"the mean of {name} is {average} to oiiotool and {mean} to OpenEXR")
    for name in TEXTS:
        expect(f"manylight.{name}" in text, f"oiiotool shows no manylight.{name}")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("run", nargs="?", default="configs/nave.ron")
    parser.add_argument("--binary", default="target/release/manylight")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        command = [arguments.binary, "render", arguments.run, "--size", "96x54", "--spp", "2", "--set", "lights.count=5000"]
        subprocess.run([*command, "--out", folder, "--name", "a", "--quiet"], check=True)
        path = pathlib.Path(folder) / "a.exr"
        channels, texts = check_module(path, 2)
        check_points(channels, path)
        read = ["OpenEXR " + getattr(OpenEXR, "__version__", "")]
        for tool, check in [("exrheader", check_exrheader), ("oiiotool", lambda p: check_oiiotool(p, channels))]:
            if shutil.which(tool):
                check(path)
                read.append(tool)
        # The run file that the picture carries gives the picture again.
        again = pathlib.Path(arguments.run).parent / "exr_readers_again.ron"
        again.write_text(texts["config"])
        try:
            subprocess.run([arguments.binary, "render", again, "--out", folder, "--name", "b", "--quiet"], check=True)
        finally:
            again.unlink()
        expect(path.read_bytes() == (pathlib.Path(folder) / "b.exr").read_bytes(), "the run file in the picture gives another picture")
    print(f"names, values and metadata come through: {', '.join(read)}")


main()
