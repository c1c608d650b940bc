"""From a pair of images and the head's angles to a range map on the working table."""

import dataclasses
import logging
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from unwrinkle.models import InputError
from unwrinkle.models.arrays import Pose
from unwrinkle.models.transforms import inverse, transformed
from unwrinkle.perception.camera import Camera
from unwrinkle.perception.depth.table_plane import TableFit, fit_table
from unwrinkle.perception.height_grid import Grid
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.sensor import NoiseProfile, noise_profile
from unwrinkle.perception.stereo.epipolar import EpipolarCheck, corrected_rectification
from unwrinkle.perception.stereo.head import Eye, Gaze, StereoHead
from unwrinkle.perception.stereo.heights import heights_on_grid
from unwrinkle.perception.stereo.matching import Disparity, match
from unwrinkle.perception.stereo.pair import StereoPair
from unwrinkle.perception.stereo.rectification import Rectification, rectify
from unwrinkle.perception.stereo.speckle import without_islands
from unwrinkle.perception.stereo.table_view import TableView

_TALLEST = 0.25  # nothing on the table that matters is higher, metres
_DEEPEST = 0.03  # the table may be lower than expected by this
_MARGIN = 0.03  # seen around the table, metres
_RIM = 0.004
_AROUND = 0.05  # metres of the map around the garment
_COARSE = 8  # the table is sought in depth reduced by this, down to the width below
_COARSE_WIDTH = 400
_NEAR = 1.6  # metres; a table nearer than this is seen with less noise
_HALF_SEEN = 0.5
_UNDER = 0.001  # metres under a plane where the table is, if the plane was a garment's
_LEAST_TABLE = 0.06  # share of the view that the table then has
_MOST_HOLES = 0.4
_MOST_LEAN = 2.0
#: Most that the measured table may lie off the known one: what three steps of both units explain.
LARGEST_TABLE_ERROR = 0.025
_SHAPE_TOLERANCE = 0.002

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class KnownTable:
    """The working table as the cell knows it, metres in the world.

    Attributes:
        centre: x, y.
        size: along x and y.
        height: z of its top.
    """

    centre: tuple[float, float] = (0.0, -1.2)
    size: tuple[float, float] = (0.8, 0.8)
    height: float = 0.70

    def box(self) -> NDArray[np.float64]:
        """Corners (8, 3) of the space over the table where a garment can be."""
        half = 0.5 * np.array(self.size) + _MARGIN
        low = [*(self.centre - half), self.height - _DEEPEST]
        high = [*(self.centre + half), self.height + _TALLEST]
        corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T
        return np.asarray(corners, dtype=float)

    def grid(self, resolution: float) -> Grid:
        """The grid over the table's top, less a rim that may show what is behind it."""
        x, y = np.array(self.centre) - 0.5 * np.array(self.size) + _RIM
        nx, ny = (int((length - 2.0 * _RIM) / resolution) + 1 for length in self.size)
        return Grid(float(x), float(y), nx, ny, resolution)


@dataclass(frozen=True, eq=False)
class StereoLook:
    """A matched pair: everything up to the metric range map, before the garment is sought.

    Attributes:
        rectification: geometry of the rectified pair; C is its left camera.
        X_WC: (4, 4) pose of C in the world.
        disparity: of the rectified left image.
        check: what the epipolar check found.
    """

    rectification: Rectification
    X_WC: Pose
    disparity: Disparity
    check: EpipolarCheck


def look(
    pair: StereoPair,
    head: StereoHead,
    gaze: Gaze,
    *,
    table: KnownTable | None = None,
    whole: bool = False,
) -> StereoLook:
    """Rectify and match a pair.

    Args:
        pair: the images; of the calibrated size or reduced alike in both directions.
        head: calibrated head.
        gaze: its angles when the pair was taken.
        table: gives the region and the range of disparities; None for the Glasgow cell's.
        whole: match all that both eyes see, not only what can show the table.

    Raises:
        InputError: sizes that do not fit, angles beyond the limits, a table out of view, images
            swapped or out of step with the angles.
    """
    table = table or KnownTable()
    X_WL, X_WR = head.poses(gaze)
    left_camera, right_camera = _camera(head.left, pair), _camera(head.right, pair)
    box_L = transformed(inverse(X_WL), table.box())
    X_LR = inverse(X_WL) @ X_WR
    _check_view(left_camera, box_L, pair)
    rectification = rectify(left_camera, right_camera, X_LR, region=None if whole else box_L)
    left, right = _grey(pair.left), _grey(pair.right)
    rectification, check = corrected_rectification(left, right, rectification, pair.name)
    left, right = rectification.apply(left, right)
    lowest, highest = rectification.disparity_range(box_L)
    disparity = without_islands(match(left, right, lowest, highest))
    return StereoLook(rectification, X_WL @ rectification.X_LC, disparity, check)


