"""Compile the stereo matcher's numba kernels into numba's cache, in a child process.

A freshly compiled kernel and the same kernel loaded from numba's cache differ in the last bits of
their results (`fastmath` leaves the order of sums open), so the first run of an installation would
not be repeatable bit by bit. With the child process, every run loads its kernels from the cache.
"""

import logging
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np

from unwrinkle.perception.stereo._kernels import cell_sums, normal_equations, plate_fit
from unwrinkle.perception.stereo.matching import match

_log = logging.getLogger(__name__)

#: Size of the random images, pixels: 1/16 of the head's images, which runs every matcher stage.
_IMAGE_SHAPE = (816, 1232)

#: Disparity of the random images, pixels.
_DISPARITY_PX = 4

#: Timeout of the child process, s.
_TIMEOUT_S = 300.0


def compiled() -> bool:
    """Return whether the kernels are in numba's cache."""
    return all(
        any(Path(folder).glob(f"{module.__name__.rpartition('.')[2]}.*.nbi"))
        for module in (plate_fit, cell_sums, normal_equations)
        for folder in _folders(module)
    )


def ensure_compiled() -> bool:
    """Compile the kernels in a child process if they are not in the cache.

    Returns:
        Whether the child process was started. Its failure is logged only; the kernels are then
        compiled at their first use.
    """
    if compiled():
        return False
    _log.info("compiling the stereo matcher, once")
    command = [sys.executable, "-c", f"from {__name__} import compile_kernels; compile_kernels()"]
    try:
        subprocess.run(command, check=True, capture_output=True, timeout=_TIMEOUT_S)
    except (OSError, subprocess.SubprocessError) as error:
        _log.warning("the stereo matcher could not be compiled beforehand: %s", error)
    return True


def compile_kernels() -> None:
    """Match a pair of random images, which compiles every kernel that is not in the cache."""
    noise = np.random.default_rng(0).uniform(0.0, 255.0, _IMAGE_SHAPE).astype(np.float32)
    grey = cv2.GaussianBlur(noise, (0, 0), 1.5)
    left = np.asarray(cv2.normalize(grey, None, 20, 235, cv2.NORM_MINMAX), dtype=np.uint8)
    match(left, np.roll(left, -_DISPARITY_PX, axis=1), -2 * _DISPARITY_PX, 2 * _DISPARITY_PX)


def _folders(module: object) -> set[str]:
    """Return the folders of numba's cache for a module's kernels."""
    found = {value.stats.cache_path for value in vars(module).values() if hasattr(value, "py_func")}
    return {str(path) for path in found if path}
