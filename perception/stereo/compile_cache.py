"""Compiling the matcher's kernels before they are needed, in a process of its own.

A kernel that was compiled just now and the same kernel loaded from numba's cache differ in the last bits of a float (its
inner loops are free to add up in any order). A run would then not repeat bit by bit what the first run of an installation
did. So that all runs load their kernels, a child process compiles them.
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

_SHAPE = (816, 1232)  # a sixteenth of the head's pictures: every stage of the matcher runs
_SHIFT = 4
_LONGEST = 300.0  # s


def compiled() -> bool:
    """Whether the kernels are in numba's cache."""
    return all(
        any(Path(folder).glob(f"{module.__name__.rpartition('.')[2]}.*.nbi"))
        for module in (plate_fit, cell_sums, normal_equations)
        for folder in _folders(module)
    )


def ensure_compiled() -> bool:
    """Have the kernels compiled by a child process, if they are not in the cache yet.

    Returns:
        Whether that was needed. What goes wrong is only logged: the kernels are then compiled when they are used.
    """
    if compiled():
        return False
    _log.info("compiling the stereo matcher, once")
    command = [sys.executable, "-c", f"from {__name__} import compile_kernels; compile_kernels()"]
    try:
        subprocess.run(command, check=True, capture_output=True, timeout=_LONGEST)
    except (OSError, subprocess.SubprocessError) as error:
        _log.warning("the stereo matcher could not be compiled beforehand: %s", error)
    return True


def compile_kernels() -> None:
    """Match a pair of random pictures, which compiles every kernel that is not in the cache."""
    noise = np.random.default_rng(0).uniform(0.0, 255.0, _SHAPE).astype(np.float32)
    grey = cv2.GaussianBlur(noise, (0, 0), 1.5)
    left = np.asarray(cv2.normalize(grey, None, 20, 235, cv2.NORM_MINMAX), dtype=np.uint8)
    match(left, np.roll(left, -_SHIFT, axis=1), -2 * _SHIFT, 2 * _SHIFT)


def _folders(module: object) -> set[str]:
    """Where numba keeps a module's kernels."""
    found = {value.stats.cache_path for value in vars(module).values() if hasattr(value, "py_func")}
    return {str(path) for path in found if path}
