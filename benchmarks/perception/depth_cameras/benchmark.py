"""The two depth cameras, structured light and time of flight: against real maps, laws and truth."""

import dataclasses
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.harness.report import Progress
from benchmarks.perception.depth_cameras.noise import (
    levels_of,
    noise_figures,
    real_capture,
    real_captures,
    step_of,
)
from benchmarks.perception.depth_cameras.page import page, plotted
from benchmarks.perception.depth_cameras.results import (
    DepthCamerasResult,
    GarmentView,
    LargestWrinkle,
    LeafView,
    MapFigures,
    NoiseLaws,
    RealMaps,
    RidgeSize,
    Section,
    View,
)
from benchmarks.perception.depth_cameras.scenes import (
    CENTRE,
    NEAR,
    TABLE,
    edge_figures,
    garment_scene,
    leaf_scene,
    look,
    stored,
)
from unwrinkle.models.robot import Cell, load_cell
from unwrinkle.perception.depth.range_mapping import range_map_from_capture
from unwrinkle.perception.depth.table_crop import crop_to_table
from unwrinkle.perception.wrinkles.analysis import analyse
from unwrinkle.simulation.depth_cameras.cameras import (
    DepthCameraModel,
    StructuredLightCamera,
    depth_image,
    load_depth_camera,
)
from unwrinkle.simulation.rendering.meshes import towel_mesh
from unwrinkle.simulation.rendering.renderer import Renderer
from unwrinkle.simulation.rendering.synthetic_towel import Towel, overhead_pose, wrinkled_towel

_HEIGHTS = (0.99, 1.06, 1.10)  # over the table: those of the real maps, and the cell's
_CELL_HEIGHT = 1.10
_CLOSE = 0.60  # over the table, 0.35 m over the leaf
_SEEDS = 6
_DISTANCES = (0.3, 0.5, 1.0, 1.5, 2.0, 3.0)
_LOOKS = 8
_CAMERAS = ("xtion", "tof")
_SHOWN = {"leaf": 11.0, "leaf close": 20.0, "garment": 15.0}  # degrees from the middle


def run(*, quick: bool, seed: int, progress: Progress) -> DepthCamerasResult:
    """Measure both cameras; fewer maps and one towel if quick."""
    cell = load_cell()
    models = {name: load_depth_camera(name) for name in _CAMERAS}
    paths = real_captures()[:: 4 if quick else 1]
    towels = 1 if quick else _SEEDS
    parts = len(paths) + towels + 3
    levels: list[NDArray[np.float64]] = []
    captures = []
    for done, path in enumerate(paths):
        progress(done, parts, path.stem)
        captures.append((path.stem.removesuffix("_depth_mm"), real_capture(path)))
        levels.append(levels_of(captures[-1][1].depth))
    xtion = models["xtion"]
    assert isinstance(xtion, StructuredLightCamera)
    step = xtion.inverse_step
    real = RealMaps()
    if captures:
        pooled = np.unique(np.concatenate(levels))
        found, rest = step_of(pooled, step)
        real = RealMaps(
            tuple(MapFigures(name=n, **vars(noise_figures(c, step, seed))) for n, c in captures),
            found,
            rest,
            len(pooled),
        )
    wrinkles: list[LargestWrinkle] = []
    simulated: list[MapFigures] = []
    for number in range(towels):
        progress(len(paths) + number, parts, f"towel {number}")
        towel = wrinkled_towel(seed + number)
        renderer = Renderer(cell, [towel_mesh(towel)], near=NEAR)
        for name, model in models.items():
            wrinkles.append(_wrinkle(cell, renderer, model, towel, seed + number))
            if name == "xtion" and number == 0:
                simulated = [
                    _simulated(cell, renderer, model, height, step, seed) for height in _HEIGHTS
                ]
    progress(parts - 3, parts, "leaf")
    leaf = _leaf(leaf_scene(cell), models, seed)
    progress(parts - 2, parts, "garment")
    garment = _garment(garment_scene(cell), models, seed)
    progress(parts - 1, parts, "laws")
    return DepthCamerasResult(
        real=real,
        simulated=tuple(simulated),
        simulated_step=step_of(levels_of(_tilted(xtion, seed)), step)[0],
        wrinkles=tuple(wrinkles),
        largest_found={
            name: float(np.mean([row.found for row in wrinkles if row.camera == name]))
            for name in models
        },
        leaf=leaf,
        garment=garment,
        laws=tuple(_law(distance, models, seed) for distance in _DISTANCES),
    )


def table(results: DepthCamerasResult) -> str:
    """Return the results as Markdown."""
    return page(results)


def plot(results: DepthCamerasResult, path: Path) -> None:
    """Draw what both cameras see of a leaf and of a garment, and the Xtion's noise."""
    plotted(results, path)


def _simulated(
    cell: Cell, renderer: Renderer, model: DepthCameraModel, height: float, step: float, seed: int
) -> MapFigures:
    X_WC = overhead_pose(*CENTRE, TABLE + height)
    capture = depth_image(renderer, model, X_WC, seed)
    figures = noise_figures(_cropped(cell, capture), step, seed)
    named = MapFigures(name=f"simulated, {height:.2f} m", **vars(figures))
    return dataclasses.replace(named, holes=_holes(capture.depth))


def _cropped(cell: Cell, capture: Any) -> Any:
    return crop_to_table(capture, cell.table)


def _holes(depth: NDArray[np.float32]) -> float:
    return float(np.mean(depth == 0.0))


