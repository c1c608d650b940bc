"""Range mapping of image pairs: rectify, match, level on the known table, segment, grid."""

import dataclasses
import logging
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.arrays import Pose
from unwrinkle.models.errors import InputError, InsufficientViewError
from unwrinkle.models.table import Table
from unwrinkle.models.transforms import inverse, transformed
from unwrinkle.perception.camera import Camera
from unwrinkle.perception.depth.table_plane import TableFit, fit_table
from unwrinkle.perception.height_grid import Grid
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.sensor import NoiseProfile, noise_profile
from unwrinkle.perception.stereo.brightness import check_exposures, equalized
from unwrinkle.perception.stereo.epipolar import EpipolarCheck, corrected_rectification
from unwrinkle.perception.stereo.head import Eye, Gaze, StereoHead
from unwrinkle.perception.stereo.heights import heights_on_grid
from unwrinkle.perception.stereo.matching import Disparity, match
from unwrinkle.perception.stereo.pair import StereoPair
from unwrinkle.perception.stereo.rectification import Rectification, rectify
from unwrinkle.perception.stereo.speckle import remove_speckle
from unwrinkle.perception.stereo.table_view import TableView

#: Largest height above the table that is matched, metres.
_MAX_HEIGHT_M = 0.25

#: Largest depth below the table that is matched, metres.
_MAX_DEPTH_M = 0.03

#: Margin around the table in the matched region, metres.
_TABLE_MARGIN_M = 0.03

#: Rim of the table left out of the grid, metres: it may show the background.
_TABLE_RIM_M = 0.004

#: Margin of the range map around the garment, metres.
_MAP_MARGIN_M = 0.05

#: Reduction of the depth image in which the table is fitted.
_FIT_REDUCTION = 8

#: Least width of that image, pixels.
_FIT_WIDTH_PX = 400

#: Distance below which the table is seen with the noise of profile "stereo", metres.
_NEAR_DISTANCE_M = 1.6

#: Least fraction of measured pixels in a reduced pixel.
_MIN_MEASURED_FRACTION = 0.5

#: Depth below a fitted plane, metres, of readings that show that the plane is a garment's.
_BELOW_PLANE_M = 0.001

#: Fraction of such readings above which the table is fitted to them instead.
_MIN_BELOW_FRACTION = 0.06

#: Largest fraction of the table, or of the garment, without a match.
_MAX_HOLE_FRACTION = 0.4

#: Largest plausible tilt of the table, degrees.
_MAX_TILT_DEG = 2.0

#: Limit of the distance between the measured and the known table, metres: the effect of three
#: steps of both units.
LARGEST_TABLE_ERROR = 0.025

#: Tolerance of the image's scale between height and width.
_SHAPE_TOLERANCE = 0.002

_log = logging.getLogger(__name__)


def garment_space(table: Table) -> NDArray[np.float64]:
    """Return the corners (8, 3) of the matched space around the table's top, world, metres."""
    half = 0.5 * np.array(table.size) + _TABLE_MARGIN_M
    low = [*(table.centre - half), table.height - _MAX_DEPTH_M]
    high = [*(table.centre + half), table.height + _MAX_HEIGHT_M]
    corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T
    return np.asarray(corners, dtype=float)


def table_grid(table: Table, resolution: float) -> Grid:
    """Return the grid over the table's top, without its rim."""
    x, y = np.array(table.centre) - 0.5 * np.array(table.size) + _TABLE_RIM_M
    nx, ny = (int((length - 2.0 * _TABLE_RIM_M) / resolution) + 1 for length in table.size)
    return Grid(float(x), float(y), nx, ny, resolution)


@dataclass(frozen=True, eq=False)
class StereoMatch:
    """Matched image pair: rectification, camera pose and disparity.

    Attributes:
        rectification: geometry of the rectified pair; C is its left camera.
        X_WC: (4, 4) pose of C in the world.
        disparity: of the rectified left image.
        check: result of the epipolar check.
    """

    rectification: Rectification
    X_WC: Pose
    disparity: Disparity
    check: EpipolarCheck


