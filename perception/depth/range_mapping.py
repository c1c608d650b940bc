"""From a capture to a range map: table plane, garment mask, place in the world, metric grid."""

import logging
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unwrinkle.models import InputError
from unwrinkle.perception.camera import Camera
from unwrinkle.perception.depth.capture import DEFAULT_CAMERA, Capture, load_capture, save_capture
from unwrinkle.perception.depth.segmentation import Segmentation, one_piece, segment
from unwrinkle.perception.depth.table_plane import TableFit, fit_table
from unwrinkle.perception.height_grid import Grid, average
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.sensor import NoiseProfile, noise_profile

__all__ = [
    "DEFAULT_CAMERA",
    "DEFAULT_CENTRE",
    "DEFAULT_TABLE_HEIGHT",
    "Capture",
    "load_capture",
    "range_map_from_capture",
    "save_capture",
    "segment_capture",
]

DEFAULT_CENTRE = (0.0, -1.10)
DEFAULT_TABLE_HEIGHT = 0.70
_MARGIN = 0.05
_MOST_HOLES_ON_GARMENT = 0.5
_DEEPEST = 0.02
_MOST_LEAN = 3.0
_COARSER = 1.25
_TIDY = 0.006  # notches and spikes of the mask narrower than twice this go
_OCCLUDES = 0.012  # a reading this far above a cell hides it from the camera
_UNKNOWN_GREY = 128

_log = logging.getLogger(__name__)


def range_map_from_capture(
    capture: Capture,
    *,
    profile: NoiseProfile | None = None,
    centre: tuple[float, float] = DEFAULT_CENTRE,
    table_height: float = DEFAULT_TABLE_HEIGHT,
    yaw: float = 0.0,
    seed: int = 0,
) -> RangeMap:
    """Fit the table, find the garment, and lay it on the metric grid of the world.

    With the camera's pose the garment is where it is. Without it the garment's centre of area is
    laid at `centre` on a table of `table_height`, the image's upper edge away from the robot
    (towards -y), so that the robot sees it as the image shows it.

    Args:
        capture: depth with its camera.
        profile: noise of the sensor; None takes the camera's.
        centre: world x, y for the garment's centre where the pose is unknown, metres.
        table_height: world z of the table where the pose is unknown, metres.
        yaw: turn about the world's z where the pose is unknown, radians.
        seed: of the plane's consensus and GrabCut.

    Raises:
        InputError: no table, no garment, too many holes, or a pose that the table contradicts.
    """
    profile = profile or noise_profile(capture.camera.sensor)
    table, segmentation = segment_capture(capture, profile, seed=seed)
    seen = capture.depth > 0.0
    holes = 1.0 - float(np.mean(seen[segmentation.garment]))
    if holes > _MOST_HOLES_ON_GARMENT:
        raise InputError(
            f"{capture.name}: insufficient view, {holes:.0%} of the garment has no reading, at "
            f"most {_MOST_HOLES_ON_GARMENT:.0%} may lack; look again"
        )
    _log.info(
        "%s: table at %.3f m, %.2f mm RMS; garment found by %s",
        capture.name,
        table.distance,
        1e3 * table.rms,
        segmentation.method,
    )
    points_C = _points(table.depth, capture.camera)
    if capture.X_WC is not None:
        R_WC, p_WC = capture.X_WC[:3, :3], capture.X_WC[:3, 3]
        table_height = _table_height(R_WC, p_WC, table, points_C, segmentation.garment, capture)
    else:
        R_WC, p_WC = _laid(table, points_C, segmentation.garment & seen, centre, table_height, yaw)
    return _gridded(capture, profile, table, segmentation, points_C, R_WC, p_WC, table_height)


def segment_capture(
    capture: Capture, profile: NoiseProfile, *, seed: int = 0
) -> tuple[TableFit, Segmentation]:
    """Fit the table and find the garment in the depth image's pixels.

    The plane is fitted twice: the second time without the garment, which biases it upwards.

    Raises:
        InputError: no table or no garment; the message names the capture.
    """
    seen = capture.depth > 0.0
    try:
        table = fit_table(capture.depth, capture.camera, profile, seed=seed)
        segmentation = segment(
            table.height,
            seen,
            profile,
            colour=capture.colour,
            registered=capture.colour_registered,
            seed=seed,
        )
        near = _grown(segmentation.garment)
        table = fit_table(capture.depth, capture.camera, profile, exclude=near, seed=seed)
    except InputError as error:
        raise type(error)(str(error).replace("capture:", f"{capture.name}:", 1)) from None
    return table, segmentation