def _wrinkle(
    cell: Cell, renderer: Renderer, model: DepthCameraModel, towel: Towel, seed: int
) -> LargestWrinkle:
    """The largest wrinkle as a camera in its place in the cell has it analysed."""
    X_WC = overhead_pose(*CENTRE, TABLE + _CELL_HEIGHT)
    clock = time.perf_counter()
    capture = depth_image(renderer, model, X_WC, seed)
    seconds = time.perf_counter() - clock
    analysis = analyse(
        range_map_from_capture(
            _cropped(cell, capture),
            seed=seed,
            centre=cell.scenario.garment_centre,
            table_height=cell.table.height,
        ),
        table=cell.table,
    )
    ridge = towel.ridges[0]
    row = LargestWrinkle(
        camera=model.name,
        seed=seed,
        time=seconds,
        holes=_holes(capture.depth),
        wrinkles=len(analysis.wrinkles),
        truth=RidgeSize(ridge.length, 2.0 * ridge.sigma, ridge.height * (1.0 - np.exp(-0.5))),
    )
    if not analysis.wrinkles:
        return row
    wrinkle = analysis.wrinkles[0]
    along = np.array([np.cos(ridge.angle), np.sin(ridge.angle)])
    offset = np.asarray(wrinkle.centre)[:2] - ridge.centre
    beside = float(abs(along[0] * offset[1] - along[1] * offset[0]))
    direction = np.asarray(wrinkle.direction)[:2]
    turn = float(np.degrees(np.arccos(np.clip(abs(along @ direction), 0.0, 1.0))))
    return dataclasses.replace(
        row,
        found=beside < 0.01 and turn < 10.0,
        beside=beside,
        turn=turn,
        length=wrinkle.length,
        width=wrinkle.width,
        chord_height=wrinkle.chord_height,
    )


def _leaf(
    renderer: Renderer, models: dict[str, DepthCameraModel], seed: int
) -> dict[str, LeafView]:
    """The leaf by both cameras, from the cell's height and from near by."""
    result = {}
    for name, model in models.items():
        for key, height in ((name, _CELL_HEIGHT), (f"{name}_close", _CLOSE)):
            truth, reading = look(renderer, model, height, seed)
            shown = _SHOWN["leaf" if key == name else "leaf close"]
            result[key] = LeafView(
                **vars(_view(truth, reading, model, height, shown)),
                edge=edge_figures(truth, reading, model, height),
            )
    return result


def _garment(
    renderer: Renderer, models: dict[str, DepthCameraModel], seed: int
) -> dict[str, GarmentView]:
    """The folded towel by both cameras."""
    result = {}
    for name, model in models.items():
        truth, reading = look(renderer, model, _CELL_HEIGHT, seed)
        on = truth > 0.001
        result[name] = GarmentView(
            **vars(_view(truth, reading, model, _CELL_HEIGHT, _SHOWN["garment"])),
            garment_holes=float(np.mean(np.isnan(reading[on]))),
        )
    return result


def _view(
    truth: NDArray[np.float64],
    reading: NDArray[np.float64],
    model: DepthCameraModel,
    height: float,
    shown: float,
) -> View:
    """Pictures of the middle of the image, and its middle row."""
    row = truth.shape[0] // 2
    x, _ = model.camera.rays()
    half = int(model.camera.fx * np.tan(np.radians(shown)))
    middle = tuple(slice(max(0, length // 2 - half), length // 2 + half) for length in truth.shape)
    return View(
        height=height,
        holes=float(np.mean(np.isnan(reading))),
        section=Section(ray=_plain(x[row]), truth=_plain(truth[row]), reading=_plain(reading[row])),
        truth=stored(truth[middle]),
        reading=stored(reading[middle]),
    )


def _plain(values: NDArray[np.float64]) -> tuple[float | None, ...]:
    return tuple(round(float(value), 5) if np.isfinite(value) else None for value in values)


def _tilted(model: DepthCameraModel, seed: int) -> NDArray[np.float32]:
    """Reading of a plane that goes from 0.85 to 1.25 m, which has every level of the sensor."""
    camera = model.ideal_camera
    inverse = np.linspace(1.0 / 0.85, 1.0 / 1.25, camera.height)
    return model.measured(np.tile(1.0 / inverse[:, None], (1, camera.width)), seed)


def _law(distance: float, models: dict[str, DepthCameraModel], seed: int) -> NoiseLaws:
    """Noise of single readings of a wall, over looks, and the published laws."""
    sigmas: dict[str, float | None] = {}
    for name, model in models.items():
        camera = model.ideal_camera
        wall = np.full((camera.height, camera.width), distance)
        looks = np.stack([model.measured(wall, seed + k) for k in range(_LOOKS)])
        rows, columns = (slice(n // 4, 3 * n // 4) for n in looks.shape[1:])
        middle = looks[:, rows, columns].astype(float)
        seen = bool((middle > 0.0).all())
        sigmas[name] = float(np.sqrt(np.mean(middle.var(axis=0, ddof=1)))) if seen else None
    return NoiseLaws(
        distance=distance,
        khoshelham_step=2.85e-3 * distance**2,
        khoshelham_sigma=1.425e-3 * distance**2,
        nguyen_sigma=0.0012 + 0.0019 * (distance - 0.4) ** 2,
        smisek_step=(2.73 * distance**2 + 0.74 * distance - 0.58) * 1e-3,
        xtion_sigma=sigmas["xtion"],
        tof_sigma=sigmas["tof"],
    )
