"""Gaze and vergence: both eyes' optical axes through one point of the scene.

Gaze: a target, known by a template, is centred in both eyes. Vergence: the surface point at the
target's centre in the left eye is centred in the right one too.
"""

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import atan, degrees, hypot, isfinite, radians

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models import InputError
from unwrinkle.models.arrays import Pose
from unwrinkle.models.transforms import inverse, transformed
from unwrinkle.perception.camera import Camera
from unwrinkle.perception.features import Points, Template, View, view
from unwrinkle.perception.gaze.localization import NotSeen, Sighting, correspond, locate
from unwrinkle.perception.stereo.head import Gaze, PanTiltUnit, StereoHead

logger = logging.getLogger(__name__)

#: Within this the target counts as centred: angle between it and the optical axis, radians.
TOLERANCE = radians(0.020)

_STOP = 0.65  # of the tolerance; the rest is for the measurement's own errors, a pixel on a flank
_NEAR_MISS = 0.002  # metres; rays this close to each other tell the range themselves
_BAND = 0.15  # metres above or below the stated surface that are believed
_SHALLOW = 0.05  # a ray less steep than this meets the table too far away


@dataclass(frozen=True, eq=False)
class GazeMeasurement:
    """What one pair of images says about the gaze.

    Attributes:
        gaze: that the pair was taken with.
        left, right: where the target is in the images.
        left_offset, right_offset: angle between optical axis and target, radians; infinite where
            the target is not seen.
        centred: both are small, and measured sharply.
        next: gaze that would centre the target, in whole steps of the units; None where the target
            is in neither eye or a unit cannot look there.
        reason: why there is no next gaze; empty if there is.
    """

    gaze: Gaze
    left: Sighting | NotSeen
    right: Sighting | NotSeen
    left_offset: float
    right_offset: float
    centred: bool
    next: Gaze | None
    reason: str = ""


@dataclass(frozen=True, eq=False)
class Centring:
    """How the closed loop went.

    Attributes:
        looks: pairs taken, in order.
        centred: whether the last of them shows the target in the middle of both eyes.
        reason: why not; empty if so.
    """

    looks: tuple[GazeMeasurement, ...]
    centred: bool
    reason: str = ""

    @property
    def gaze(self) -> Gaze:
        """Where the head looks now."""
        return self.looks[-1].gaze


#: Moves the units to a gaze and takes a pair: left, right image, and the gaze the units report.
TakePair = Callable[[Gaze], tuple[NDArray[np.uint8], NDArray[np.uint8], Gaze]]


def offset(camera: Camera, pixel: Points) -> float:
    """Angle between the optical axis and the ray through a pixel (2,), radians."""
    x, y, _ = ray(camera, pixel)
    return atan(hypot(x, y))


def ray(camera: Camera, pixel: Points) -> NDArray[np.float64]:
    """Undistorted ray (x, y, 1) through a pixel (2,), in the camera's frame."""
    inside = -0.5 <= pixel[0] <= camera.width - 0.5 and -0.5 <= pixel[1] <= camera.height - 0.5
    if not inside:  # the distortion polynomial is valid within the image only
        camera = replace(camera, distortion=[])
    return camera.unproject(pixel, 1.0)


def surface_point(
    camera: Camera, X_WC: Pose, pixel: Points, height: float
) -> NDArray[np.float64] | None:
    """Where the ray through a pixel meets the level surface at a height of the world, p_W (3,).

    None where it does not, or too far away for the pixel to tell.
    """
    direction = X_WC[:3, :3] @ ray(camera, pixel)
    eye = X_WC[:3, 3]
    drop = height - eye[2]
    if drop * direction[2] <= 0.0 or abs(direction[2]) < _SHALLOW * np.linalg.norm(direction):
        return None
    return np.asarray(eye + drop / direction[2] * direction)


