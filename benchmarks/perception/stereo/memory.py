"""How much memory one pair takes: measured in a process of its own, which has no renderer."""

from __future__ import annotations

import multiprocessing
import resource
import tempfile
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from unwrinkle.models.table import Table
from unwrinkle.perception.stereo.head import Gaze
from unwrinkle.perception.stereo.head_file import nominal_head
from unwrinkle.perception.stereo.pair import StereoPair
from unwrinkle.perception.stereo.range_mapping import range_map_from_pair

if TYPE_CHECKING:
    from benchmarks.perception.stereo.scenes import Scene


def peak(scene: Scene) -> int:
    """Peak resident memory, bytes, of a fresh process that makes one range map of the pair.

    The interpreter, the libraries and the raw images are in it.
    """
    with tempfile.TemporaryDirectory() as folder:
        for side in ("left", "right"):
            np.save(Path(folder) / f"{side}.npy", getattr(scene.pair, side))
        fresh = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(1, mp_context=fresh) as pool:
            return pool.submit(_peak_here, folder, scene.gaze, scene.table).result()


def _peak_here(folder: str, gaze: Gaze, table: Table) -> int:
    from unwrinkle.perception.stereo.range_mapping import match_pair

    left, right = (np.load(Path(folder) / f"{side}.npy") for side in ("left", "right"))
    pair = StereoPair(left, right)
    head = nominal_head()
    match_pair(pair, head, gaze, table=table, whole=True)
    range_map_from_pair(pair, head, gaze, table=table)
    return 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
