"""Cropping of a capture to a known table.

A depth camera above the cell also sees the floor. If the floor fills more of the view than the
table, `fit_table` would fit the floor.
"""

import logging
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.errors import InputError
from unwrinkle.models.table import Table
from unwrinkle.perception.depth.capture import Capture

_log = logging.getLogger(__name__)

#: Depth below the table's top, metres, beyond which readings are removed.
_MAX_DEPTH_M = 0.05

#: Largest fraction of the readings within the table's outline that lie below it.
_MAX_BELOW = 0.5

#: Least width and height of the window, pixels.
_MIN_SIDE_PX = 32


def crop_to_table(capture: Capture, table: Table) -> Capture:
    """Crop a capture to the window of a table's top and remove readings far below it.

    Args:
        capture: a capture with the camera's pose.
        table: the working table.

    Returns:
        The cropped capture, with the camera of its smaller image.

    Raises:
        InputError: the pose is unknown, the camera is not above the table, the table is not in
            view, or there are too few readings on it.
    """
    if capture.X_WC is None:
        raise InputError(f"{capture.name}: where the camera is, is not known; give its pose")
    camera, R_WC, p_WC = capture.camera, capture.X_WC[:3, :3], capture.X_WC[:3, 3]
    half = 0.5 * np.array(table.size)
    ends = np.linspace(-1.0, 1.0, 9)
    across, along = np.meshgrid(ends * half[0], ends * half[1])
    top = np.stack([across, along, np.zeros_like(across)], axis=-1) + table.top_centre
    p_CT = (top.reshape(-1, 3) - p_WC) @ R_WC
    if p_WC[2] <= table.height or (p_CT[:, 2] <= 0.0).any():
        raise InputError(f"{capture.name}: the camera does not look down on the whole table")
    pixels = camera.project(p_CT)
    shape = np.array([camera.width, camera.height])
    low = np.clip(np.floor(pixels.min(axis=0)).astype(int), 0, shape)
    high = np.clip(np.ceil(pixels.max(axis=0)).astype(int) + 1, 0, shape)
    if (high - low < _MIN_SIDE_PX).any():
        raise InputError(
            f"{capture.name}: the table is not in view; check the camera's pose, or turn it there"
        )
    window = (slice(low[1], high[1]), slice(low[0], high[0]))
    x, y = (axis[window] for axis in camera.rays())
    depth = np.array(capture.depth[window])
    rays_W = np.stack([x, y, np.ones_like(x)], axis=-1) @ R_WC.T
    level = depth * rays_W[..., 2] + p_WC[2]
    _check_level(depth, level, rays_W, capture, table)
    depth[level < table.height - _MAX_DEPTH_M] = 0.0
    return _window(capture, depth, int(low[0]), int(low[1]))


def _check_level(
    depth: NDArray[np.float32],
    level: NDArray[np.float64],
    rays_W: NDArray[np.float64],
    capture: Capture,
    table: Table,
) -> None:
    """Refuse a pose by which most of what is seen on the table lies far below its top.

    Args:
        depth: (h, w) readings of the table's window, metres.
        level: (h, w) their world z, metres.
        rays_W: (h, w, 3) directions of the pixels in the world.
        capture: with the pose, for messages.
        table: the working table.

    Raises:
        InputError: naming both heights.
    """
    p_WC = np.asarray(capture.X_WC)[:3, 3]
    down = np.minimum(rays_W[..., 2], -1e-6)
    where = p_WC[:2] + rays_W[..., :2] * ((table.height - p_WC[2]) / down)[..., None]
    on_table = (depth > 0.0) & ~table.outside(where)
    below = on_table & (level < table.height - _MAX_DEPTH_M)
    seen = max(1, int(np.count_nonzero(on_table)))
    if int(np.count_nonzero(below)) > _MAX_BELOW * seen:
        raise InputError(
            f"{capture.name}: by the camera's pose, what lies where the table should be is at "
            f"{float(np.median(level[below])):.3f} m, the cell's table at {table.height:.3f} m; "
            "check the pose (metres, and of the camera in the world) and the depth unit"
        )


def crop_to_region(capture: Capture, region: Sequence[int]) -> Capture:
    """Crop a capture to a part of its image.

    Args:
        capture: any capture.
        region: left, top, right, bottom, pixels; right and bottom are not in it.

    Raises:
        InputError: the region is empty, too small or not within the image.
    """
    left, top, right, bottom = region
    rows, columns = capture.depth.shape
    if not (0 <= left < right <= columns and 0 <= top < bottom <= rows):
        raise InputError(
            f"{capture.name}: region {left},{top},{right},{bottom} is not within the image of "
            f"{columns} x {rows}; give left, top, right, bottom"
        )
    if min(right - left, bottom - top) < _MIN_SIDE_PX:
        raise InputError(
            f"{capture.name}: region {left},{top},{right},{bottom} is too small, wanted at least "
            f"{_MIN_SIDE_PX} pixels"
        )
    return _window(capture, np.array(capture.depth[top:bottom, left:right]), left, top)


def _window(capture: Capture, depth: NDArray[np.float32], left: int, top: int) -> Capture:
    """Return the capture of a window's depth, which begins at pixel (left, top)."""
    rows, columns = depth.shape
    colour = None
    if capture.colour is not None and capture.colour_registered:
        colour = capture.colour[top : top + rows, left : left + columns]
    elif capture.colour is not None:
        _log.warning(
            "%s: the colour image is not registered to depth, and is not used for a part of it; "
            "flat cloth is then not told from the table. Register it, and say --registered",
            capture.name,
        )
    at = capture.garment_at
    return Capture(
        depth=depth,
        camera=capture.camera.window(left, top, columns, rows),
        colour=colour,
        colour_registered=colour is not None,
        X_WC=capture.X_WC,
        name=capture.name,
        garment_at=None if at is None else (at[0] - left, at[1] - top),
    )