def crossing(
    head: StereoHead, poses: tuple[Pose, Pose], left: Points, right: Points
) -> tuple[NDArray[np.float64], float] | None:
    """Where the rays through a pixel (2,) of either eye come closest: p_W (3,), and by how much.

    None where they do not meet before the head.
    """
    rays = [
        X_WC[:3, :3] @ ray(eye.camera, pixel)
        for eye, X_WC, pixel in zip((head.left, head.right), poses, (left, right), strict=True)
    ]
    a, b = (X_WC[:3, 3] for X_WC in poses)
    along, _, rank, _ = np.linalg.lstsq(np.column_stack([rays[0], -rays[1]]), b - a, rcond=1e-6)
    if rank < 2 or along.min() <= 0.0:
        return None
    p, q = a + along[0] * rays[0], b + along[1] * rays[1]
    return np.asarray(0.5 * (p + q)), float(np.linalg.norm(p - q))


def in_steps(unit: PanTiltUnit, pan: float, tilt: float, name: str = "unit") -> tuple[int, int]:
    """Positions of a unit in whole steps, nearest to angles in radians and within its limits.

    Raises:
        InputError: the angles are beyond the limits.
    """
    unit.check(pan, tilt, name)
    positions = []
    for angle, (lower, upper) in ((pan, unit.pan), (tilt, unit.tilt)):
        nearest = round(angle / unit.step)
        nearest -= nearest * unit.step > upper
        nearest += nearest * unit.step < lower
        positions.append(nearest)
    return positions[0], positions[1]


def quantised(head: StereoHead, gaze: Gaze) -> Gaze:
    """Nearest gaze that the units' steps allow.

    Raises:
        InputError: an angle is beyond its limits.
    """
    angles = []
    for eye, (pan, tilt) in ((head.left, gaze.left), (head.right, gaze.right)):
        steps = in_steps(eye.unit, pan, tilt, f"{eye.name} eye")
        angles += [eye.unit.step * count for count in steps]
    return _gaze(angles, gaze.ext_axis)


def measure_gaze(
    head: StereoHead,
    target: Template | None,
    left: NDArray[np.uint8],
    right: NDArray[np.uint8],
    gaze: Gaze,
    *,
    height: float,
    tolerance: float = TOLERANCE,
) -> GazeMeasurement:
    """Say from one pair of images how far the gaze is off, and where to look next.

    Each eye turns so that its axis passes through where its own ray to the target meets the other
    eye's, or, where they miss each other, the surface at `height`. An eye that does not see the
    target is sent to where the other sees it.

    Args:
        head: the head.
        target: what to centre; None verges the right eye on what the left one has in its middle.
        left, right: (h, w) or (h, w, 3) RGB uint8, of the cameras' sizes.
        gaze: that they were taken with, as the units report it.
        height: world z of the surface looked at, metres; centimetres off do little harm.
        tolerance: of `centred`, radians.

    Raises:
        InputError: an image is not of its camera's size, or the gaze is beyond the limits.
    """
    for eye, image in ((head.left, left), (head.right, right)):
        if image.shape[:2] != (eye.camera.height, eye.camera.width):
            raise InputError(
                f"{eye.name} image is {image.shape[1]} x {image.shape[0]}, its camera "
                f"{eye.camera.width} x {eye.camera.height}; is it of another camera or mode?"
            )
    if not isfinite(height) or not tolerance > 0.0:
        raise InputError(f"gaze: height {height} must be finite, tolerance {tolerance} positive")
    poses = head.poses(gaze)
    factor = None if target is None else target.factor
    views = view(left, factor=factor), view(right, factor=factor)
    seen = _sightings(head, target, *views)
    eyes = (head.left, head.right)
    offsets = [
        offset(eye.camera, sight.pixel) if isinstance(sight, Sighting) else float("inf")
        for eye, sight in zip(eyes, seen, strict=True)
    ]
    sharp = all(isinstance(sight, Sighting) and sight.sharp for sight in seen)
    following, reason = _following(head, gaze, poses, seen, height, vergence=target is None)
    return GazeMeasurement(
        gaze=gaze,
        left=seen[0],
        right=seen[1],
        left_offset=offsets[0],
        right_offset=offsets[1],
        centred=sharp and max(offsets) <= _STOP * tolerance,
        next=following,
        reason=reason,
    )


