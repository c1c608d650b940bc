"""`unwrinkle bench stereo`: pairs of 16 megapixels to range maps.

Time, memory, error, and rivals.
"""

import math
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.harness.report import Progress
from benchmarks.perception.stereo.memory import peak
from benchmarks.perception.stereo.methods import METHODS
from benchmarks.perception.stereo.page import page, plotted
from benchmarks.perception.stereo.real_pairs import figures
from benchmarks.perception.stereo.results import (
    DisparityErrors,
    HeightErrors,
    MatcherFigures,
    SceneFigures,
    SizeFigures,
    StereoResult,
    Times,
    WrinkleErrors,
)
from benchmarks.perception.stereo.scenes import Scene, cell_scene, near_scene
from unwrinkle.models.errors import InputError
from unwrinkle.perception.height_grid import Grid
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.stereo.heights import heights_on_grid
from unwrinkle.perception.stereo.matching import Disparity
from unwrinkle.perception.stereo.range_mapping import (
    StereoMatch,
    garment_space,
    match_pair,
    range_map_from_pair,
)
from unwrinkle.perception.wrinkles.analysis import Analysis, analyse
from unwrinkle.simulation.rendering.synthetic_towel import Ridge

_RESOLUTION = 0.0005
_GROSS = 0.003  # metres of height; larger errors are counted as well as averaged
_RIM = 0.010
_FACTORS = ((16, 1.0), (4, 0.5), (1, 0.25))
_INFLECTION = 1.0 - math.exp(-0.5)  # of a Gaussian's height lies above its inflections


def run(*, quick: bool, seed: int, progress: Progress) -> StereoResult:
    """Render, match, compare."""
    repeats = 2 if quick else 5
    steps = 9
    progress(0, steps, "rendering")
    terry = cell_scene("terry", seed)
    progress(1, steps, "time")
    times = _times(terry, repeats)
    progress(2, steps, "memory")
    memory = peak(terry)
    progress(3, steps, "error by size")
    sizes = [_size(terry, megapixels, factor, repeats) for megapixels, factor in _FACTORS]
    progress(4, steps, "rivals")
    methods = _methods(terry, quick)
    scenes = {"terry": _judged(terry)}
    progress(5, steps, "plain cloth")
    scenes["plain"] = _judged(cell_scene("plain", seed))
    progress(6, steps, "at 1.25 m")
    scenes["terry_near"] = _judged(near_scene("terry", seed))
    progress(7, steps, "plain cloth at 1.25 m")
    if not quick:
        scenes["plain_near"] = _judged(near_scene("plain", seed))
    progress(8, steps, "real pairs")
    real = figures()
    progress(9, steps, "done")
    ours, full = methods[0], methods[1]
    return StereoResult(
        pair_to_map_time_median=times.pair_to_map_median,
        peak_memory=memory,
        disparity_rms=scenes["terry"].rms,
        disparity_bias=scenes["terry"].bias,
        valid_fraction=scenes["terry"].valid,
        speedup_over_sgbm_full=full.time / ours.time,
        rms_ratio_over_sgbm_full=full.rms / ours.rms,
        times=times,
        scenes=scenes,
        sizes=tuple(sizes),
        methods=methods,
        real=real,
    )


def table(results: StereoResult) -> str:
    """Return the results as Markdown."""
    return page(results)


def plot(results: StereoResult, path: Path) -> None:
    """Draw time and error over the images' size."""
    plotted(results, path)


def pair_to_map(
    scene: Scene, factor: float = 1.0, *, whole: bool = True
) -> tuple[StereoMatch, NDArray[np.float64]]:
    """From the raw pair to heights above the working table on its grid.

    Args:
        scene: the pair.
        factor: that the images are reduced by first.
        whole: match the whole images, not only what can show the table.
    """
    pair = scene.reduced(factor)
    found = match_pair(pair, scene.head, scene.gaze, table=scene.table, whole=whole)
    return found, _map(found, scene)


def _map(found: StereoMatch, scene: Scene) -> NDArray[np.float64]:
    half = 0.5 * np.array(scene.table.size)
    low = np.array(scene.table.centre) - half
    count = np.rint(2.0 * half / _RESOLUTION).astype(int) + 1
    grid = Grid(float(low[0]), float(low[1]), int(count[0]), int(count[1]), _RESOLUTION)
    normal = found.X_WC[2, :3]
    distance = float(found.X_WC[2, 3]) - scene.table.height
    heights, _ = heights_on_grid(
        found.disparity, found.rectification, found.X_WC, (normal, distance), grid
    )
    return heights


def _times(scene: Scene, repeats: int) -> Times:
    pair_to_map(scene)  # compiles, and fills caches
    whole, region, product = [], [], []
    for _ in range(repeats):
        start = time.perf_counter()
        pair_to_map(scene)
        whole.append(time.perf_counter() - start)
        start = time.perf_counter()
        pair_to_map(scene, whole=False)
        region.append(time.perf_counter() - start)
        start = time.perf_counter()
        range_map_from_pair(scene.pair, scene.head, scene.gaze, table=scene.table)
        product.append(time.perf_counter() - start)
    return Times(
        pair_to_map_median=float(np.median(whole)),
        pair_to_map=tuple(whole),
        table_region_median=float(np.median(region)),
        garment_map_median=float(np.median(product)),
    )


