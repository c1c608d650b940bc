"""Registration of a colour image to a depth image by a similarity transform.

Both cameras see nearly one plane, the table, so a similarity (scale, rotation, shift) suffices. It
is estimated by correlating the garment's mask in the colour image with the heights in the depth
image. The cameras share a housing and have similar lenses, so it is close to the identity.
"""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

#: Widths of the images of the coarse and the fine search, pixels.
_COARSE_WIDTH_PX = 160
_FINE_WIDTH_PX = 320

#: Scales of the coarse search.
_SCALES = np.linspace(0.88, 1.16, 15)

#: Mean of the prior: scale, rotation (rad), shift x and y (image widths).
_PRIOR_MEAN = np.array([1.03, 0.0, 0.0, 0.0])

#: Standard deviations of the prior.
_PRIOR_SIGMA = np.array([0.08, 0.02, 0.04, 0.04])

#: Weight of the prior's squared distance against the correlation.
_PRIOR_WEIGHT = 0.02

#: Largest accepted distance from the prior's mean, standard deviations.
_MAX_PRIOR_DISTANCE = 3.0

#: Least accepted correlation.
_MIN_CORRELATION = 0.35


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
        height: (h, w) smoothed heights above the table, metres.
        seen: (h, w) bool, pixels with a depth reading.
        span: height at which the evidence for garment saturates, metres.

    Returns:
        The affine matrix (2, 3), or None if the best correlation is too low or implausible.
    """
    evidence = np.clip(height / span, -0.5, 1.0).astype(np.float32)
    evidence[~seen] = 0.0
    if not colour_mask.any() or colour_mask.all():
        return None
    coarse = _coarse(colour_mask, evidence)
    scale = _FINE_WIDTH_PX / evidence.shape[1]
    small = cv2.resize(evidence, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    # Reduce the colour mask by area first; warping a thin mask directly would alias.
    shrink = _FINE_WIDTH_PX / colour_mask.shape[1]
    mask = cv2.resize(
        colour_mask.astype(np.float32), None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA
    )

    def cost(x: NDArray[np.float64]) -> float:
        affine = _similarity(x, mask.shape, small.shape)
        warped = cv2.warpAffine(mask, affine, (small.shape[1], small.shape[0]))
        away = (x - _PRIOR_MEAN) / _PRIOR_SIGMA
        return _PRIOR_WEIGHT * float(away @ away) - _correlation(
            np.asarray(warped), np.asarray(small)
        )

    start = np.array([coarse[0], 0.0, coarse[1], coarse[2]])
    simplex = start + np.vstack([np.zeros(4), np.diag([0.03, 0.02, 0.02, 0.02])])
    options: Any = {"initial_simplex": simplex, "xatol": 1e-4, "fatol": 1e-5, "maxiter": 250}
    found = minimize(cost, start, method="Nelder-Mead", options=options)
    away = np.abs(found.x - _PRIOR_MEAN) / _PRIOR_SIGMA
    if -found.fun < _MIN_CORRELATION or away.max() > _MAX_PRIOR_DISTANCE:
        return None
    return _similarity(found.x, colour_mask.shape, evidence.shape)


def _similarity(
    x: NDArray[np.float64], source: tuple[int, ...], target: tuple[int, ...]
) -> NDArray[np.float64]:
    """Return the affine (2, 3) of scale (image widths), rotation (rad), shift (target widths)."""
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
    zoom = _COARSE_WIDTH_PX / evidence.shape[1]
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
