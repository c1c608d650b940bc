"""Which of several level planes is the table: the one that a garment lies on.

A camera high above a small table sees more floor than table, and the largest plane is the floor.
"""

import logging

import numpy as np

from unwrinkle.models.arrays import Mask
from unwrinkle.models.errors import InsufficientViewError, SeveralGarmentsError
from unwrinkle.perception.camera import Camera
from unwrinkle.perception.depth.pieces import MAX_GARMENT_HEIGHT_M
from unwrinkle.perception.depth.segmentation import raised_pixels
from unwrinkle.perception.depth.table_plane import TableFit, fit_table
from unwrinkle.perception.sensor import NoiseProfile

_log = logging.getLogger(__name__)

#: Least fraction of the readings above the largest plane for another one there.
_MIN_FRACTION = 0.06

#: Largest angle between the two planes, degrees.
_MAX_ANGLE_DEG = 5.0

#: Depth below a plane, metres, beyond which readings do not belong to it or to what lies on it.
_MAX_BELOW_M = 0.05

#: Least area of what lies on a plane, square metres.
_MIN_GARMENT_M2 = 0.008


def table_under_garment(
    depth: np.ndarray, camera: Camera, profile: NoiseProfile, *, seed: int, name: str
) -> tuple[TableFit, Mask]:
    """Fit the table: the largest plane, or the one above it that a garment lies on.

    Args:
        depth: (h, w) metres along the optical axis, 0 for no reading.
        camera: intrinsics of the depth image.
        profile: noise of the sensor.
        seed: of the consensus sampling.
        name: of the capture, for messages.

    Returns:
        The table, and the mask (h, w) of readings that are below it, which are none of its.

    Raises:
        InsufficientViewError: no plane is found.
        SeveralGarmentsError: something lies on both planes.
    """
    lower = fit_table(depth, camera, profile, seed=seed, name=name)
    none = np.zeros(depth.shape, dtype=bool)
    seen = depth > 0.0
    above = seen & (lower.height > MAX_GARMENT_HEIGHT_M)
    if np.count_nonzero(above) < _MIN_FRACTION * np.count_nonzero(seen):
        return lower, none
    try:
        upper = fit_table(depth, camera, profile, exclude=~above, seed=seed, name=name)
    except InsufficientViewError:
        return lower, none
    if float(upper.normal_C @ lower.normal_C) < np.cos(np.radians(_MAX_ANGLE_DEG)):
        return lower, none
    below = seen & (upper.height < -_MAX_BELOW_M)
    pixel = upper.distance / min(camera.fx, camera.fy)
    on_upper = _lying(upper, seen & ~below, profile, pixel)
    beside = seen & (lower.height < MAX_GARMENT_HEIGHT_M) & (lower.height > -_MAX_BELOW_M)
    on_lower = _lying(lower, beside, profile, lower.distance / min(camera.fx, camera.fy))
    if not on_upper:
        return lower, none
    planes = f"two level planes, {upper.distance:.2f} m and {lower.distance:.2f} m away"
    if on_lower:
        raise SeveralGarmentsError(
            f"{name}: {planes}, and something lies on both; name the garment's part of the image "
            "with --region, or give the camera's --pose, by which the table is known"
        )
    _log.warning("%s: %s; the nearer one, with the garment, is the table", name, planes)
    return upper, below


def _lying(table: TableFit, seen: Mask, profile: NoiseProfile, pixel: float) -> bool:
    """Return whether something that may be a garment lies on a plane."""
    low = seen & (table.height < MAX_GARMENT_HEIGHT_M)
    raised = raised_pixels(table.height, low, profile)
    return bool(np.count_nonzero(raised) * pixel**2 > _MIN_GARMENT_M2)
