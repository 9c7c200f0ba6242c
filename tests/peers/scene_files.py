"""What the scripts beside this one read of a scene's folder, and of pictures."""

import re

import numpy as np
import OpenEXR

NUMBER = r"[-+0-9.eE]+"


def triple(text, name):
    """The three numbers of field `name` in RON text."""
    found = re.search(name + rf":\s*\(\s*({NUMBER})\s*,\s*({NUMBER})\s*,\s*({NUMBER})\s*\)", text)
    return [float(x) for x in found.groups()]


def fov_y_deg(text):
    """The camera's vertical angle in RON text."""
    return float(re.search(rf"fov_y_deg:\s*({NUMBER})", text).group(1))


def points(path):
    """The text of each point light in a file of them."""
    return re.findall(r"\(position:.*?\)\s*\)", open(path).read())


def pixels(path):
    """An EXR's radiance in f64."""
    channels = OpenEXR.File(path).channels()
    if "RGB" in channels:
        return channels["RGB"].pixels.astype(np.float64)
    return np.stack([channels[c].pixels for c in "RGB"], axis=-1).astype(np.float64)
