"""Whether what was measured can lie on the cell's table, and what is wrong where it cannot.

A wrong depth unit, intrinsics of another resolution, or a wrong pose of the camera leave a picture
that looks right: a table with a garment. Its size and its place in the cell show them.
"""

import logging

import numpy as np

from unwrinkle.models.arrays import Pose
from unwrinkle.models.errors import InputError, UnwrinkleError
from unwrinkle.models.table import Table
from unwrinkle.models.transforms import inverse
from unwrinkle.perception.depth.capture import Capture
from unwrinkle.perception.depth.table_plane import fit_table
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.sensor import noise_profile

_log = logging.getLogger(__name__)

#: Largest fraction of a garment beyond the table's edges.
_MAX_BEYOND = 0.5

#: Least length of a garment, metres.
_MIN_GARMENT_M = 0.06

#: Difference of the table's heights by the pose and by the cell, metres: refused, and noted. Plans
#: need 8 mm.
_MAX_TABLE_ERROR_M = 0.025
_NOTED_TABLE_ERROR_M = 0.008

#: A pose fits the table if the plane leans by less, degrees, and is nearer to its height, metres.
_FITTING_TILT_DEG = 3.0
_FITTING_HEIGHT_M = 0.1

#: ROS's camera_link in its optical frame: x forward, y left, z up.
_X_LINK_OPTICAL = np.array(
    [[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
)


def check_size(range_map: RangeMap, table: Table, name: str) -> None:
    """Refuse a garment that cannot lie on the table.

    Args:
        range_map: of the garment, in the world.
        table: the working table.
        name: of the capture, for messages.

    Raises:
        InputError: most of the garment lies beyond the table, or it is too small for one.
    """
    rows, columns = np.nonzero(range_map.garment)
    points = range_map.origin + range_map.resolution * np.column_stack([columns, rows])
    if not len(points):
        return
    size = np.ptp(points, axis=0)
    beyond = float(table.outside(points).mean())
    measures = f"it measures {size[0]:.2f} x {size[1]:.2f} m"
    if beyond > _MAX_BEYOND:
        raise InputError(
            f"{name}: {beyond:.0%} of the garment lies beyond the table's edges ({measures}, the "
            f"table {table.size[0]:.2f} x {table.size[1]:.2f} m); is the depth in another unit "
            "(--depth-unit), or the camera's pose or intrinsics of another setup?"
        )
    if size.max() < _MIN_GARMENT_M:
        raise InputError(
            f"{name}: what was found is no garment, {measures}; is the depth in another unit "
            "(--depth-unit), or is another object in view?"
        )


def check_table_height(range_map: RangeMap, table: Table, name: str) -> None:
    """Refuse a table that by the camera's pose is not at the cell's height.

    Raises:
        InputError: it is more than 25 mm off; more than 8 mm are a warning.
    """
    off = range_map.table_height - table.height
    text = (
        f"{name}: by the camera's pose the table is at {range_map.table_height:.3f} m, "
        f"{1e3 * abs(off):.0f} mm {'above' if off > 0.0 else 'below'} the cell's, "
        f"{table.height:.3f} m"
    )
    if abs(off) > _MAX_TABLE_ERROR_M:
        raise InputError(
            f"{text} (at most {1e3 * _MAX_TABLE_ERROR_M:.0f} mm apart); check the pose, or the "
            "table's height in the cell"
        )
    if abs(off) > _NOTED_TABLE_ERROR_M:
        _log.warning("%s; correct the pose", text)


def pose_hint(capture: Capture, table: Table) -> str:
    """Return what is wrong with a capture's pose; empty where nothing simple explains it.

    Args:
        capture: the whole capture, with a pose that does not fit the table.
        table: the working table.
    """
    if capture.X_WC is None:
        return ""
    try:
        profile = noise_profile(capture.camera.sensor)
        plane = fit_table(capture.depth, capture.camera, profile, name=capture.name)
    except UnwrinkleError:
        return ""
    if _fits(capture.X_WC, plane.normal_C, plane.distance, table):
        return ""
    candidates = {
        "its inverse fits: give the camera in the world, not the world in the camera": inverse(
            capture.X_WC
        ),
        "it fits as ROS's camera_link: give the pose of the optical frame, z forward": capture.X_WC
        @ _X_LINK_OPTICAL,
    }
    for hint, X in candidates.items():
        if _fits(X, plane.normal_C, plane.distance, table):
            return hint
    return ""


def _fits(X_WC: Pose, normal_C: np.ndarray, distance: float, table: Table) -> bool:
    """Return whether by a pose a plane in the camera is level, at the table's height, and in view
    of the camera where the table is.
    """
    R, p = X_WC[:3, :3], X_WC[:3, 3]
    if abs(normal_C[2]) < 1e-6:
        return False
    seen = p + R[:, 2] * (-distance / normal_C[2])
    if bool(table.outside(seen[:2])):
        return False
    level = float((R @ normal_C)[2]) > np.cos(np.radians(_FITTING_TILT_DEG))
    height = float((R @ (-distance * normal_C) + p)[2])
    return level and abs(height - table.height) < _FITTING_HEIGHT_M
