"""Gaze control and vergence: both optical axes through one point of the scene.

Gaze control centres a target, given by a template, in both eyes. Vergence centres in the right eye
the surface point that is in the centre of the left eye.
"""

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import atan, degrees, hypot, isfinite, radians

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.arrays import Pose
from unwrinkle.models.errors import InputError
from unwrinkle.models.transforms import inverse, transformed
from unwrinkle.perception.camera import Camera
from unwrinkle.perception.features import Points, Template, View, view
from unwrinkle.perception.gaze.localization import NotSeen, Sighting, correspond, locate
from unwrinkle.perception.stereo.head import Gaze, PanTiltUnit, StereoHead

logger = logging.getLogger(__name__)

#: Angle between target and optical axis within which the target is centred, radians.
TOLERANCE = radians(0.020)

#: Fraction of the tolerance at which the loop stops; the rest allows for measurement errors (about
#: a pixel on the slope of a wrinkle).
_STOP_FRACTION = 0.65

#: Distance between the rays of both eyes, metres, below which their intersection is used.
_MAX_RAY_DISTANCE_M = 0.002

#: Largest distance of that intersection from the stated surface, metres.
_MAX_SURFACE_DISTANCE_M = 0.15

#: Least slope of a ray (sine) for its intersection with the surface.
_MIN_RAY_SLOPE = 0.05


@dataclass(frozen=True, eq=False)
class GazeMeasurement:
    """Gaze error measured from one image pair, and the next gaze.

    Attributes:
        gaze: gaze at which the pair was taken.
        left, right: positions of the target in the images.
        left_offset, right_offset: angle between optical axis and target, radians; infinite if the
            target is not seen.
        centred: whether both offsets are small and measured to a fraction of a pixel.
        next: gaze that centres the target, in whole steps of the units; None if neither eye sees
            the target or a unit cannot reach it.
        reason: why there is no next gaze; empty if there is one.
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
    """Outcome of the closed loop of `centre`.

    Attributes:
        measurements: measurement of each pair, in order.
        centred: whether the target is centred in both images of the last pair.
        reason: why it is not; empty if it is.
    """

    measurements: tuple[GazeMeasurement, ...]
    centred: bool
    reason: str = ""

    @property
    def gaze(self) -> Gaze:
        """Gaze of the last pair."""
        return self.measurements[-1].gaze


#: Function that moves the units to a gaze and takes a pair: left and right image, reported gaze.
TakePair = Callable[[Gaze], tuple[NDArray[np.uint8], NDArray[np.uint8], Gaze]]


def offset(camera: Camera, pixel: Points) -> float:
    """Return the angle between the optical axis and the ray through a pixel (2,), radians."""
    x, y, _ = ray(camera, pixel)
    return atan(hypot(x, y))


def ray(camera: Camera, pixel: Points) -> NDArray[np.float64]:
    """Return the undistorted ray (x, y, 1) through a pixel (2,), in the camera's frame."""
    inside = -0.5 <= pixel[0] <= camera.width - 0.5 and -0.5 <= pixel[1] <= camera.height - 0.5
    if not inside:  # the distortion polynomial is valid within the image only
        camera = replace(camera, distortion=[])
    return camera.unproject(pixel, 1.0)


def surface_point(
    camera: Camera, X_WC: Pose, pixel: Points, height: float
) -> NDArray[np.float64] | None:
    """Return the world point (3,), metres, where a pixel's ray meets the plane z = height.

    None if it does not, or meets it at too small an angle.
    """
    direction = X_WC[:3, :3] @ ray(camera, pixel)
    eye = X_WC[:3, 3]
    drop = height - eye[2]
    if drop * direction[2] <= 0.0 or abs(direction[2]) < _MIN_RAY_SLOPE * np.linalg.norm(direction):
        return None
    return np.asarray(eye + drop / direction[2] * direction)


def crossing(
    head: StereoHead, poses: tuple[Pose, Pose], left: Points, right: Points
) -> tuple[NDArray[np.float64], float] | None:
    """Return the midpoint (3,) of both rays' closest approach, and their distance, metres.

    None if the closest approach is behind the head or the rays are parallel.
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
    """Return the unit's pan and tilt in whole steps, nearest to angles in radians, within limits.

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
    """Return the nearest gaze in whole steps of the units.

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
    """Measure the gaze error from one image pair, and compute the next gaze.

    Each eye is aimed at the intersection of both eyes' rays to the target or, if these miss each
    other, at the intersection of its own ray with the surface at `height`. An eye that does not see
    the target is aimed at the point that the other eye sees.

    Args:
        head: the head.
        target: template to centre; None verges the right eye on the centre of the left image.
        left, right: (h, w) or (h, w, 3) RGB uint8 images of the cameras' sizes.
        gaze: reported gaze at which they were taken.
        height: world z of the observed surface, metres; errors of centimetres matter little.
        tolerance: of `centred`, radians.

    Raises:
        InputError: the size of an image differs from its camera's, or the gaze is beyond the
            limits.
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
        centred=sharp and max(offsets) <= _STOP_FRACTION * tolerance,
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
    max_measurements: int = 6,
) -> Centring:
    """Take pairs and move the units until the target is centred in both eyes.

    Args:
        head: calibrated head; errors of its calibration cost iterations, not accuracy.
        target: template to centre; None verges the right eye on the centre of the left image.
        start: first gaze.
        take: function that moves the units and takes a pair.
        height: world z of the observed surface, metres.
        tolerance: largest angle between optical axis and target, radians.
        max_measurements: limit of the number of pairs.

    Raises:
        InputError: the start is beyond the limits, the size of an image differs from its camera's,
            or `max_measurements` is below 1.
    """
    if max_measurements < 1:
        raise InputError(f"gaze: max_measurements is {max_measurements}; at least one is needed")
    measurements: list[GazeMeasurement] = []
    wanted = quantised(head, start)
    while len(measurements) < max_measurements:
        left, right, gaze = take(wanted)
        now = measure_gaze(head, target, left, right, gaze, height=height, tolerance=tolerance)
        measurements.append(now)
        logger.debug("look %d: %.1f, %.1f mdeg off", len(measurements), *_millidegrees(now))
        if now.centred:
            return Centring(tuple(measurements), True)
        if now.next is None:
            return Centring(tuple(measurements), False, now.reason)
        wanted = now.next
    last_left, last_right = _millidegrees(measurements[-1])
    return Centring(
        tuple(measurements),
        False,
        f"after {max_measurements} measurements still {last_left:.1f} (left) and "
        f"{last_right:.1f} (right) millidegrees off, or not measured sharply; "
        f"wanted {1e3 * degrees(tolerance):.1f}",
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
    """Return the next gaze, or None and the reason."""
    eyes = (head.left, head.right)
    points = [
        surface_point(eye.camera, X_WC, sight.pixel, height)
        if isinstance(sight, Sighting)
        else None
        for eye, X_WC, sight in zip(eyes, poses, seen, strict=True)
    ]
    if isinstance(seen[0], Sighting) and isinstance(seen[1], Sighting):
        met = crossing(head, poses, seen[0].pixel, seen[1].pixel)
        # Rays that miss each other show an error of the head's calibration: do not intersect them.
        if (
            met is not None
            and met[1] < _MAX_RAY_DISTANCE_M
            and abs(met[0][2] - height) < _MAX_SURFACE_DISTANCE_M
        ):
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
