"""Generate the captures that the package ships.

Usage: `python -m unwrinkle.simulation.rendering.shipped_captures [FOLDER]`. The output is a
function of the seed: the same command reproduces the same file.
"""

import sys
from pathlib import Path

from unwrinkle.models.io.loader_yaml import models_dir
from unwrinkle.perception.camera import load_camera
from unwrinkle.perception.depth.capture import Capture, save_capture
from unwrinkle.simulation.rendering.synthetic_towel import capture_of, overhead_pose, wrinkled_towel

#: Seed of the shipped towel.
SEED = 7

_CAMERA = "bench-stereo"

#: Height of the camera above the table, metres.
_CAMERA_HEIGHT = 1.40

#: Depth resolution of the file, metres.
_DEPTH_UNIT = 0.00005


def towel_capture(seed: int = SEED) -> Capture:
    """Return a capture of the shipped towel by an ideal range camera with 0.1 mm of noise."""
    towel = wrinkled_towel(seed)
    X_WC = overhead_pose(0.0, towel.centre[1], towel.table_height + _CAMERA_HEIGHT)
    return capture_of(towel, load_camera(_CAMERA), X_WC, seed=seed)


def write(folder: Path) -> Path:
    """Write `towel.npz` into the folder and return its path."""
    path = folder / "towel.npz"
    save_capture(path, towel_capture(), depth_unit=_DEPTH_UNIT, jpeg_quality=85)
    return path


if __name__ == "__main__":
    write(Path(sys.argv[1]) if len(sys.argv) > 1 else models_dir() / "captures")
