"""Does a pair fit the angles it is said to be taken at? The epipolar check, and a small correction.

Matching points of a rectified pair lie in one row. Where they do not, the images are swapped, not
taken together, or not taken at these angles: then any range map would be wrong. What is left
within the units' resolution (their steps, the calibration) is a small turn of one camera; its two
parts that show in the rows, about the axes x and z, are estimated and taken out. The third, about
y, moves disparities alone; only the known table can tell it.
"""

import dataclasses
import logging
from dataclasses import dataclass
from typing import NoReturn

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from unwrinkle.models.errors import EpipolarError
from unwrinkle.perception.camera import Camera
from unwrinkle.perception.features import matches, view
from unwrinkle.perception.stereo.rectification import Rectification, camera_rays

#: The rows may be apart by this angle (radians): three eighth steps of a PTU-D46 and some more.
LARGEST_ROW_ANGLE = 0.0008
_LARGEST_TURN = 0.0016
_LEAST_MATCHES = 16
_LEAST_SHARE = 0.5  # of the matches must agree on one small turn
_EXPECTED_TURN = np.array([0.0002, 0.00005])  # about x: the units' steps; about z: calibration
_MATCH_ERROR = 3.0  # pixels
_GROSS = 0.02  # tangent; matches farther from their row than this say nothing of a small turn
_MOST_FEATURES = 600
_WINDOW = 21
_FINER = 3  # matches are refined in images so much larger than those they are found in

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class EpipolarCheck:
    """What the matches said.

    Attributes:
        matches: that agree on one small turn of the right camera.
        row_error: median distance of matches from their row as the angles have it, radians.
        residual: the same after the correction.
        turn: (x, z) of the correction, radians.
    """

    matches: int
    row_error: float
    residual: float
    turn: tuple[float, float]


def corrected_rectification(
    left: NDArray[np.uint8], right: NDArray[np.uint8], rectification: Rectification, name: str
) -> tuple[Rectification, EpipolarCheck]:
    """Check a pair against its geometry; return the rectification with rows made to agree.

    Args:
        left, right: (h, w) grey images of the source cameras.
        rectification: as the head's angles have it.
        name: of the pair, for messages.

    Raises:
        EpipolarError: too few features in common, images swapped, or rows apart by more than the
            angles' resolution explains.
    """
    p, q = _matches(left, right)
    if len(p) < _LEAST_MATCHES:
        raise EpipolarError(
            f"{name}: the eyes have only {len(p)} features in common, at least "
            f"{_LEAST_MATCHES} wanted; do both see the table, in focus and at the same time?"
        )
    rays_l = _rays(p, rectification.left, rectification.R_CL)
    rays_r = _rays(q, rectification.right, rectification.R_CR)
    rows = _rows(rays_l) - _rows(rays_r)
    near = np.abs(rows) < _GROSS
    if np.mean(near) < _LEAST_SHARE:
        _refuse(p, q, rows, rectification, name)
    # d(row) of a right ray under a small turn (wx, wz): -(1 + y^2) wx + x wz.
    x, y = rays_r[near, 0] / rays_r[near, 2], _rows(rays_r[near])
    slopes = np.column_stack([-(1.0 + y * y), x])
    scale = 1.0 / rectification.camera.fx

    def apart(turn: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(rows[near] - slopes @ turn)

    def doubted(turn: NDArray[np.float64]) -> NDArray[np.float64]:
        # Matches err together (edges, wrinkles): they weigh less than their number against what
        # the units and the calibration allow.
        return np.concatenate([apart(turn), _MATCH_ERROR * scale * turn / _EXPECTED_TURN])

    fit = least_squares(doubted, np.zeros(2), loss="soft_l1", f_scale=0.5 * scale)
    remaining = np.abs(apart(fit.x))
    agreeing = remaining < max(3.0 * float(np.median(remaining)), scale)
    row_error = float(np.median(np.abs(rows[near][agreeing])))
    share = np.count_nonzero(agreeing) / len(rows)
    wx, wz = (float(w) for w in fit.x)
    too_far = row_error > LARGEST_ROW_ANGLE or max(abs(wx), abs(wz)) > _LARGEST_TURN
    if too_far or share < _LEAST_SHARE:
        _refuse(p, q, rows, rectification, name)
    turn, _ = cv2.Rodrigues(np.array([wx, 0.0, wz]))
    check = EpipolarCheck(
        int(np.count_nonzero(agreeing)),
        row_error,
        float(np.median(remaining[agreeing])),
        (wx, wz),
    )
    _log.info(
        "%s: %d matches, rows apart by %.2f px, %.2f px after a turn of %.1f, %.1f mdeg",
        name,
        check.matches,
        row_error / scale,
        check.residual / scale,
        1e3 * np.degrees(wx),
        1e3 * np.degrees(wz),
    )
    return dataclasses.replace(rectification, R_CR=turn @ rectification.R_CR), check


def _matches(
    left: NDArray[np.uint8], right: NDArray[np.uint8]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Matching pixels (n, 2) each: features of the reduced images, refined in larger ones."""
    views = [view(image, most=_MOST_FEATURES) for image in (left, right)]
    pairs = matches(views[0].features, views[1].features)
    p, q = (views[k].features.points[pairs[:, k]] for k in (0, 1))
    if len(p) == 0:
        return p, q
    factor = max(1, views[0].factor // _FINER)
    size = (left.shape[1] // factor, left.shape[0] // factor)
    finer = [
        cv2.resize(
            image[: size[1] * factor, : size[0] * factor], size, interpolation=cv2.INTER_AREA
        )
        for image in (left, right)
    ]
    starts, guesses = (((points + 0.5) / factor - 0.5).astype(np.float32) for points in (p, q))
    ends, found, _ = cv2.calcOpticalFlowPyrLK(
        finer[0],
        finer[1],
        starts,
        guesses.copy(),
        winSize=(_WINDOW, _WINDOW),
        maxLevel=0,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    keep = (found.ravel() > 0) & (np.abs(ends - guesses).max(axis=1) < _WINDOW / 2)
    return p[keep], ((np.asarray(ends, dtype=float) + 0.5) * factor - 0.5)[keep]


def _rays(
    pixels: NDArray[np.float64], camera: Camera, R_CE: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Rays (n, 3) in the rectified frame through pixels (n, 2) of a source camera."""
    return camera_rays(pixels, camera) @ R_CE.T


def _rows(rays: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(rays[:, 1] / rays[:, 2])


def _refuse(
    p: NDArray[np.float64],
    q: NDArray[np.float64],
    rows: NDArray[np.float64],
    rectification: Rectification,
    name: str,
) -> NoReturn:
    """Say why the rows are apart.

    Raises:
        EpipolarError: always.
    """
    exchanged = _rows(_rays(q, rectification.left, rectification.R_CL)) - _rows(
        _rays(p, rectification.right, rectification.R_CR)
    )
    apart = float(np.median(np.abs(rows)))
    if float(np.median(np.abs(exchanged))) < 0.3 * apart:
        raise EpipolarError(f"{name}: left and right are swapped; name the left image first")
    focal = rectification.camera.fx
    raise EpipolarError(
        f"{name}: the pair is out of step with the head's angles, matching rows are "
        f"{apart * focal:.1f} pixels apart ({1e3 * np.degrees(apart):.0f} mdeg, at most "
        f"{1e3 * np.degrees(LARGEST_ROW_ANGLE):.0f}); check the angles, that both images are of "
        "one moment, and the calibration"
    )