def range_map_from_pair(
    pair: StereoPair,
    head: StereoHead,
    gaze: Gaze,
    *,
    table: KnownTable | None = None,
    profile: NoiseProfile | None = None,
    seed: int = 0,
) -> RangeMap:
    """Match a pair, find the garment on the table and lay its heights on the metric grid.

    The table's height is known better than the angle between the eyes: what the measured plane is
    off by is taken out as a constant of the disparity, where the units' steps can explain it.

    Args:
        pair, head, gaze: see `look`.
        table: the working table; None for the Glasgow cell's.
        profile: noise of the sensor; None for that of the distance.
        seed: of the plane's consensus and GrabCut.

    Raises:
        InputError: as `look`; too little of the table was matched, it leans or lies too far from
            where the cell has it, or there is no garment.
    """
    table = table or KnownTable()
    found = look(pair, head, gaze, table=table)
    profile = profile or _profile(found, table)
    offset = _known_height(found, table, profile, pair.name, seed)
    grid = table.grid(_resolution(found, table, profile, pair.name))
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
    found: StereoLook, table: KnownTable, grid: Grid, *, offset: float = 0.0
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Lay a matched pair on a grid over the table.

    Args:
        found: the pair.
        table: that heights count from.
        grid: where to.
        offset: added to disparities, pixels.

    Returns:
        (ny, nx) metres above the table, 0 where there is nothing, and (ny, nx) bool where there is.
    """
    return heights_on_grid(
        found.disparity,
        found.rectification,
        found.X_WC,
        (found.X_WC[2, :3], float(found.X_WC[2, 3]) - table.height),
        grid,
        offset=offset,
        band=(-_DEEPEST, _TALLEST),
    )


def _profile(found: StereoLook, table: KnownTable) -> NoiseProfile:
    """The noise that this distance has."""
    away = float(np.linalg.norm(np.array([*table.centre, table.height]) - found.X_WC[:3, 3]))
    return noise_profile("stereo" if away < _NEAR else "stereo-head")


def _resolution(found: StereoLook, table: KnownTable, profile: NoiseProfile, name: str) -> float:
    """Cell size, metres: the profile's, or coarser where pixels lie further apart on the table."""
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
    if holes > _MOST_HOLES:
        raise InputError(
            f"{name}: insufficient view, {holes:.0%} of the garment could not be matched, at "
            f"most {_MOST_HOLES:.0%} may lack; look again with more light or better focus"
        )


def _window(occupied: NDArray[np.bool_], resolution: float) -> slice:
    where = np.flatnonzero(occupied)
    margin = round(_AROUND / resolution)
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
    """Refuse a gaze that does not have the middle of the table in view."""
    x, y, z = box_L.mean(axis=0)
    u, v = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
    if z <= 0.0 or not (0.0 <= u < camera.width and 0.0 <= v < camera.height):
        raise InputError(
            f"{pair.name}: by its angles the head does not look at the working table; check the "
            "angles and the turn-table's, in radians"
        )


def _reduced(found: StereoLook, table: KnownTable, name: str) -> tuple[NDArray[np.float32], Camera]:
    """Depth of what is on the table, on a smaller image of the rectified left camera.

    Raises:
        InputError: too little of the table could be matched.
    """
    camera = found.rectification.camera
    factor = min(1.0, max(1.0 / _COARSE, _COARSE_WIDTH / camera.width))
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
    seen = expected & (weight > _HALF_SEEN)
    holes = 1.0 - float(np.count_nonzero(seen)) / max(1.0, float(np.count_nonzero(expected)))
    if holes > _MOST_HOLES:
        raise InputError(
            f"{name}: insufficient view, {holes:.0%} of the table could not be matched, at "
            f"most {_MOST_HOLES:.0%} may lack; look again with more light or better focus"
        )
    mean = np.divide(total, weight, out=np.zeros_like(total), where=seen)
    depth = np.where(seen, found.rectification.depth(mean), np.float32(0.0))
    return depth, small


def _lowest_plane(
    depths: NDArray[np.float32], camera: Camera, profile: NoiseProfile, seed: int
) -> TableFit:
    """Fit the table, also where more of the view is a garment lying flat on it."""
    fit = fit_table(depths, camera, profile, seed=seed)
    below = (depths > 0.0) & (fit.height < -_UNDER)
    if np.count_nonzero(below) > _LEAST_TABLE * np.count_nonzero(depths):
        fit = fit_table(depths, camera, profile, exclude=~below, seed=seed)
    return fit


def _known_height(
    found: StereoLook, table: KnownTable, profile: NoiseProfile, name: str, seed: int
) -> float:
    """Return what must be added to disparities, pixels, to see the table at its known height.

    Raises:
        InputError: the table leans, or lies off by more than the units' resolution explains.
    """
    depths, camera = _reduced(found, table, name)
    try:
        fit = _lowest_plane(depths, camera, profile, seed)
    except InputError as error:
        raise type(error)(str(error).replace("capture:", f"{name}:", 1)) from None
    R_WC, p_WC = found.X_WC[:3, :3], found.X_WC[:3, 3]
    normal_W = R_WC @ fit.normal_C
    lean = float(np.degrees(np.arccos(np.clip(normal_W[2], -1.0, 1.0))))
    if lean > _MOST_LEAN:
        raise InputError(
            f"{name}: by the head's angles the table leans by {lean:.1f} degrees, at most "
            f"{_MOST_LEAN:.0f} are plausible; check the angles and the calibration"
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
