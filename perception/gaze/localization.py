"""Sub-pixel localization of a template or of a scene point in an image.

SIFT matches in reduced images give a position within a few pixels, Lucas-Kanade on a small window
of the full images within one, and an affine refinement within a fraction (ECC: G. Evangelidis and
E. Psarakis, PAMI 2008). The windows are small because wrinkled cloth is not planar.
"""

from dataclasses import dataclass
from math import floor

import cv2
import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.errors import InputError
from unwrinkle.perception.features import Homography, Points, Template, View, find, mapped, template

#: Sides of the Lucas-Kanade windows, pixels; the larger one if the smaller has too little texture.
_WINDOWS_PX = (31, 61)

#: Pyramid levels of Lucas-Kanade.
_PYRAMID_LEVELS = 2

#: Side of the window of the affine refinement, pixels.
_AFFINE_WINDOW_PX = 41

#: Limit of the affine refinement's shift, pixels.
_MAX_REFINEMENT_PX = 4.0

#: Half size of the crop around the expected position, pixels.
_CROP_HALF_PX = 160

#: Least correlation of the windows.
_MIN_CORRELATION = 0.6

#: Limit of the shift from the position by the matches, pixels.
_MAX_SHIFT_PX = 60.0

#: Sigma of the smoothing, pixels: the sensor's noise is finer than the cloth's texture.
_BLUR_SIGMA_PX = 1.0

#: Half sizes of the surroundings that are matched between the eyes, fractions of the image width.
_REGION_FRACTIONS = (1 / 8, 1 / 4, 1.0)


@dataclass(frozen=True, eq=False)
class Sighting:
    """Position of a point in an image.

    Attributes:
        pixel: (2,) u, v; may be outside the image if only a part of the target is visible.
        inliers: number of inlier SIFT matches.
        correlation: of the windows around the point, -1 to 1; 0 if they were not compared.
        H: (3, 3) homography from the template's pixels to the image's, by the matches.
    """

    pixel: Points
    inliers: int
    correlation: float
    H: Homography

    @property
    def sharp(self) -> bool:
        """Whether the position is accurate to a fraction of a pixel."""
        return self.correlation >= _MIN_CORRELATION


@dataclass(frozen=True)
class NotSeen:
    """The target is not in the image.

    Attributes:
        reason: in words.
    """

    reason: str


def locate(target: Template, scene: View) -> Sighting | NotSeen:
    """Locate the reference point of a template in a view.

    Args:
        target: template of an image reduced by about the same factor.
        scene: view to search.
    """
    found = find(target.features, scene.features, scene.factor)
    if found is None:
        return NotSeen(
            f"{target.name}: too few of its {len(target.features)} features are among the "
            f"{len(scene.features)} of the image"
        )
    H, inliers = found
    pixel = mapped(H, target.centre)
    if not np.isfinite(pixel).all():
        return NotSeen(f"{target.name}: its centre is far outside the image")
    for window in _WINDOWS_PX:
        aligned = _align(target, H, pixel, scene.grey, window)
        if aligned is not None:
            return Sighting(aligned[0], inliers, aligned[1], H)
    return Sighting(pixel, inliers, 0.0, H)


def correspond(source: View, pixel: Points, scene: View) -> Sighting | NotSeen:
    """Locate the surface point at a pixel (2,) of one view in another by its surroundings."""
    height, width = source.grey.shape
    if not (0.0 <= pixel[0] <= width - 1.0 and 0.0 <= pixel[1] <= height - 1.0):
        return NotSeen(f"the point is outside the other eye's image, at {np.round(pixel)}")
    for region in _REGION_FRACTIONS:
        reach = region * width
        box = (pixel[0] - reach, pixel[1] - reach, pixel[0] + reach, pixel[1] + reach)
        try:
            around = template(source, "the point's surroundings", box=box, point=pixel)
        except InputError:  # too few features
            continue
        found = locate(around, scene)
        if isinstance(found, Sighting):
            return found
    return NotSeen("the point's surroundings do not match the other eye's image")