def match_pair(
    pair: StereoPair,
    head: StereoHead,
    gaze: Gaze,
    *,
    table: Table,
    whole: bool = False,
) -> StereoMatch:
    """Rectify and match a pair.

    Args:
        pair: images of the calibrated size, or reduced equally in both directions.
        head: calibrated head.
        gaze: head angles when the pair was taken.
        table: defines the region and the disparity range.
        whole: match the whole common view instead of the region around the table.

    Raises:
        InputError: wrong image sizes, angles beyond the limits, or a table out of view.
        EpipolarError: the images are swapped or do not agree with the angles.
    """
    X_WL, X_WR = head.poses(gaze)
    left_camera, right_camera = _camera(head.left, pair), _camera(head.right, pair)
    box_L = transformed(inverse(X_WL), garment_space(table))
    X_LR = inverse(X_WL) @ X_WR
    _check_view(left_camera, box_L, pair)
    rectification = rectify(left_camera, right_camera, X_LR, region=None if whole else box_L)
    left, right = _grey(pair.left), _grey(pair.right)
    check_exposures(left, right, pair.name)
    rectification, check = corrected_rectification(left, right, rectification, pair.name)
    left, right = rectification.apply(left, right)
    right = equalized(left, right, pair.name)
    lowest, highest = rectification.disparity_range(box_L)
    disparity = remove_speckle(match(left, right, lowest, highest))
    return StereoMatch(rectification, X_WL @ rectification.X_LC, disparity, check)


def range_map_from_pair(
    pair: StereoPair,
    head: StereoHead,
    gaze: Gaze,
    *,
    table: Table,
    profile: NoiseProfile | None = None,
    seed: int = 0,
) -> RangeMap:
    """Compute the range map of an image pair: match, segment the garment, grid the heights.

    The table's height is known better than the angle between the eyes. The height error of the
    measured plane is therefore corrected by a constant disparity offset, if the resolution of the
    units explains it.

    Args:
        pair, head, gaze: see `match_pair`.
        table: the working table.
        profile: noise of the sensor; None chooses it by the distance.
        seed: of the plane's consensus and GrabCut.

    Raises:
        InputError: as `match_pair`; or the measured table is tilted or too far from the known one.
        InsufficientViewError: too little of the table or of the garment was matched.
        NoGarmentError: there is no garment on the table.
    """
    found = match_pair(pair, head, gaze, table=table)
    profile = profile or _profile(found, table)
    offset = _known_height(found, table, profile, pair.name, seed)
    grid = table_grid(table, _resolution(found, table, profile, pair.name))
    height, valid = table_heights(found, table, grid, offset=offset)
    camera = found.rectification.camera
    view = TableView(grid, height, valid, table.height, camera, found.X_WC, pair.name)
    colour = view.colour(found.rectification.apply_colour(pair.left))
    garment = view.garment(colour, profile, seed)
    height, rms = view.levelled(garment)
    _log.info("%s: the table is level to %.2f mm RMS", pair.name, 1e3 * rms)
    _check_holes(garment, valid, pair.name)
    rows, columns = (_window(np.asarray(garment.any(axis=k)), grid.resolution) for k in (1, 0))
    window = (rows, columns)
    return RangeMap(
        height=height[window].astype(np.float32),
        valid=valid[window],
        garment=garment[window],
        resolution=grid.resolution,
        origin=np.array([grid.x_first, grid.y_first])
        + grid.resolution * np.array([columns.start, rows.start]),
        table_height=table.height,
        sensor=profile.name,
        colour=colour[window],
    )


