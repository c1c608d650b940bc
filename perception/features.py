"""SIFT features of reduced images, matching, and robust estimation of the mapping between images.

D. Lowe, Distinctive image features from scale-invariant keypoints, IJCV 2004; R. Arandjelovic and
A. Zisserman, Three things everyone should know, CVPR 2012 (RootSIFT); D. Barath et al., MAGSAC++,
CVPR 2020. Features are detected in an image reduced by an integer factor and expressed in pixels of
the full image, (0, 0) being the centre of its top left pixel.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.arrays import Mask
from unwrinkle.models.errors import InputError

Points = NDArray[np.float64]
Homography = NDArray[np.float64]

#: Least number of matches that must agree on a mapping.
LEAST_INLIERS = 8

#: Width of the reduced image, pixels: 1/12 of the head's cameras. 1/8 takes twice as long and gave
#: the same result.
_WORK_WIDTH_PX = 411

#: Default limit of the features of an image.
_MAX_FEATURES = 1500

#: SIFT contrast threshold: a quarter of Lowe's, because plain cloth has little contrast.
_CONTRAST_THRESHOLD = 0.01

#: Lowe's ratio of the nearest to the second nearest distance.
_RATIO = 0.8

#: Lower bound of a squared descriptor distance against rounding.
_MIN_DISTANCE2 = 1e-5

#: Inlier tolerance of a mapping, pixels of the reduced image; wrinkles deviate from a plane by one.
_MAPPING_TOLERANCE_PX = 2.0

#: Least number of inliers of a homography; fewer determine a similarity only.
_MIN_HOMOGRAPHY_INLIERS = 20

#: Largest plausible stretch of a mapping, and ratio of its two stretches.
_MAX_STRETCH = 6.0

#: Margin kept around a template's region, pixels, for windows at its border.
_MARGIN_PX = 96


@dataclass(frozen=True, eq=False)
class Features:
    """SIFT features of an image.

    Attributes:
        points: (n, 2) u, v in pixels of the full image.
        descriptors: (n, 128) float32 RootSIFT, unit length.
        sizes: (n,) diameters, pixels of the full image.
        angles: (n,) directions, radians.
    """

    points: Points
    descriptors: NDArray[np.float32]
    sizes: Points
    angles: Points

    def __len__(self) -> int:
        """Number of features."""
        return len(self.points)

    def where(self, keep: Mask) -> "Features":
        """Return the features selected by a mask (n,)."""
        return Features(
            self.points[keep], self.descriptors[keep], self.sizes[keep], self.angles[keep]
        )


@dataclass(frozen=True, eq=False)
class View:
    """A grey image with its features.

    Attributes:
        grey: (h, w) uint8.
        features: of the whole image.
        factor: reduction of the image in which they were detected.
    """

    grey: NDArray[np.uint8]
    features: Features
    factor: int


@dataclass(frozen=True, eq=False)
class Template:
    """Image template: patch, SIFT features and reference point.

    Attributes:
        name: of the object.
        grey: (h, w) uint8 patch, with a margin around the object.
        features: of the object without the margin, in pixels of the patch.
        centre: (2,) u, v of the reference point, in pixels of the patch.
        corners: (4, 2) of the object's box, clockwise from the top left, in pixels of the patch.
        origin: (2,) of the patch in its source image, pixels.
        factor: reduction of the source image in which the features were detected.
    """

    name: str
    grey: NDArray[np.uint8]
    features: Features
    centre: Points
    corners: Points
    origin: Points
    factor: int


def view(image: NDArray[np.uint8], *, factor: int | None = None, most: int | None = None) -> View:
    """Detect the features of an image.

    Args:
        image: (h, w) or (h, w, 3) RGB uint8.
        factor: integer reduction of the image; None reduces it to a width of about 411 pixels.
        most: limit of the features, strongest first; None for 1500.

    Raises:
        InputError: the array is not an image, or the reduced image is too small.
    """
    if image.dtype != np.uint8 or image.ndim not in (2, 3) or image.shape[2:] not in ((), (3,)):
        raise InputError(f"image: {image.dtype} {image.shape}, wanted uint8 (h, w) or (h, w, 3)")
    height, width = image.shape[:2]
    if factor is None:
        factor = max(1, round(width / _WORK_WIDTH_PX))
    if factor < 1 or min(height, width) < 16 * factor:
        raise InputError(
            f"image of {width} x {height} pixels cannot be reduced by {factor}: 16 x 16 must be "
            "left"
        )
    grey = image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY))
    rows, columns = height // factor, width // factor
    small = grey[: rows * factor, : columns * factor]
    if factor > 1:
        small = np.asarray(cv2.resize(small, (columns, rows), interpolation=cv2.INTER_AREA))
    sift = cv2.SIFT_create(
        nfeatures=most or _MAX_FEATURES,
        contrastThreshold=_CONTRAST_THRESHOLD,
        enable_precise_upscale=True,  # without it points are off by a quarter of a pixel
    )
    keypoints, descriptors = sift.detectAndCompute(small, None)
    return View(np.asarray(grey, dtype=np.uint8), _features(keypoints, descriptors, factor), factor)


def template(
    source: View,
    name: str = "target",
    *,
    mask: Mask | None = None,
    box: tuple[float, float, float, float] | None = None,
    point: Sequence[float] | NDArray[np.floating[Any]] | None = None,
) -> Template:
    """Cut a template from a view.

    Args:
        source: the view.
        name: of the object.
        mask: (h, w) bool mask of the object; its centroid is the reference point.
        box: u0, v0, u1, v1 in pixels, instead of a mask; its middle is the reference point. Without
            mask and box the object is the whole image.
        point: u, v of another reference point.

    Raises:
        InputError: mask and box are both given or empty, or there are too few features.
    """
    height, width = source.grey.shape
    if mask is not None and box is not None:
        raise InputError(f"template {name!r}: give a mask or a box, not both")
    if mask is not None:
        if mask.shape != source.grey.shape:
            raise InputError(
                f"template {name!r}: mask {mask.shape} is not of the image's {source.grey.shape}"
            )
        rows, columns = np.nonzero(mask)
        if len(rows) == 0:
            raise InputError(f"template {name!r}: its mask is empty")
        bounds = np.array([columns.min(), rows.min(), columns.max(), rows.max()], dtype=float)
        middle = np.array([columns.mean(), rows.mean()])
    else:
        bounds = np.array(box if box is not None else (0, 0, width - 1, height - 1), dtype=float)
        middle = 0.5 * (bounds[:2] + bounds[2:])
    lower, upper = np.maximum(bounds[:2], 0.0), np.minimum(bounds[2:], [width - 1, height - 1])
    if not (np.isfinite(bounds).all() and (upper > lower).all()):
        raise InputError(f"template {name!r}: box {bounds} has nothing of the {width} x {height}")
    points = source.features.points
    inside = ((points >= lower) & (points <= upper)).all(axis=1)
    if mask is not None:
        pixels = np.rint(points).astype(int)
        inside &= mask[np.clip(pixels[:, 1], 0, height - 1), np.clip(pixels[:, 0], 0, width - 1)]
    if inside.sum() < LEAST_INLIERS:
        raise InputError(
            f"template {name!r}: {inside.sum()} features in it, at least {LEAST_INLIERS} are "
            "needed; choose a larger piece, one with texture, or a smaller factor"
        )
    start = np.maximum(np.floor(lower) - _MARGIN_PX, 0.0)
    stop = np.minimum(np.ceil(upper) + _MARGIN_PX, [width - 1.0, height - 1.0])
    u0, v0, u1, v1 = (int(value) for value in (*start, *stop))
    own = source.features.where(inside)
    return Template(
        name=name,
        grey=source.grey[v0 : v1 + 1, u0 : u1 + 1],
        features=Features(own.points - start, own.descriptors, own.sizes, own.angles),
        centre=(middle if point is None else np.array(point, dtype=float)) - start,
        corners=np.array([lower, [upper[0], lower[1]], upper, [lower[0], upper[1]]]) - start,
        origin=start,
        factor=source.factor,
    )


def matches(
    a: Features, b: Features, *, ratio: float = _RATIO, mutual: bool = True
) -> NDArray[np.int64]:
    """Match features; return the pairs (m, 2) of indices into a and b.

    Args:
        a, b: the features.
        ratio: limit of the nearest over the second nearest distance in b (Lowe).
        mutual: require that a's feature is also the nearest to b's. Otherwise several features of
            a may match the same feature of b.
    """
    if len(a) == 0 or len(b) < 2:
        return np.zeros((0, 2), dtype=np.int64)
    likeness = a.descriptors @ b.descriptors.T
    rows = np.arange(len(a))
    nearest = np.argmax(likeness, axis=1)
    best = likeness[rows, nearest]
    likeness[rows, nearest] = -1.0
    second = likeness.max(axis=1)
    likeness[rows, nearest] = best
    # Distances of vectors of length 1: d^2 = 2 - 2 likeness, up to rounding.
    near, far = np.maximum(1.0 - best, _MIN_DISTANCE2), np.maximum(1.0 - second, _MIN_DISTANCE2)
    keep = near < ratio * ratio * far
    if mutual:
        keep &= np.argmax(likeness, axis=0)[nearest] == rows
    return np.stack([rows[keep], nearest[keep]], axis=1)


def mapping(
    p: Points, q: Points, *, tolerance: float, least: int = LEAST_INLIERS
) -> tuple[Homography, Mask] | None:
    """Estimate the mapping from points p (n, 2) to q (n, 2) with the most inliers.

    It is a homography by MAGSAC++, or a similarity by RANSAC if there are too few inliers for one.

    Args:
        p, q: pixels.
        tolerance: of inliers, pixels.
        least: least number of inliers.

    Returns:
        The mapping (3, 3) and the inlier mask (n,); None with too few inliers, or if the mapping
        mirrors or stretches more than a view of a surface can.
    """
    if len(p) < max(least, 4):
        return None
    H, agree = cv2.findHomography(p, q, cv2.USAC_MAGSAC, tolerance, maxIters=3000, confidence=0.999)
    if H is not None and (keep := agree.ravel() > 0).sum() >= max(least, _MIN_HOMOGRAPHY_INLIERS):
        H = np.asarray(H, dtype=float)
        if _plausible(H, p[keep]):
            return H, keep
    A, agree = cv2.estimateAffinePartial2D(
        p, q, method=cv2.RANSAC, ransacReprojThreshold=1.5 * tolerance, maxIters=3000
    )
    if A is None or (keep := agree.ravel() > 0).sum() < least:
        return None
    H = np.vstack([np.asarray(A, dtype=float), [0.0, 0.0, 1.0]])
    return (H, keep) if _plausible(H, p[keep]) else None


def find(
    thing: Features, scene: Features, factor: int, *, ratio: float = _RATIO
) -> tuple[Homography, int] | None:
    """Find one object in a scene; return the mapping (3, 3) to the scene and the inlier count.

    Args:
        thing, scene: features of the object and of the scene.
        factor: reduction of the images.
        ratio: see `matches`.
    """
    pairs = matches(thing, scene, ratio=ratio)
    found = mapping(
        thing.points[pairs[:, 0]],
        scene.points[pairs[:, 1]],
        tolerance=_MAPPING_TOLERANCE_PX * factor,
    )
    return None if found is None else (found[0], int(found[1].sum()))


def mapped(H: Homography, points: NDArray[np.floating[Any]]) -> Points:
    """Apply a homography (3, 3) to points (..., 2); NaN for points mapped to infinity."""
    ends = np.asarray(points, dtype=float) @ H[:, :2].T + H[:, 2]
    scale = np.where(ends[..., 2:] * H[2, 2] > 1e-12, ends[..., 2:], np.nan)
    return np.asarray(ends[..., :2] / scale)


def local_linear(H: Homography, point: Points) -> NDArray[np.float64]:
    """Return the Jacobian (2, 2) of a homography at a point (2,)."""
    scale = float(H[2, :2] @ point + H[2, 2])
    end = (H[:2, :2] @ point + H[:2, 2]) / scale
    return np.asarray((H[:2, :2] - np.outer(end, H[2, :2])) / scale)


def _plausible(H: Homography, points: Points) -> bool:
    """Return whether a mapping neither mirrors nor stretches too much, at middle and corners."""
    if not np.isfinite(H).all() or abs(H[2, 2]) < 1e-12:
        return False
    for point in (points.mean(axis=0), points.min(axis=0), points.max(axis=0)):
        if not np.isfinite(mapped(H, point)).all():
            return False
        J = local_linear(H, point)
        stretch = np.linalg.svd(J, compute_uv=False)
        if np.linalg.det(J) <= 0.0 or stretch[0] > _MAX_STRETCH * stretch[1]:
            return False
        if not 1.0 / _MAX_STRETCH < stretch[0] < _MAX_STRETCH:
            return False
    return True


def _features(keypoints: Sequence[Any], descriptors: Any, factor: int) -> Features:
    if not keypoints:
        nothing = np.zeros(0)
        return Features(np.zeros((0, 2)), np.zeros((0, 128), dtype=np.float32), nothing, nothing)
    points = np.array([keypoint.pt for keypoint in keypoints], dtype=float)
    root = np.sqrt(descriptors / np.maximum(descriptors.sum(axis=1, keepdims=True), 1e-6))
    return Features(
        points=(points + 0.5) * factor - 0.5,
        descriptors=root.astype(np.float32),
        sizes=factor * np.array([keypoint.size for keypoint in keypoints], dtype=float),
        angles=np.radians([keypoint.angle for keypoint in keypoints]),
    )
