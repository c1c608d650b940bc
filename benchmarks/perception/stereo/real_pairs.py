"""Real pairs: Middlebury's Motorcycle, full of depth edges, and a stereo rig's chessboards.

D. Scharstein et al., High-resolution stereo datasets with subpixel-accurate ground truth, GCPR
2014. The chessboards come with their owner's intrinsics.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.harness.data import data_folder
from benchmarks.perception.calibration import chessboards
from benchmarks.perception.stereo.results import MotorcycleErrors, RealPairs
from unwrinkle.perception.calibration.boards import load_grey
from unwrinkle.perception.stereo.matching import match

_HIGHEST = 79


def figures() -> RealPairs | None:
    """Compute the figures of both; None where the data is not at hand."""
    boards = chessboards()
    if boards is None:
        return None
    return RealPairs(motorcycle(data_folder("stereo_motorcycle")), boards)


def motorcycle(folder: Path) -> tuple[MotorcycleErrors, ...]:
    """Ours and SGBM alone: where SGBM answers, ours unchecked there, and where both answer."""
    left, right = (load_grey(folder / f"motorcycle_{side}.png") for side in ("left", "right"))
    with np.load(folder / "motorcycle_disp.npz") as stored:
        truth = stored["arr_0"]
    matcher = cv2.StereoSGBM.create(
        minDisparity=0,
        numDisparities=_HIGHEST + 1,
        blockSize=5,
        P1=200,
        P2=800,
        disp12MaxDiff=1,
        preFilterCap=31,
        uniquenessRatio=5,
        speckleWindowSize=100,
        speckleRange=2,
        mode=cv2.STEREO_SGBM_MODE_HH4,
    )
    alone = np.asarray(matcher.compute(left, right)).astype(np.float32) / 16.0
    known = np.isfinite(truth) & (truth > 0.0)
    theirs = known & (alone > 0.0)
    ours = match(left, right, 0, _HIGHEST)
    every = match(left, right, 0, _HIGHEST, check=False)
    both = theirs & ours.valid

    def row(name: str, found: NDArray[np.float32], mask: NDArray[np.bool_]) -> MotorcycleErrors:
        error = np.abs(found - truth)[mask]
        return MotorcycleErrors(
            name=name,
            median=float(np.median(error)),
            bad=float(np.mean(error > 1.0)),
            valid=float(np.count_nonzero(mask) / np.count_nonzero(known)),
        )

    return (
        row("SGBM alone, where it answers", alone, theirs),
        row("ours, unchecked, on the same pixels", every.disparity, theirs),
        row("SGBM, where both answer", alone, both),
        row("ours, where both answer", ours.disparity, both),
        row("ours, where it answers", ours.disparity, known & ours.valid),
    )