def centre(
    head: StereoHead,
    target: Template | None,
    start: Gaze,
    take: TakePair,
    *,
    height: float,
    tolerance: float = TOLERANCE,
    most_looks: int = 6,
) -> Centring:
    """Look and move until the target is in the middle of both eyes.

    Args:
        head: the head as calibrated; errors of its calibration cost looks, not accuracy.
        target: what to centre; None verges the right eye on what the left one looks at.
        start: first gaze.
        take: moves to a gaze, takes a pair and returns it with the gaze that the units report.
        height: world z of the surface looked at, metres.
        tolerance: angle between optical axis and target that counts as centred, radians.
        most_looks: give up after so many.

    Raises:
        InputError: the start is beyond the limits, an image is not of its camera's size, or no
            look is allowed.
    """
    if most_looks < 1:
        raise InputError(f"gaze: most_looks is {most_looks}; at least one look is needed")
    looks: list[GazeMeasurement] = []
    wanted = quantised(head, start)
    while len(looks) < most_looks:
        left, right, gaze = take(wanted)
        now = measure_gaze(head, target, left, right, gaze, height=height, tolerance=tolerance)
        looks.append(now)
        logger.debug("look %d: %.1f, %.1f mdeg off", len(looks), *_millidegrees(now))
        if now.centred:
            return Centring(tuple(looks), True)
        if now.next is None:
            return Centring(tuple(looks), False, now.reason)
        wanted = now.next
    last_left, last_right = _millidegrees(looks[-1])
    return Centring(
        tuple(looks),
        False,
        f"after {most_looks} looks still {last_left:.1f} (left) and {last_right:.1f} (right) "
        f"millidegrees off, or not measured sharply; wanted {1e3 * degrees(tolerance):.1f}",
    )


def _sightings(
    head: StereoHead, target: Template | None, left: View, right: View
) -> tuple[Sighting | NotSeen, Sighting | NotSeen]:
    first: Sighting | NotSeen
    if target is None:
        middle = np.array([head.left.camera.cx, head.left.camera.cy])
        first = Sighting(middle, 0, 1.0, np.eye(3))
        return first, correspond(left, middle, right)
    first = locate(target, left)
    second: Sighting | NotSeen = NotSeen("")
    if isinstance(first, Sighting):
        second = correspond(left, first.pixel, right)
    if isinstance(second, NotSeen):
        second = locate(target, right)
    return first, second


def _following(
    head: StereoHead,
    gaze: Gaze,
    poses: tuple[Pose, Pose],
    seen: tuple[Sighting | NotSeen, Sighting | NotSeen],
    height: float,
    *,
    vergence: bool,
) -> tuple[Gaze | None, str]:
    """Next gaze, or None and why."""
    eyes = (head.left, head.right)
    points = [
        surface_point(eye.camera, X_WC, sight.pixel, height)
        if isinstance(sight, Sighting)
        else None
        for eye, X_WC, sight in zip(eyes, poses, seen, strict=True)
    ]
    if isinstance(seen[0], Sighting) and isinstance(seen[1], Sighting):
        met = crossing(head, poses, seen[0].pixel, seen[1].pixel)
        # Rays that miss each other tell that the head is not where its model says.
        if met is not None and met[1] < _NEAR_MISS and abs(met[0][2] - height) < _BAND:
            points = [met[0], met[0]]
    known = [point for point in points if point is not None]
    if not known:
        reasons = [sight.reason for sight in seen if isinstance(sight, NotSeen)]
        lost = f"its ray does not meet the surface at {height:.2f} m"
        return None, f"in neither eye: {'; '.join(reasons) or lost}"
    X_RW = inverse(head.turntable_pose(gaze.ext_axis))
    angles: list[float] = []
    try:
        for eye, point in zip(eyes, points, strict=True):
            angles += eye.aim(transformed(X_RW, known[0] if point is None else point))
        following = _gaze(angles, gaze.ext_axis)
        if vergence:
            following = replace(following, left_pan=gaze.left_pan, left_tilt=gaze.left_tilt)
        return quantised(head, following), ""
    except InputError as error:
        return None, str(error)


def _gaze(angles: list[float], ext_axis: float) -> Gaze:
    left_pan, left_tilt, right_pan, right_tilt = angles
    return Gaze(left_pan, left_tilt, right_pan, right_tilt, ext_axis)


def _millidegrees(now: GazeMeasurement) -> tuple[float, float]:
    return 1e3 * degrees(now.left_offset), 1e3 * degrees(now.right_offset)