def table_heights(
    found: StereoMatch, table: Table, grid: Grid, *, offset: float = 0.0
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Compute the heights of a matched pair on a grid over the table.

    Args:
        found: the matched pair.
        table: reference of the heights.
        grid: output grid.
        offset: added to disparities, pixels.

    Returns:
        Heights (ny, nx) above the table, metres, 0 in cells without data, and the mask (ny, nx) of
        cells with data.
    """
    return heights_on_grid(
        found.disparity,
        found.rectification,
        found.X_WC,
        (found.X_WC[2, :3], float(found.X_WC[2, 3]) - table.height),
        grid,
        offset=offset,
        band=(-_MAX_DEPTH_M, _MAX_HEIGHT_M),
    )


def _profile(found: StereoMatch, table: Table) -> NoiseProfile:
    """Return the noise profile for the distance of the table."""
    away = float(np.linalg.norm(np.array([*table.centre, table.height]) - found.X_WC[:3, 3]))
    return noise_profile("stereo" if away < _NEAR_DISTANCE_M else "stereo-head")


def _resolution(found: StereoMatch, table: Table, profile: NoiseProfile, name: str) -> float:
    """Return the cell size, metres: the profile's, or the pixel spacing on the table if larger."""
    towards = np.array([*table.centre, table.height]) - found.X_WC[:3, 3]
    distance = float(np.linalg.norm(towards))
    spacing = distance**2 / (found.rectification.camera.fx * -float(towards[2]))
    if spacing <= profile.resolution:
        return profile.resolution
    coarser = float(np.ceil(spacing * 1e4) / 1e4)
    _log.info(
        "%s: pixels lie up to %.2f mm apart, the grid is made %.1f mm instead of %.1f mm",
        name,
        1e3 * spacing,
        1e3 * coarser,
        1e3 * profile.resolution,
    )
    return coarser


def _check_holes(garment: NDArray[np.bool_], valid: NDArray[np.bool_], name: str) -> None:
    holes = 1.0 - np.count_nonzero(garment & valid) / np.count_nonzero(garment)
    if holes > _MAX_HOLE_FRACTION:
        raise InsufficientViewError(
            f"{name}: insufficient view, {holes:.0%} of the garment could not be matched, at "
            f"most {_MAX_HOLE_FRACTION:.0%} may lack; look again with more light or better focus"
        )


def _window(occupied: NDArray[np.bool_], resolution: float) -> slice:
    where = np.flatnonzero(occupied)
    margin = round(_MAP_MARGIN_M / resolution)
    return slice(max(0, int(where[0]) - margin), int(where[-1]) + margin + 1)


def _grey(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), dtype=np.uint8)


def _camera(eye: Eye, pair: StereoPair) -> Camera:
    height, width = pair.left.shape[:2]
    factor = width / eye.camera.width
    if abs(height / eye.camera.height - factor) > _SHAPE_TOLERANCE or factor > 1.0:
        raise InputError(
            f"{pair.name}: images of {width} x {height}, the {eye.name} eye is calibrated for "
            f"{eye.camera.width} x {eye.camera.height}; neither crop nor enlarge them"
        )
    return dataclasses.replace(eye.camera.scaled(factor), width=width, height=height)


def _check_view(camera: Camera, box_L: NDArray[np.float64], pair: StereoPair) -> None:
    """Check that the middle of the table is in view."""
    x, y, z = box_L.mean(axis=0)
    u, v = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
    if z <= 0.0 or not (0.0 <= u < camera.width and 0.0 <= v < camera.height):
        raise InputError(
            f"{pair.name}: by its angles the head does not look at the working table; check the "
            "angles and the turn-table's, in radians"
        )


