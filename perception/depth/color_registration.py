"""Registration of a colour image to a depth image: by geometry, or by a similarity transform.

Where the colour camera and its pose are known, each reading is projected into the colour image.
Without them: both cameras see nearly one plane, the table, so a similarity (scale, rotation, shift)
suffices. It is estimated by correlating the garment's mask in the colour image with the heights in
the depth image. The cameras share a housing and mostly have similar lenses, so it is close to the
identity. A colour camera of another field of view shows by a better correlation at another scale;
that one is used only where it is clear.
"""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt
from scipy.optimize import minimize

from unwrinkle.models.arrays import Pose
from unwrinkle.models.transforms import inverse, transformed
from unwrinkle.perception.camera import Camera

#: Widths of the images of the coarse and the fine search, pixels.
_COARSE_WIDTH_PX = 160
_FINE_WIDTH_PX = 320

#: Scales of the coarse search.
_SCALES = np.linspace(0.88, 1.16, 15)

#: Scales among them that are those of cameras with like lenses.
_USUAL = (0.95, 1.13)

#: Other scales: of a colour camera with another field of view.
_OTHER_SCALES = np.concatenate([np.linspace(0.5, 0.86, 16), np.linspace(1.18, 1.9, 22)])

#: Gain of the correlation at an unusual scale by which it is the truth, and the least correlation
#: there at which it is used; in between, the alignment is unknown.
_UNUSUAL_GAIN = 0.02
_UNUSUAL_CORRELATION = 0.7

#: Mean of the prior: scale, rotation (rad), shift x and y (image widths).
_PRIOR_MEAN = np.array([1.03, 0.0, 0.0, 0.0])

#: Standard deviations of the prior.
_PRIOR_SIGMA = np.array([0.08, 0.02, 0.04, 0.04])

#: Weight of the prior's squared distance against the correlation.
_PRIOR_WEIGHT = 0.02

#: Largest accepted distance from the prior's mean, standard deviations.
_MAX_PRIOR_DISTANCE = 3.0

#: Grey level of depth pixels that the colour camera does not see.
_UNSEEN_GREY = 128

#: Least accepted correlation.
_MIN_CORRELATION = 0.35


@dataclass(frozen=True, eq=False)
class Alignment:
    """Similarity from colour pixels to depth pixels.

    Attributes:
        matrix: (2, 3) affine.
        scale: of the images' widths.
        unusual: whether the colour camera has another field of view than cameras of one housing
            mostly have.
    """

    matrix: NDArray[np.float64]
    scale: float
    unusual: bool


def align_colour(
    colour_mask: NDArray[np.bool_],
    height: NDArray[np.floating[Any]],
    seen: NDArray[np.bool_],
    *,
    span: float,
) -> Alignment | None:
    """Estimate the similarity from colour pixels to depth pixels.

    Args:
        colour_mask: (h', w') bool, the garment in the colour image.
        height: (h, w) smoothed heights above the table, metres.
        seen: (h, w) bool, pixels with a depth reading.
        span: height at which the evidence for garment saturates, metres.

    Returns:
        The alignment, or None if the best correlation is too low or implausible.
    """
    evidence = np.clip(height / span, -0.5, 1.0).astype(np.float32)
    evidence[~seen] = 0.0
    if not colour_mask.any() or colour_mask.all():
        return None
    usual = (_USUAL[0] <= _SCALES) & (_USUAL[1] >= _SCALES)
    correlation, _ = _coarse(colour_mask, evidence, _SCALES[usual])
    near, coarse = _coarse(colour_mask, evidence, _SCALES)
    far, other = _coarse(colour_mask, evidence, _OTHER_SCALES)
    mean = _PRIOR_MEAN
    unusual = max(near, far) > correlation + _UNUSUAL_GAIN
    if unusual and max(near, far) >= _UNUSUAL_CORRELATION:
        coarse = other if far > near else coarse
        mean = np.array([coarse[0], 0.0, coarse[1], coarse[2]])
    elif unusual and far > near:
        return None
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
        away = (x - mean) / _PRIOR_SIGMA
        return _PRIOR_WEIGHT * float(away @ away) - _correlation(
            np.asarray(warped), np.asarray(small)
        )

    start = np.array([coarse[0], 0.0, coarse[1], coarse[2]])
    simplex = start + np.vstack([np.zeros(4), np.diag([0.03, 0.02, 0.02, 0.02])])
    options: Any = {"initial_simplex": simplex, "xatol": 1e-4, "fatol": 1e-5, "maxiter": 250}
    found = minimize(cost, start, method="Nelder-Mead", options=options)
    away = np.abs(found.x - mean) / _PRIOR_SIGMA
    if -found.fun < _MIN_CORRELATION or away.max() > _MAX_PRIOR_DISTANCE:
        return None
    matrix = _similarity(found.x, colour_mask.shape, evidence.shape)
    return Alignment(matrix, float(found.x[0]), mean is not _PRIOR_MEAN)


def registered_colour(
    colour: NDArray[np.uint8],
    depth: NDArray[np.floating[Any]],
    camera: Camera,
    colour_camera: Camera,
    X_DC: Pose,
) -> NDArray[np.uint8]:
    """Return the colour (h, w, 3) of each pixel of a depth image, by the cameras' geometry.

    Args:
        colour: (h', w', 3) image of the colour camera.
        depth: (h, w) metres, 0 for no reading; such a pixel takes the depth of the nearest one.
        camera: of the depth image.
        colour_camera: of the colour image.
        X_DC: (4, 4) pose of the colour camera in the depth camera's frame.

    Returns:
        The colour image in the depth image's pixels; grey where the colour camera does not look.
    """
    nearest = distance_transform_edt(depth <= 0.0, return_distances=False, return_indices=True)
    points_D = camera.unproject_image(np.asarray(depth, dtype=float)[tuple(nearest)])
    points_C = transformed(inverse(X_DC), points_D)
    behind = points_C[..., 2] <= 0.0
    points_C[behind, 2] = 1.0
    pixels = colour_camera.project(points_C).astype(np.float32)
    pixels[behind] = -1e4
    return np.asarray(
        cv2.remap(
            colour,
            pixels[..., 0],
            pixels[..., 1],
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=(_UNSEEN_GREY,) * 3,
        ),
        dtype=np.uint8,
    )


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
    colour_mask: NDArray[np.bool_], evidence: NDArray[np.float32], scales: NDArray[np.float64]
) -> tuple[float, tuple[float, float, float]]:
    """Return the best correlation over the scales without turn, its scale and its shift (of the
    image's width).
    """
    zoom = _COARSE_WIDTH_PX / evidence.shape[1]
    small = np.asarray(cv2.resize(evidence, None, fx=zoom, fy=zoom, interpolation=cv2.INTER_AREA))
    ny, nx = small.shape
    margin = nx // 12
    framed = cv2.copyMakeBorder(small, margin, margin, margin, margin, cv2.BORDER_CONSTANT, value=0)
    best, result = -1.0, (1.0, 0.0, 0.0)
    for scale in scales:
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
    return best, result
