"""Epipolar check of an image pair against the stated head angles, and a small correction.

Matching points of a rectified pair lie in the same row. If they do not, the images are swapped, not
simultaneous, or not taken at the stated angles, and any range map would be wrong. Errors within the
resolution of the units and the calibration are a small rotation of one camera. Its components about
x and z change the rows; they are estimated and corrected. The component about y changes disparities
only and is corrected with the known table (`range_mapping`).
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

#: Limit of the median row error, radians: about three eighth steps of a PTU-D46.
LARGEST_ROW_ANGLE = 0.0008

#: Limit of either component of the corrected rotation, radians.
_MAX_TURN_RAD = 0.0016

#: Least number of matches.
_MIN_MATCHES = 16

#: Least fraction of the matches that agree on one small rotation.
_MIN_INLIER_FRACTION = 0.5

#: Expected rotation, radians: about x from the units' steps, about z from the calibration.
_EXPECTED_TURN_RAD = np.array([0.0002, 0.00005])

#: Residual of the prior at the expected rotation, pixels.
_PRIOR_RESIDUAL_PX = 3.0

#: Row error, as a tangent, above which a match is a gross outlier.
_GROSS_ROW_ERROR = 0.02

#: Limit of the features of an image.
_MAX_FEATURES = 600

#: Side of the Lucas-Kanade window, pixels.
_WINDOW_PX = 21

#: Scale of the images in which matches are refined over those in which they are detected.
_REFINEMENT_SCALE = 3

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class EpipolarCheck:
    """Result of the epipolar check.

    Attributes:
        matches: number of matches that agree on one small rotation of the right camera.
        row_error: median row error of these matches by the stated angles, radians.
        residual: median row error after the correction, radians.
        turn: (x, z) components of the corrected rotation, radians.
    """

    matches: int
    row_error: float
    residual: float
    turn: tuple[float, float]


def corrected_rectification(
    left: NDArray[np.uint8], right: NDArray[np.uint8], rectification: Rectification, name: str
) -> tuple[Rectification, EpipolarCheck]:
    """Check a pair against its geometry; return the corrected rectification and the check.

    Args:
        left, right: (h, w) grey images of the source cameras.
        rectification: by the stated head angles.
        name: of the pair, for messages.

    Raises:
        EpipolarError: too few matches, swapped images, or row errors that the resolution of the
            angles does not explain.
    """
    p, q = _matches(left, right)
    if len(p) < _MIN_MATCHES:
        raise EpipolarError(
            f"{name}: the eyes have only {len(p)} features in common, at least "
            f"{_MIN_MATCHES} wanted; do both see the table, in focus and at the same time?"
        )
    rays_l = _rays(p, rectification.left, rectification.R_CL)
    rays_r = _rays(q, rectification.right, rectification.R_CR)
    rows = _rows(rays_l) - _rows(rays_r)
    near = np.abs(rows) < _GROSS_ROW_ERROR
    if np.mean(near) < _MIN_INLIER_FRACTION:
        _refuse(p, q, rows, rectification, name)
    # Row change of a right ray under a small rotation (wx, wz): -(1 + y^2) wx + x wz.
    x, y = rays_r[near, 0] / rays_r[near, 2], _rows(rays_r[near])
    slopes = np.column_stack([-(1.0 + y * y), x])
    scale = 1.0 / rectification.camera.fx

    def apart(turn: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(rows[near] - slopes @ turn)

    def doubted(turn: NDArray[np.float64]) -> NDArray[np.float64]:
        # Errors of matches are correlated (edges, wrinkles), so the prior on the rotation has more
        # weight than the number of matches suggests.
        return np.concatenate([apart(turn), _PRIOR_RESIDUAL_PX * scale * turn / _EXPECTED_TURN_RAD])

    fit = least_squares(doubted, np.zeros(2), loss="soft_l1", f_scale=0.5 * scale)
    remaining = np.abs(apart(fit.x))
    agreeing = remaining < max(3.0 * float(np.median(remaining)), scale)
    row_error = float(np.median(np.abs(rows[near][agreeing])))
    share = np.count_nonzero(agreeing) / len(rows)
    wx, wz = (float(w) for w in fit.x)
    too_far = row_error > LARGEST_ROW_ANGLE or max(abs(wx), abs(wz)) > _MAX_TURN_RAD
    if too_far or share < _MIN_INLIER_FRACTION:
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
    """Return matching pixels (n, 2) of both images: SIFT, then Lucas-Kanade at finer scale."""
    views = [view(image, most=_MAX_FEATURES) for image in (left, right)]
    pairs = matches(views[0].features, views[1].features)
    p, q = (views[k].features.points[pairs[:, k]] for k in (0, 1))
    if len(p) == 0:
        return p, q
    factor = max(1, views[0].factor // _REFINEMENT_SCALE)
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
        winSize=(_WINDOW_PX, _WINDOW_PX),
        maxLevel=0,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )
    keep = (found.ravel() > 0) & (np.abs(ends - guesses).max(axis=1) < _WINDOW_PX / 2)
    return p[keep], ((np.asarray(ends, dtype=float) + 0.5) * factor - 0.5)[keep]


def _rays(
    pixels: NDArray[np.float64], camera: Camera, R_CE: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the rays (n, 3), in the rectified frame, through pixels (n, 2) of a source camera."""
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
    """Raise the error that explains the row errors.

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