def _grown(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    radius = max(3, mask.shape[1] // 100)
    grown = cv2.dilate(mask.astype(np.uint8), np.ones((2 * radius + 1,) * 2, np.uint8))
    return np.asarray(grown) > 0


def _points(depth: NDArray[np.float64], camera: Camera) -> NDArray[np.float64]:
    x, y = camera.rays()
    return np.stack([x * depth, y * depth, depth], axis=-1)


def _laid(
    table: TableFit,
    points_C: NDArray[np.float64],
    garment: NDArray[np.bool_],
    centre: tuple[float, float],
    table_height: float,
    yaw: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Pose (R_WC, p_WC) with the table level, the image's down along +y turned by yaw."""
    z_C = table.normal_C
    y_C = np.array([0.0, 1.0, 0.0]) - z_C[1] * z_C
    y_C /= np.linalg.norm(y_C)
    level = np.stack([np.cross(y_C, z_C), y_C, z_C])
    c, s = np.cos(yaw), np.sin(yaw)
    R_WC = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ level
    middle = (points_C[garment] @ R_WC.T).mean(axis=0)
    # A point of the plane is -distance along the normal from the camera.
    p_WC = np.array([centre[0] - middle[0], centre[1] - middle[1], table_height + table.distance])
    return R_WC, p_WC


def _table_height(
    R_WC: NDArray[np.float64],
    p_WC: NDArray[np.float64],
    table: TableFit,
    points_C: NDArray[np.float64],
    garment: NDArray[np.bool_],
    capture: Capture,
) -> float:
    normal_W = R_WC @ table.normal_C
    lean = float(np.degrees(np.arccos(np.clip(normal_W[2], -1.0, 1.0))))
    if lean > _MOST_LEAN:
        raise InputError(
            f"{capture.name}: by the camera's pose the table leans by {lean:.1f} degrees, at most "
            f"{_MOST_LEAN:.0f} are plausible; check the pose, or leave it out"
        )
    seen = garment & (capture.depth > 0.0)
    middle = points_C[seen].mean(axis=0)
    foot = middle - (table.normal_C @ middle + table.distance) * table.normal_C
    return float((R_WC @ foot + p_WC)[2])


def _gridded(
    capture: Capture,
    profile: NoiseProfile,
    table: TableFit,
    segmentation: Segmentation,
    points_C: NDArray[np.float64],
    R_WC: NDArray[np.float64],
    p_WC: NDArray[np.float64],
    table_height: float,
) -> RangeMap:
    camera = capture.camera
    usable = (table.depth > 0.0) & (table.height > -max(_DEEPEST, 8.0 * profile.depth_noise))
    plan = points_C @ R_WC[:2].T + p_WC[:2]
    on_garment = plan[segmentation.garment & usable]
    spacing = table.distance / min(camera.fx, camera.fy)
    resolution = profile.resolution
    if spacing > _COARSER * resolution:
        resolution = float(np.ceil(spacing * 1e4) / 1e4)
        _log.warning(
            "%s: pixels lie %.1f mm apart on the table, coarser than the grid of %.1f mm; "
            "the grid is made %.1f mm",
            capture.name,
            1e3 * spacing,
            1e3 * profile.resolution,
            1e3 * resolution,
        )
    try:
        grid = Grid.over(on_garment[:, 0], on_garment[:, 1], resolution, _MARGIN)
    except ValueError as error:
        raise InputError(f"{capture.name}: {error}; check the camera's intrinsics") from None
    xy = plan[usable]
    values = np.column_stack([table.height[usable], segmentation.garment[usable]])
    averages, valid = average(xy[:, 0], xy[:, 1], values, grid)
    height = averages[..., 0]
    x, y = np.meshgrid(
        grid.x_first + resolution * np.arange(grid.nx),
        grid.y_first + resolution * np.arange(grid.ny),
    )
    cells_W = np.stack([x, y, table_height + height], axis=-1)
    pixels = camera.project((cells_W - p_WC) @ R_WC).astype(np.float32)
    # Cells without a reading take the mask of the pixel that looks at them, unless something
    # nearer to the camera is what that pixel sees.
    looked_at = _sampled(segmentation.garment.astype(np.float32), pixels, cv2.BORDER_CONSTANT)
    in_front = _sampled(table.height.astype(np.float32), pixels, cv2.BORDER_CONSTANT)
    hidden = ~valid & (in_front > _OCCLUDES)
    share = np.where(valid, averages[..., 1], np.where(hidden, 0.0, looked_at))
    garment = one_piece(share > 0.5, max(2, round(_TIDY / resolution)))
    colour = None
    if segmentation.colour is not None:
        colour = _sampled(segmentation.colour, pixels, cv2.BORDER_REPLICATE)
        colour[hidden] = _UNKNOWN_GREY
    return RangeMap(
        height=height.astype(np.float32),
        valid=valid,
        garment=garment,
        resolution=resolution,
        origin=np.array([grid.x_first, grid.y_first]),
        table_height=table_height,
        sensor=profile.name,
        colour=colour,
    )


def _sampled(image: NDArray[Any], pixels: NDArray[np.float32], border: int) -> NDArray[Any]:
    return np.asarray(
        cv2.remap(image, pixels[..., 0], pixels[..., 1], cv2.INTER_LINEAR, borderMode=border)
    )
