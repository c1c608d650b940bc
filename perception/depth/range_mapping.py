"""Range mapping of depth captures: table plane, garment mask, world pose, metric grid."""

import dataclasses
import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.errors import InputError, InsufficientViewError
from unwrinkle.perception.depth.capture import DEFAULT_CAMERA, Capture, load_capture, save_capture
from unwrinkle.perception.depth.flying_pixels import without_flying_pixels
from unwrinkle.perception.depth.pieces import named_piece, refuse_other_pieces, without_high_objects
from unwrinkle.perception.depth.segmentation import Segmentation, one_piece, segment
from unwrinkle.perception.depth.table_choice import table_under_garment
from unwrinkle.perception.depth.table_plane import TableFit, fit_table
from unwrinkle.perception.height_grid import Grid, average
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.sensor import NoiseProfile, noise_profile

__all__ = [
    "DEFAULT_CAMERA",
    "Capture",
    "load_capture",
    "range_map_from_capture",
    "save_capture",
    "segment_capture",
]

#: Margin of the grid around the garment, metres.
_MAP_MARGIN_M = 0.05

#: Largest fraction of the garment without a reading.
_MAX_HOLE_FRACTION = 0.5

#: Depth below the table plane, metres, beyond which readings are ignored.
_MAX_DEPTH_M = 0.02

#: Depth below the table plane, metres, beyond which readings show something else.
_MAX_BELOW_M = 0.05

#: Fraction of flying pixels above which they are noted.
_MANY_FLYING = 0.005

#: Largest plausible tilt of the table, degrees.
_MAX_TILT_DEG = 3.0

#: Pixel spacing on the table, multiples of the profile's resolution, above which the grid is
#: made coarser.
_COARSER_RATIO = 1.25

#: Radius of the morphological smoothing of the garment's mask, metres.
_MASK_SMOOTHING_M = 0.006

#: Height of a reading in front of a cell, metres, above which it occludes the cell.
_OCCLUSION_HEIGHT_M = 0.012

#: Grey level of occluded cells.
_UNKNOWN_GREY = 128

_log = logging.getLogger(__name__)


def range_map_from_capture(
    capture: Capture,
    *,
    centre: Sequence[float],
    table_height: float,
    profile: NoiseProfile | None = None,
    yaw: float = 0.0,
    seed: int = 0,
) -> RangeMap:
    """Compute the range map of a capture: fit the table, segment the garment, grid the heights.

    If the camera's pose is unknown, the garment's centre of area is placed at `centre` on a table
    of `table_height`, with the image's upper edge away from the robot (towards -y).

    Args:
        capture: depth image with its camera.
        centre: world x, y of the garment's centre if the pose is unknown, metres.
        table_height: world z of the table if the pose is unknown, metres.
        profile: noise of the sensor; None for that of the camera.
        yaw: rotation about world z if the pose is unknown, radians.
        seed: of the plane's consensus and GrabCut.

    Raises:
        NoGarmentError: there is no garment on the table.
        InsufficientViewError: no table is found, or too much of the garment has no reading.
        InputError: by the camera's pose the table is not level.
    """
    profile = profile or noise_profile(capture.camera.sensor)
    capture = _cleaned(capture, profile)
    table, segmentation = segment_capture(capture, profile, seed=seed)
    seen = capture.depth > 0.0
    holes = 1.0 - float(np.mean(seen[segmentation.garment]))
    if holes > _MAX_HOLE_FRACTION:
        raise InsufficientViewError(
            f"{capture.name}: insufficient view, {holes:.0%} of the garment has no reading, at "
            f"most {_MAX_HOLE_FRACTION:.0%} may lack; look again"
        )
    _log.info(
        "%s: table at %.3f m, %.2f mm RMS; garment found by %s",
        capture.name,
        table.distance,
        1e3 * table.rms,
        segmentation.method,
    )
    points_C = capture.camera.unproject_image(table.depth)
    if capture.X_WC is not None:
        placed = _posed(capture, capture.X_WC, table, points_C, segmentation.garment)
    else:
        garment = segmentation.garment & seen
        placed = _laid(table, points_C, garment, centre, table_height, yaw)
    return _gridded(capture, profile, table, segmentation, placed)