def _errors(scene: Scene, found: StereoMatch, disparity: Disparity) -> DisparityErrors:
    true, cloth, per_pixel = scene.truth(found.rectification, found.X_WC)
    valid = disparity.valid & cloth
    if not valid.any():
        raise InputError(f"{scene.name}: nothing of the cloth was matched")
    error = (disparity.disparity - true)[valid]
    heights = error * per_pixel[valid]
    return DisparityErrors(
        rms=float(np.sqrt(np.mean(error**2))),
        bias=float(np.mean(error)),
        median=float(np.median(np.abs(error))),
        valid=float(np.count_nonzero(valid) / np.count_nonzero(cloth)),
        height_rms=float(np.sqrt(np.mean(heights**2))),
        gross=float(np.mean(np.abs(heights) > _GROSS)),
        height_per_pixel=float(np.median(per_pixel[valid])),
    )


def _size(scene: Scene, megapixels: int, factor: float, repeats: int) -> SizeFigures:
    pair_to_map(scene, factor)
    times = []
    for _ in range(repeats):
        pair = scene.reduced(factor)
        start = time.perf_counter()
        found = match_pair(pair, scene.head, scene.gaze, table=scene.table, whole=True)
        _map(found, scene)
        times.append(time.perf_counter() - start)
    return SizeFigures(
        megapixels=megapixels,
        time=float(np.median(times)),
        **vars(_errors(scene, found, found.disparity)),
    )


def _methods(scene: Scene, quick: bool) -> tuple[MatcherFigures, ...]:
    """Ours first, full-resolution SGBM second, on one rectified pair of the whole images."""
    found = match_pair(scene.pair, scene.head, scene.gaze, table=scene.table, whole=True)
    rectified = found.rectification.apply(scene.pair.left, scene.pair.right)
    X_LW = np.linalg.inv(scene.head.poses(scene.gaze)[0])
    box_L = garment_space(scene.table) @ X_LW[:3, :3].T + X_LW[:3, 3]
    lowest, highest = found.rectification.disparity_range(box_L)
    rows = []
    for name, method in METHODS.items():
        times = []
        for _ in range(1 if quick or name != "ours" else 3):
            start = time.perf_counter()
            disparity = method(*rectified, lowest, highest)
            times.append(time.perf_counter() - start)
        rows.append(
            MatcherFigures(
                name=name, time=float(np.median(times)), **vars(_errors(scene, found, disparity))
            )
        )
    return tuple(rows)


def _judged(scene: Scene) -> SceneFigures:
    """Disparities of the region, heights on the garment's grid, and wrinkles, against the truth."""
    found = match_pair(scene.pair, scene.head, scene.gaze, table=scene.table)
    range_map = range_map_from_pair(scene.pair, scene.head, scene.gaze, table=scene.table)
    analysis = analyse(range_map, table=scene.table)
    return SceneFigures(
        name=scene.name,
        distance=scene.distance,
        **vars(_errors(scene, found, found.disparity)),
        map=_map_errors(scene, range_map),
        spline=_spline_errors(scene, analysis),
        wrinkles=_wrinkle_errors(scene, analysis),
    )


def _map_errors(scene: Scene, range_map: RangeMap) -> HeightErrors:
    world = range_map.world_from_cell(_columns_and_rows(range_map.shape))
    return _against_truth(scene, world, np.asarray(range_map.height, float), range_map.valid)


def _spline_errors(scene: Scene, analysis: Analysis) -> HeightErrors:
    surface = analysis.surface
    world = surface.world(_columns_and_rows(surface.z.shape))
    return _against_truth(scene, world, np.asarray(surface.z, float), surface.inside)


def _columns_and_rows(shape: tuple[int, ...]) -> NDArray[np.float64]:
    rows, columns = np.indices(shape)
    return np.stack([columns, rows], axis=-1).astype(float)


def _against_truth(
    scene: Scene, world: NDArray[np.float64], heights: NDArray[np.float64], valid: NDArray[np.bool_]
) -> HeightErrors:
    x, y = world[..., 0], world[..., 1]
    cloth = (scene.towel.edge_distance(x, y) > _RIM) & valid
    error = (heights - scene.towel.height(x, y))[cloth]
    return HeightErrors(
        rms=float(np.sqrt(np.mean(error**2))),
        bias=float(np.mean(error)),
        median=float(np.median(np.abs(error))),
    )


def _wrinkle_errors(scene: Scene, analysis: Analysis) -> tuple[WrinkleErrors, ...]:
    """Compare the wrinkle found for each ridge with the truth: its width and chord height."""
    rows = []
    for ridge in scene.towel.ridges:
        nearest = min(
            analysis.wrinkles,
            key=lambda w: float(np.hypot(*(np.asarray(w.centre) - ridge.centre))),
            default=None,
        )
        width, height = 2.0 * ridge.sigma, ridge.height * _INFLECTION
        if nearest is None or not _same(ridge, np.asarray(nearest.centre)):
            rows.append(WrinkleErrors(width, height))
        else:
            off = nearest.width - width, nearest.chord_height - height
            rows.append(WrinkleErrors(width, height, *off))
    return tuple(rows)


def _same(ridge: Ridge, centre: NDArray[np.float64]) -> bool:
    away = centre - ridge.centre
    across = away[1] * math.cos(ridge.angle) - away[0] * math.sin(ridge.angle)
    return bool(abs(across) < ridge.sigma and np.hypot(*away) < 0.5 * ridge.length)