def _align(
    target: Template, H: Homography, pixel: Points, grey: NDArray[np.uint8], window: int
) -> tuple[Points, float] | None:
    """Return the template's centre by Lucas-Kanade and the correlation of the windows, or None."""
    height, width = grey.shape
    half = 0.5 * window
    if not (half <= pixel[0] <= width - 1 - half and half <= pixel[1] <= height - 1 - half):
        return None
    u, v = floor(pixel[0] + 0.5), floor(pixel[1] + 0.5)
    u0, v0 = max(u - _CROP_HALF_PX, 0), max(v - _CROP_HALF_PX, 0)
    crop = grey[v0 : v + _CROP_HALF_PX + 1, u0 : u + _CROP_HALF_PX + 1]
    to_crop = np.array([[1.0, 0.0, -u0], [0.0, 1.0, -v0], [0.0, 0.0, 1.0]])
    size = (crop.shape[1], crop.shape[0])
    expected = cv2.warpPerspective(
        target.grey, to_crop @ H, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT_101
    )
    a, b = (_normalised(np.asarray(image)) for image in (expected, crop))
    start = (pixel - [u0, v0]).astype(np.float32).reshape(1, 1, 2)
    end, found, _ = cv2.calcOpticalFlowPyrLK(
        a, b, start, start.copy(), winSize=(window, window), maxLevel=_PYRAMID_LEVELS,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW, criteria=(3, 30, 0.005),
    )  # fmt: skip
    shift = np.asarray(end, dtype=float).ravel() - start.ravel()
    if not found.ravel()[0] or np.abs(shift).max() > _MAX_SHIFT_PX:
        return None
    pieces = [
        np.asarray(cv2.getRectSubPix(image, (window, window), place), dtype=float)
        for image, place in ((a, start.ravel().tolist()), (b, end.ravel().tolist()))
    ]
    spread = float(pieces[0].std() * pieces[1].std())
    if spread == 0.0:  # saturated, or black
        return None
    correlation = float(np.mean((pieces[0] - pieces[0].mean()) * (pieces[1] - pieces[1].mean())))
    correlation /= spread
    if correlation < _MIN_CORRELATION:
        return None
    return pixel + shift + _affine_rest(a, b, start.ravel(), end.ravel()), correlation


def _affine_rest(
    a: NDArray[np.uint8], b: NDArray[np.uint8], start: Points, end: Points
) -> NDArray[np.float64]:
    """Return the residual shift (2,), pixels, of an affine ECC alignment of the windows."""
    middle = 0.5 * (_AFFINE_WINDOW_PX - 1)
    piece = cv2.getRectSubPix(a, (_AFFINE_WINDOW_PX, _AFFINE_WINDOW_PX), start.tolist())
    warp = np.array([[1.0, 0.0, end[0] - middle], [0.0, 1.0, end[1] - middle]], dtype=np.float32)
    try:
        _, warp = cv2.findTransformECC(piece, b, warp, cv2.MOTION_AFFINE, (3, 40, 1e-4), None, 1)
    except cv2.error:  # does not converge
        return np.zeros(2)
    rest = np.asarray(warp[:, :2] @ [middle, middle] + warp[:, 2] - end, dtype=float)
    return rest if np.abs(rest).max() < _MAX_REFINEMENT_PX else np.zeros(2)


def _normalised(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Normalise mean and contrast: gains and lighting differ between the eyes."""
    smooth = np.asarray(cv2.GaussianBlur(image, (0, 0), _BLUR_SIGMA_PX), dtype=np.float32)
    smooth = (smooth - smooth.mean()) * (40.0 / max(float(smooth.std()), 1.0)) + 128.0
    return np.clip(np.rint(smooth), 0.0, 255.0).astype(np.uint8)