@dataclass(frozen=True, eq=False)
class _PlacedPoints:
    """The points of a depth image and the pose of their camera.

    Attributes:
        points_C: (h, w, 3) in the camera frame C, metres.
        R_WC, p_WC: (3, 3) and (3,), pose of C in the world.
        table_height: world z of the table, metres.
    """

    points_C: NDArray[np.float64]
    R_WC: NDArray[np.float64]
    p_WC: NDArray[np.float64]
    table_height: float

    def plan(self) -> NDArray[np.float64]:
        """Return the world x, y (h, w, 2) of the points, metres."""
        return np.asarray(self.points_C @ self.R_WC[:2].T + self.p_WC[:2])

    def in_camera(self, points_W: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return world points (..., 3) in the camera frame, metres."""
        return np.asarray((points_W - self.p_WC) @ self.R_WC)


def _cleaned(capture: Capture, profile: NoiseProfile) -> Capture:
    """Return a capture without flying pixels."""
    depth, share = without_flying_pixels(capture.depth, profile.depth_noise)
    if share > _MANY_FLYING:
        _log.warning(
            "%s: %.1f%% of the readings lie far from all of their neighbours and are left out",
            capture.name,
            1e2 * share,
        )
    return capture if share == 0.0 else dataclasses.replace(capture, depth=depth)


def segment_capture(
    capture: Capture, profile: NoiseProfile, *, seed: int = 0
) -> tuple[TableFit, Segmentation]:
    """Fit the table and segment the garment in the depth image.

    The plane is fitted a second time without the garment, which biases it upwards.

    Raises:
        NoGarmentError: there is no garment on the table.
        SeveralGarmentsError: more than one thing may be it.
        InsufficientViewError: no table is found.
    """
    depth, camera, name = capture.depth, capture.camera, capture.name
    at = capture.garment_at
    table, below = table_under_garment(depth, camera, profile, seed=seed, name=name)
    pixel = table.distance / min(camera.fx, camera.fy)
    # What lies far below is the floor, or a reading that is none.
    on_table = (depth > 0.0) & (table.height > -_MAX_BELOW_M)
    kept = without_high_objects(table.height, on_table, pixel, name)
    segmentation = segment(
        table.height,
        kept,
        profile,
        colour=capture.colour,
        registered=capture.colour_registered,
        choose=None if at is None else lambda raised: named_piece(raised, pixel, name, at),
        seed=seed,
        name=name,
    )
    if at is None:
        refuse_other_pieces(segmentation.garment, segmentation.raised, pixel, name)
    near = _grown(segmentation.garment) | below
    table = fit_table(depth, camera, profile, exclude=near, seed=seed, name=name)
    high = on_table & ~kept
    if high.any():  # no reading of the garment, wherever it lies in plan
        table = dataclasses.replace(table, depth=np.where(high, 0.0, table.depth))
    return table, segmentation


def _grown(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    radius = max(3, mask.shape[1] // 100)
    grown = cv2.dilate(mask.astype(np.uint8), np.ones((2 * radius + 1,) * 2, np.uint8))
    return np.asarray(grown) > 0


def _laid(
    table: TableFit,
    points_C: NDArray[np.float64],
    garment: NDArray[np.bool_],
    centre: Sequence[float],
    table_height: float,
    yaw: float,
) -> _PlacedPoints:
    """Place the camera above a level table, with the image's down axis along +y rotated by yaw."""
    z_C = table.normal_C
    y_C = np.array([0.0, 1.0, 0.0]) - z_C[1] * z_C
    y_C /= np.linalg.norm(y_C)
    level = np.stack([np.cross(y_C, z_C), y_C, z_C])
    c, s = np.cos(yaw), np.sin(yaw)
    R_WC = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ level
    middle = (points_C[garment] @ R_WC.T).mean(axis=0)
    # The plane is `distance` below the camera along its normal.
    p_WC = np.array([centre[0] - middle[0], centre[1] - middle[1], table_height + table.distance])
    return _PlacedPoints(points_C, R_WC, p_WC, table_height)


def _posed(
    capture: Capture,
    X_WC: NDArray[np.float64],
    table: TableFit,
    points_C: NDArray[np.float64],
    garment: NDArray[np.bool_],
) -> _PlacedPoints:
    """Place the camera at its known pose; take the table's height from the plane below the garment.

    Raises:
        InputError: by the pose the table is not level.
    """
    R_WC, p_WC = X_WC[:3, :3], X_WC[:3, 3]
    normal_W = R_WC @ table.normal_C
    lean = float(np.degrees(np.arccos(np.clip(normal_W[2], -1.0, 1.0))))
    if lean > _MAX_TILT_DEG:
        raise InputError(
            f"{capture.name}: by the camera's pose the table leans by {lean:.1f} degrees, at most "
            f"{_MAX_TILT_DEG:.0f} are plausible; check the pose, or leave it out"
        )
    seen = garment & (capture.depth > 0.0)
    middle = points_C[seen].mean(axis=0)
    foot = middle - (table.normal_C @ middle + table.distance) * table.normal_C
    return _PlacedPoints(points_C, R_WC, p_WC, float((R_WC @ foot + p_WC)[2]))


def _gridded(
    capture: Capture,
    profile: NoiseProfile,
    table: TableFit,
    segmentation: Segmentation,
    placed: _PlacedPoints,
) -> RangeMap:
    """Average the heights above the table into the metric grid, with mask and colour."""
    camera = capture.camera
    usable = (table.depth > 0.0) & (table.height > -max(_MAX_DEPTH_M, 8.0 * profile.depth_noise))
    plan = placed.plan()
    on_garment = plan[segmentation.garment & usable]
    spacing = table.distance / min(camera.fx, camera.fy)
    resolution = profile.resolution
    if spacing > _COARSER_RATIO * resolution:
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
        grid = Grid.over(on_garment[:, 0], on_garment[:, 1], resolution, _MAP_MARGIN_M)
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
    cells_W = np.stack([x, y, placed.table_height + height], axis=-1)
    pixels = camera.project(placed.in_camera(cells_W)).astype(np.float32)
    # Cells without a reading take the mask of the pixel that they project to, unless that pixel
    # shows something nearer to the camera.
    looked_at = _sampled(segmentation.garment.astype(np.float32), pixels, cv2.BORDER_CONSTANT)
    in_front = _sampled(table.height.astype(np.float32), pixels, cv2.BORDER_CONSTANT)
    hidden = ~valid & (in_front > _OCCLUSION_HEIGHT_M)
    share = np.where(valid, averages[..., 1], np.where(hidden, 0.0, looked_at))
    garment = one_piece(share > 0.5, max(2, round(_MASK_SMOOTHING_M / resolution)))
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
        table_height=placed.table_height,
        sensor=profile.name,
        colour=colour,
        mask_by=segmentation.method,
    )


def _sampled(image: NDArray[Any], pixels: NDArray[np.float32], border: int) -> NDArray[Any]:
    return np.asarray(
        cv2.remap(image, pixels[..., 0], pixels[..., 1], cv2.INTER_LINEAR, borderMode=border)
    )