def _reduced(found: StereoMatch, table: Table, name: str) -> tuple[NDArray[np.float32], Camera]:
    """Return the depth image of the table, reduced, and its camera.

    Raises:
        InsufficientViewError: too little of the table could be matched.
    """
    camera = found.rectification.camera
    factor = min(1.0, max(1.0 / _FIT_REDUCTION, _FIT_WIDTH_PX / camera.width))
    size = (round(camera.width * factor), round(camera.height * factor))
    valid = found.disparity.valid.astype(np.float32)
    weight = cv2.resize(valid, size, interpolation=cv2.INTER_AREA)
    total = cv2.resize(found.disparity.disparity * valid, size, interpolation=cv2.INTER_AREA)
    small = dataclasses.replace(camera.scaled(factor), width=size[0], height=size[1])
    rays = np.stack([*small.rays(), np.ones(size[::-1])], axis=-1) @ found.X_WC[:3, :3].T
    p_WC = found.X_WC[:3, 3]
    on_table = p_WC + rays * ((table.height - p_WC[2]) / rays[..., 2:])
    near = np.abs(on_table[..., :2] - table.centre) < 0.5 * np.array(table.size)
    expected = near.all(axis=-1)
    seen = expected & (weight > _MIN_MEASURED_FRACTION)
    holes = 1.0 - float(np.count_nonzero(seen)) / max(1.0, float(np.count_nonzero(expected)))
    if holes > _MAX_HOLE_FRACTION:
        raise InsufficientViewError(
            f"{name}: insufficient view, {holes:.0%} of the table could not be matched, at "
            f"most {_MAX_HOLE_FRACTION:.0%} may lack; look again with more light or better focus"
        )
    mean = np.divide(total, weight, out=np.zeros_like(total), where=seen)
    depth = np.where(seen, found.rectification.depth(mean), np.float32(0.0))
    return depth, small


def _lowest_plane(
    depths: NDArray[np.float32], camera: Camera, profile: NoiseProfile, seed: int, name: str
) -> TableFit:
    """Fit the table, even if a flat garment fills more of the view than the table."""
    fit = fit_table(depths, camera, profile, seed=seed, name=name)
    below = (depths > 0.0) & (fit.height < -_BELOW_PLANE_M)
    if np.count_nonzero(below) > _MIN_BELOW_FRACTION * np.count_nonzero(depths):
        fit = fit_table(depths, camera, profile, exclude=~below, seed=seed, name=name)
    return fit


def _known_height(
    found: StereoMatch, table: Table, profile: NoiseProfile, name: str, seed: int
) -> float:
    """Return the disparity offset, pixels, that puts the table at its known height.

    Raises:
        InputError: the table is tilted, or off by more than the units' resolution explains.
    """
    depths, camera = _reduced(found, table, name)
    fit = _lowest_plane(depths, camera, profile, seed, name)
    R_WC, p_WC = found.X_WC[:3, :3], found.X_WC[:3, 3]
    normal_W = R_WC @ fit.normal_C
    lean = float(np.degrees(np.arccos(np.clip(normal_W[2], -1.0, 1.0))))
    if lean > _MAX_TILT_DEG:
        raise InputError(
            f"{name}: by the head's angles the table leans by {lean:.1f} degrees, at most "
            f"{_MAX_TILT_DEG:.0f} are plausible; check the angles and the calibration"
        )
    towards = np.array([*table.centre, table.height]) - p_WC
    ray = (R_WC.T @ towards) / (R_WC[:, 2] @ towards)  # (x, y, 1) in C
    depth = -fit.distance / float(fit.normal_C @ ray)
    off = float(p_WC[2] + depth * (R_WC[2] @ ray)) - table.height
    if abs(off) > LARGEST_TABLE_ERROR:
        raise InputError(
            f"{name}: by the head's angles the table is at {table.height + off:.3f} m, the cell "
            f"has it at {table.height:.3f} m (at most {1e3 * LARGEST_TABLE_ERROR:.0f} mm apart); "
            "check the angles, the calibration, and that the working table is in view"
        )
    rectification = found.rectification
    wanted = float(towards @ R_WC[:, 2])
    offset = rectification.camera.fx * rectification.baseline * (1.0 / wanted - 1.0 / depth)
    _log.info("%s: table off by %.1f mm, %.2f px added", name, 1e3 * off, offset)
    return float(offset)
