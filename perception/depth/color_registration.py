"""Lay a colour image over a depth image that it is not registered to.

On a table both see nearly one plane, so a similarity (scale, turn, shift) is enough. It is found by
correlating the garment's mask in colour with the heights in depth. Both cameras sit in one housing,
some centimetres apart and with similar lenses, so the similarity is near the identity.
"""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

_COARSE_WIDTH = 160
_FINE_WIDTH = 320
_SCALES = np.linspace(0.88, 1.16, 15)
_PRIOR_MIDDLE = np.array([1.03, 0.0, 0.0, 0.0])  # scale, turn (rad), shift (image widths)
_PRIOR_SPREAD = np.array([0.08, 0.02, 0.04, 0.04])
_PRIOR_WEIGHT = 0.02
_FARTHEST = 3.0  # spreads
_LEAST_CORRELATION = 0.35


def align_colour(
    colour_mask: NDArray[np.bool_],
    height: NDArray[np.floating[Any]],
    seen: NDArray[np.bool_],
    *,
    span: float,
) -> NDArray[np.float64] | None:
    """Estimate the similarity from colour pixels to depth pixels.

    Args:
        colour_mask: (h', w') bool, the garment in the colour image.
        height: (h, w) smoothed metres above the table.
        seen: (h, w) bool, where depth has a reading.
        span: heights above this (metres) all count as garment alike.

    Returns:
        (2, 3) affine matrix, or None where mask and heights do not agree on any.
    """
    evidence = np.clip(height / span, -0.5, 1.0).astype(np.float32)
    evidence[~seen] = 0.0
    if not colour_mask.any() or colour_mask.all():
        return None
    coarse = _coarse(colour_mask, evidence)
    scale = _FINE_WIDTH / evidence.shape[1]
    small = cv2.resize(evidence, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    # Thin masks alias: shrink the colour mask by area before it is warped.
    shrink = _FINE_WIDTH / colour_mask.shape[1]
    mask = cv2.resize(
        colour_mask.astype(np.float32), None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA
    )

    def cost(x: NDArray[np.float64]) -> float:
        affine = _similarity(x, mask.shape, small.shape)
        warped = cv2.warpAffine(mask, affine, (small.shape[1], small.shape[0]))
        away = (x - _PRIOR_MIDDLE) / _PRIOR_SPREAD
        return _PRIOR_WEIGHT * float(away @ away) - _correlation(
            np.asarray(warped), np.asarray(small)
        )

    start = np.array([coarse[0], 0.0, coarse[1], coarse[2]])
    simplex = start + np.vstack([np.zeros(4), np.diag([0.03, 0.02, 0.02, 0.02])])
    options: Any = {"initial_simplex": simplex, "xatol": 1e-4, "fatol": 1e-5, "maxiter": 250}
    found = minimize(cost, start, method="Nelder-Mead", options=options)
    away = np.abs(found.x - _PRIOR_MIDDLE) / _PRIOR_SPREAD
    if -found.fun < _LEAST_CORRELATION or away.max() > _FARTHEST:
        return None
    return _similarity(found.x, colour_mask.shape, evidence.shape)


def _similarity(
    x: NDArray[np.float64], source: tuple[int, ...], target: tuple[int, ...]
) -> NDArray[np.float64]:
    """Affine (2, 3) from scale (of image widths), turn (rad) and shift (of the target's width)."""
    zoom = x[0] * target[1] / source[1]
    c, s = zoom * np.cos(x[1]), zoom * np.sin(x[1])
    linear = np.array([[c, -s], [s, c]])
    middle = np.array([(source[1] - 1) / 2.0, (source[0] - 1) / 2.0])
    aim = np.array([(target[1] - 1) / 2.0, (target[0] - 1) / 2.0]) + x[2:] * target[1]
    return np.column_stack([linear, aim - linear @ middle])


def _correlation(a: NDArray[Any], b: NDArray[Any]) -> float:
    a, b = a - a.mean(), b - b.mean()
    return float((a * b).sum() / np.sqrt((a * a).sum() * (b * b).sum() + 1e-12))


def _coarse(
    colour_mask: NDArray[np.bool_], evidence: NDArray[np.float32]
) -> tuple[float, float, float]:
    """Best scale and shift (of the image's width) over all scales, no turn."""
    zoom = _COARSE_WIDTH / evidence.shape[1]
    small = np.asarray(cv2.resize(evidence, None, fx=zoom, fy=zoom, interpolation=cv2.INTER_AREA))
    ny, nx = small.shape
    margin = nx // 12
    framed = cv2.copyMakeBorder(small, margin, margin, margin, margin, cv2.BORDER_CONSTANT, value=0)
    best, result = -1.0, (1.0, 0.0, 0.0)
    for scale in _SCALES:
        affine = _similarity(np.array([scale, 0.0, 0.0, 0.0]), colour_mask.shape, small.shape)
        template = cv2.warpAffine(
            colour_mask.astype(np.float32), affine, (nx, ny), flags=cv2.INTER_AREA
        )
        if float(np.std(template)) < 1e-3:
            continue
        response = cv2.matchTemplate(framed, template, cv2.TM_CCOEFF_NORMED)
        _, value, _, at = cv2.minMaxLoc(response)
        if value > best:
            best = value
            result = (float(scale), (at[0] - margin) / nx, (at[1] - margin) / nx)
    return result
