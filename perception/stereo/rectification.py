"""Rectification of a pair of toed-in cameras, restricted to a region of interest.

Frames: L and R the cameras, C the rectified left camera (x along the baseline, z perpendicular to
it and midway between both optical axes). Both rectified images share rows and focal length but not
the column of the optical axis, which keeps disparities small, of both signs:
u_left - u_right = f B / Z + (cx_left - cx_right).
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.arrays import Pose
from unwrinkle.models.errors import InputError
from unwrinkle.models.transforms import check_pose, inverse, pose, transformed
from unwrinkle.perception.camera import Camera
from unwrinkle.perception.stereo._kernels.resample import Lattice, lattice, warp

#: Least baseline, metres.
_MIN_BASELINE_M = 1e-4

#: Least cosine of the angle between an optical axis and the rectified one.
_MIN_AXIS_COSINE = 0.5

#: Least depth of the region of interest, metres.
_MIN_DEPTH_M = 0.05

#: Least field of view of the rectified images, radians.
_MIN_VIEW_RAD = 0.04

#: Pixels added to a range of disparities at either end.
_DISPARITY_MARGIN_PX = 1.0

#: Points along each side of an image's outline.
_OUTLINE_POINTS = 40

#: Limit of a rectified image's size, pixels.
_MAX_PIXELS = 40_000_000

#: Width and height of the rectified images are multiples of this, pixels: whole cells at every
#: scale of the matcher.
_SIZE_MULTIPLE = 8


@dataclass(frozen=True, eq=False)
class Rectification:
    """Rectified geometry of an image pair: two parallel pinhole cameras.

    Attributes:
        camera: the rectified left camera; both rectified images have its size.
        cx_right: column of the right rectified camera's optical axis, pixels.
        baseline: distance of the optical centres, metres.
        R_CL, R_CR: (3, 3) rotations of the source cameras in the rectified frame C.
        left, right: the source cameras.
    """

    camera: Camera
    cx_right: float
    baseline: float
    R_CL: NDArray[np.float64]
    R_CR: NDArray[np.float64]
    left: Camera
    right: Camera

    @property
    def X_CL(self) -> Pose:
        """Pose (4, 4) of the left camera in the rectified left camera, a pure rotation."""
        return pose(self.R_CL, np.zeros(3))

    @property
    def X_LC(self) -> Pose:
        """Pose (4, 4) of the rectified left camera in the left camera."""
        return inverse(self.X_CL)

    @property
    def shift(self) -> float:
        """Disparity of a point at infinity, cx_left - cx_right, pixels."""
        return self.camera.cx - self.cx_right

    @property
    def right_camera(self) -> Camera:
        """The rectified right camera."""
        c = self.camera
        return Camera("rectified right", c.width, c.height, c.fx, c.fy, self.cx_right, c.cy)

    @cached_property
    def _lattices(self) -> tuple[Lattice, Lattice]:
        return (
            lattice(self.left, self.camera, self.R_CL),
            lattice(self.right, self.right_camera, self.R_CR),
        )

    def apply(
        self, left: NDArray[np.uint8], right: NDArray[np.uint8]
    ) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """Rectify a pair; return grey images (h, w) uint8, 0 outside a camera's view.

        Args:
            left, right: (h, w) grey or (h, w, 3) RGB uint8 images of the source cameras.

        Raises:
            InputError: the size of an image differs from its camera's, or it is not uint8.
        """
        sources = (
            _grey(left, self.left, "left image"),
            _grey(right, self.right, "right image"),
        )
        shape = self.camera.height, self.camera.width
        maps = self._lattices
        return warp(sources[0], maps[0], shape), warp(sources[1], maps[1], shape)

    def apply_colour(self, left: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Rectify the left colour image bilinearly; return (h, w, 3) uint8.

        Raises:
            InputError: the size of the image differs from the left camera's, or it is not RGB
                uint8.
        """
        left = np.asarray(left)
        if left.ndim != 3 or left.shape[2] != 3:
            raise InputError(f"left image: shape {left.shape}, wanted (h, w, 3) RGB")
        _check_image(left, self.left, "left image")
        columns, rows = self._lattices[0].maps((self.camera.height, self.camera.width))
        return np.asarray(
            cv2.remap(left, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT),
            dtype=np.uint8,
        )

    def depth(self, disparity: NDArray[np.floating[Any]]) -> NDArray[np.floating[Any]]:
        """Return the depth along z of C, metres, of disparities in pixels; same shape and dtype.

        Disparities at or beyond that of infinity give 0.
        """
        over = np.asarray(disparity) - np.asarray(disparity).dtype.type(self.shift)
        scale = over.dtype.type(self.camera.fx * self.baseline)
        return np.divide(scale, over, out=np.zeros_like(over), where=over > 0.0)

    def disparity(self, depth: NDArray[np.floating[Any]]) -> NDArray[np.floating[Any]]:
        """Return the disparity, pixels, of positive depths along z of C, metres."""
        return np.asarray(self.camera.fx * self.baseline / np.asarray(depth) + self.shift)

    def points(self, disparity: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the points p_CQ (h, w, 3), metres, of a disparity image; 0 beyond infinity."""
        camera = self.camera
        z = self.depth(np.asarray(disparity, dtype=np.float32))
        x = (np.arange(camera.width, dtype=np.float32) - np.float32(camera.cx)) / camera.fx
        y = (np.arange(camera.height, dtype=np.float32) - np.float32(camera.cy)) / camera.fy
        return np.stack([x * z, y[:, None] * z, z], axis=-1, dtype=np.float32)

    def project(
        self, p_LQ: NDArray[np.floating[Any]]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Pixels (..., 2) in the left and right rectified image of points (..., 3) in frame L."""
        p_CQ = transformed(self.X_CL, np.asarray(p_LQ, dtype=float))
        left = self.camera.project(p_CQ)
        right = self.right_camera.project(p_CQ - [self.baseline, 0.0, 0.0])
        return left, right

    def disparity_range(self, points_L: NDArray[np.floating[Any]]) -> tuple[int, int]:
        """Lowest and highest disparity, pixels, of points (n, 3) in the left camera's frame L.

        Raises:
            InputError: a point is behind the cameras or too close.
        """
        points = _region(points_L)
        depth = transformed(self.X_CL, points)[:, 2]
        if depth.min() < _MIN_DEPTH_M:
            raise InputError(
                f"stereo pair: a point of the wanted region is at {depth.min():.3f} m before the "
                f"cameras, at least {_MIN_DEPTH_M} m wanted; do the cameras look at it?"
            )
        values = self.disparity(depth)
        return int(np.floor(values.min() - _DISPARITY_MARGIN_PX)), int(
            np.ceil(values.max() + _DISPARITY_MARGIN_PX)
        )


def rectify(
    left: Camera,
    right: Camera,
    X_LR: Pose,
    *,
    region: NDArray[np.floating[Any]] | None = None,
    margin: int = 16,
) -> Rectification:
    """Compute the rectification of a pair.

    The focal length is the mean of the sources', which keeps the resolution. The rectified axes
    follow Fusiello, Trucco, Verri 2000 with both optical axes weighted alike.

    Args:
        left, right: the cameras.
        X_LR: (4, 4) pose of the right camera in the left camera's frame.
        region: (n, 3) points in frame L, metres; both images are cropped to contain them all. None
            keeps every pixel of both cameras in the rows that both see.
        margin: pixels added around the region.

    Raises:
        InputError: X_LR is not a rigid transform, the cameras coincide, are swapped or diverge, or
            the region is behind the cameras or out of view.
    """
    X_LR = np.asarray(X_LR, dtype=float)
    check_pose(X_LR, "stereo pair: X_LR, the right camera in the left one's frame")
    R_CL, R_CR, baseline = _rotations(X_LR)
    focal = 0.25 * (left.fx + left.fy + right.fx + right.fy)
    outline = [
        _outline(eye, R_CE, focal, name)
        for eye, R_CE, name in ((left, R_CL, "left"), (right, R_CR, "right"))
    ]
    low = [points.min(axis=0) for points in outline]
    high = [points.max(axis=0) for points in outline]
    if region is not None:
        p_CQ = _region(region) @ R_CL.T
        if p_CQ[:, 2].min() < _MIN_DEPTH_M:
            raise InputError(
                "stereo pair: the wanted region is behind the cameras or closer than "
                f"{_MIN_DEPTH_M} m; check the gaze"
            )
        for eye, offset in ((0, 0.0), (1, baseline)):
            scaled = focal * (p_CQ[:, :2] - [offset, 0.0]) / p_CQ[:, 2:]
            low[eye] = np.maximum(low[eye], scaled.min(axis=0) - margin)
            high[eye] = np.minimum(high[eye], scaled.max(axis=0) + margin)
    top, bottom = max(low[0][1], low[1][1]), min(high[0][1], high[1][1])
    widths = [high[eye][0] - low[eye][0] for eye in (0, 1)]
    if bottom - top < 8.0 or min(widths) < 8.0:
        raise InputError(
            "stereo pair: the cameras do not both see the wanted region; check the angles of the "
            "pan-tilt units, and whether left and right are swapped"
        )
    middle = [0.5 * (low[eye][0] + high[eye][0]) for eye in (0, 1)]
    # Enlarge windows whose principal point or field of view `Camera` would refuse.
    least = _MIN_VIEW_RAD * focal
    width = int(np.ceil(max(*widths, *np.abs(middle) + 2.0, least)))
    height = int(np.ceil(max(bottom - top, 0.5 * abs(top + bottom) + 2.0, least)))
    # Whole cells at every scale of the matcher, which then need not pad the images.
    width, height = width + -width % _SIZE_MULTIPLE, height + -height % _SIZE_MULTIPLE
    if width * height > _MAX_PIXELS:
        raise InputError(
            f"stereo pair: the rectified images would have {width} x {height} pixels; "
            "the cameras look too far apart, check the gaze"
        )
    # Centre both windows; whole-pixel shifts keep the sampling of both images alike.
    cx, cx_right = (float(np.floor(0.5 * (width - 1) - middle[eye])) for eye in (0, 1))
    cy = float(np.floor(0.5 * (height - 1) - 0.5 * (top + bottom)))
    camera = _pinhole(width, height, focal, cx, cy)
    return Rectification(camera, cx_right, baseline, R_CL, R_CR, left, right)


def _pinhole(width: int, height: int, focal: float, cx: float, cy: float) -> Camera:
    try:
        return Camera("rectified left", width, height, focal, focal, cx, cy)
    except InputError as error:
        raise InputError(
            f"stereo pair: no good rectified view ({error}); do the cameras look the same way?"
        ) from None


def _rotations(X_LR: Pose) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    R_LR, p_LR = X_LR[:3, :3], X_LR[:3, 3]
    baseline = float(np.linalg.norm(p_LR))
    if baseline < _MIN_BASELINE_M:
        raise InputError(
            f"stereo pair: the cameras are {baseline:.2g} m apart, at least {_MIN_BASELINE_M} m "
            "wanted; is it twice the same camera?"
        )
    x = p_LR / baseline
    forward = np.array([0.0, 0.0, 1.0]) + R_LR[:, 2]
    z = forward - x * (x @ forward)
    length = float(np.linalg.norm(z))
    if length > 1e-6:
        z = z / length
    least = min(z[2], float(z @ R_LR[:, 2]))
    if length <= 1e-6 or least < _MIN_AXIS_COSINE:
        raise InputError(
            "stereo pair: the cameras look apart, or along the line that joins them; check the "
            "angles of the pan-tilt units"
        )
    if x[0] <= 0.0 or R_LR[:, 0] @ x <= 0.0:
        raise InputError(
            f"stereo pair: the right camera is at x = {p_LR[0]:.4f} m of the left one, wanted "
            "positive; are left and right swapped?"
        )
    R_CL = np.array([x, np.cross(z, x), z])
    return R_CL, R_CL @ R_LR, baseline


def _outline(
    camera: Camera, R_CE: NDArray[np.float64], focal: float, name: str
) -> NDArray[np.float64]:
    """Return the outline of an image in its rectified view, pixels from the optical axis."""
    u = np.linspace(0.0, camera.width - 1.0, _OUTLINE_POINTS)
    v = np.linspace(0.0, camera.height - 1.0, _OUTLINE_POINTS)
    across = [np.column_stack([u, np.full(_OUTLINE_POINTS, at)]) for at in (v[0], v[-1])]
    down = [np.column_stack([np.full(_OUTLINE_POINTS, at), v]) for at in (u[0], u[-1])]
    pixels = np.concatenate(across + down)
    p_CQ = camera_rays(pixels, camera) @ R_CE.T
    if p_CQ[:, 2].min() < 0.05 * np.linalg.norm(p_CQ, axis=1).max():
        raise InputError(
            f"stereo pair: the {name} camera sees almost across the rectified view; check the "
            "angles of the pan-tilt units"
        )
    return np.asarray(focal * p_CQ[:, :2] / p_CQ[:, 2:])


def camera_rays(pixels: NDArray[np.float64], camera: Camera) -> NDArray[np.float64]:
    """Return the undistorted rays (n, 3), z = 1, through pixels (n, 2), in the camera's frame."""
    distortion = np.array(camera.distortion or [0.0] * 5)
    rays = np.ones((len(pixels), 3))
    rays[:, :2] = np.asarray(cv2.undistortPoints(pixels[:, None], camera.matrix, distortion))[:, 0]
    return rays


def _region(points: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    region = np.asarray(points, dtype=float)
    if region.ndim != 2 or region.shape[1] != 3 or not len(region):
        raise InputError(f"stereo pair: region has shape {region.shape}, wanted (n, 3) points")
    if not np.isfinite(region).all():
        raise InputError("stereo pair: region has points that are not finite")
    return region


def _check_image(image: NDArray[Any], camera: Camera, name: str) -> None:
    if image.shape[:2] != (camera.height, camera.width):
        raise InputError(
            f"{name}: {image.shape[1]} x {image.shape[0]} pixels, its camera "
            f"{camera.name!r} has {camera.width} x {camera.height}; is it of another camera?"
        )
    if image.dtype != np.uint8:
        raise InputError(f"{name}: {image.dtype}, wanted uint8")


def _grey(image: NDArray[np.uint8], camera: Camera, name: str) -> NDArray[np.uint8]:
    image = np.asarray(image)
    if image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] != 3):
        raise InputError(f"{name}: shape {image.shape}, wanted (h, w) or (h, w, 3)")
    _check_image(image, camera, name)
    if image.ndim == 3:
        image = np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), dtype=np.uint8)
    return image
