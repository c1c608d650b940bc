"""One simulated garment, seen by one sensor: what is said of it beside what is true."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import cKDTree

from benchmarks.harness.trials import KeptTrial, Trial
from unwrinkle.flattening.capture_to_observation import StereoCapture, map_of
from unwrinkle.flattening.observation import Observation
from unwrinkle.models.errors import InputError
from unwrinkle.models.garment import KnownGarment
from unwrinkle.models.robot import Cell, load_cell
from unwrinkle.models.scenario import load_scenario, with_sensor
from unwrinkle.perception.folds.garment_state import GarmentState
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.stereo.head_file import nominal_calibration
from unwrinkle.perception.stereo.pair import StereoPair
from unwrinkle.perception.wrinkles.analysis import analyse
from unwrinkle.perception.wrinkles.wrinkle import Wrinkle
from unwrinkle.simulation.cloth.cloth import Cloth, ClothState
from unwrinkle.simulation.cloth.initial_states import start_state
from unwrinkle.simulation.cloth.layers import LayerMap, layer_map
from unwrinkle.simulation.cloth.measures import measure
from unwrinkle.systems.station.photographer import CellPhotographer, CellPosture
from unwrinkle.systems.station.world import simulated_cloth

WORK = f"{__name__}:seen"

#: A region of two layers counts from this area on, m^2; and overhangs of all wrinkles together from
#: this share of the garment on.
_LEAST_REGION = 8e-4
_LEAST_OVERHANG = 0.03

#: A flat garment covers this share of its area at least, and stands at most so high, m.
_FLAT_COVERAGE, _FLAT_HEIGHT = 0.98, 0.005

#: A ridge with more than this share of its points so near a true border, m, is the border.
_ON_BORDER = 0.5
_NEAR_BORDER = 0.012

#: Side of the cells of the truth, m.
_CELL = 0.002


@dataclass(frozen=True)
class RidgeFound:
    """A ridge of the list: what it was said to be, and whether it is a border in truth."""

    kind: str
    border: bool


@dataclass(frozen=True, kw_only=True)
class FoldRun:
    """What was said of a garment.

    Attributes:
        truth: state.
        hidden: share of the garment that is hidden below other cloth, in truth.
        known, unknown: state with and without the garment's flat area.
        flap: area that is folded over in the largest flap, m^2; 0 without one.
        found: area of the largest flap that was found with the known outline, m^2; None without one.
        turn: angle between the directions in which it opens, found and true, deg; None without
            either.
        ridges: of the list, in order.
        failed: why there is no range map; empty if there is one.
    """

    truth: str
    hidden: float
    known: str
    unknown: str
    flap: float
    found: float | None
    turn: float | None
    ridges: tuple[RidgeFound, ...]
    failed: str


@dataclass(frozen=True, kw_only=True)
class FoldTrial(KeptTrial, FoldRun):
    """A run that was kept."""


def trial(garment: str, start: str, sensor: str, seed: int) -> Trial:
    """Return the trial of a garment, its start, a sensor and a seed."""
    settings = {"garment": garment, "start": start, "sensor": sensor, "seed": seed}
    return Trial(f"{garment}-{start}-{sensor}-{seed}", WORK, settings)


def seen(settings: dict[str, Any], folder: Path) -> FoldRun:
    """Look at a garment in one state.

    Args:
        settings: `garment`, `start`, `sensor` (stereo, depth or truth) and `seed`.
        folder: not used.
    """
    scenario = with_sensor(load_scenario(), settings["sensor"])
    scenario.station.garment.outline = settings["garment"]
    cell = load_cell(scenario)
    cloth = simulated_cloth(cell)
    seed = int(settings["seed"])
    state = start_state(cloth, settings["start"], (0.0, -1.1), seed)
    layers = layer_map(cloth, state, _CELL)
    truth, hidden = true_state(cloth, state, layers)
    flap, opening = true_flap(cloth, layers)
    try:
        range_map = _range_map(cell, cloth, state, settings["sensor"], seed)
    except InputError as error:
        return FoldRun(
            truth=truth,
            hidden=hidden,
            known=GarmentState.UNSEEN,
            unknown=GarmentState.UNSEEN,
            flap=flap,
            found=None,
            turn=None,
            ridges=(),
            failed=str(error),
        )
    analysis = analyse(range_map, table=cell.table)
    known = Observation.of(analysis, known_garment(cloth))
    unknown = Observation.of(analysis)
    largest = known.folds.flaps[0] if known.folds.flaps else None
    turn = None
    if largest is not None and opening is not None:
        turn = math.degrees(math.acos(float(np.clip(largest.opening @ opening, -1.0, 1.0))))
    ridges = zip(known.analysis.wrinkles, known.folds.kinds, strict=True)
    return FoldRun(
        truth=truth,
        hidden=hidden,
        known=said(known),
        unknown=said(unknown),
        flap=flap,
        found=None if largest is None else largest.area,
        turn=turn,
        ridges=tuple(RidgeFound(kind, on_border(each, layers)) for each, kind in ridges),
        failed="",
    )


def said(observation: Observation) -> str:
    """Return the state that the loop would end with: a flat garment with a wrinkle is wrinkled."""
    features = observation.features
    rules = load_scenario().loop
    if features.state is GarmentState.FLAT and features.worth_pulling(rules):
        return GarmentState.WRINKLED
    return features.state


def known_garment(cloth: Cloth) -> KnownGarment:
    """Return what is known of a simulated garment."""
    outline = cloth.outline
    return KnownGarment(
        outline.name, outline.area, cloth.material.thickness, outline.corners.tolist()
    )


def true_state(cloth: Cloth, state: ClothState, layers: LayerMap) -> tuple[str, float]:
    """Return the true state, and the share of the garment that is hidden below other cloth."""
    area = layers.resolution**2
    over = float(np.maximum(layers.layers - 1, 0).sum()) * area / cloth.outline.area
    regions, count = ndimage.label(layers.folded())
    areas = np.bincount(regions.ravel(), minlength=count + 1)[1:] * area
    if (areas >= _LEAST_REGION).any() or over >= _LEAST_OVERHANG:
        return GarmentState.FOLDED, over
    measures = measure(cloth, state)
    flat = measures.coverage >= _FLAT_COVERAGE and measures.height <= _FLAT_HEIGHT
    return (GarmentState.FLAT if flat else GarmentState.WRINKLED), over


def true_flap(cloth: Cloth, layers: LayerMap) -> tuple[float, NDArray[np.float64] | None]:
    """Return the area of the largest part that lies underside up on other cloth, m^2, and the
    direction (2,) in which it opens; 0 and None without one.
    """
    over = layers.folded() & ~layers.face_up & (layers.layers > 1)
    regions, count = ndimage.label(over)
    if not count:
        return 0.0, None
    sizes = np.bincount(regions.ravel())[1:]
    region = regions == 1 + int(np.argmax(sizes))
    area = float(sizes.max()) * layers.resolution**2
    flat = layers.face_up & (layers.layers == 1)
    if area < _LEAST_REGION or not flat.any():
        return 0.0, None
    material, places = layers.material[flat], _places(layers, flat)
    m, p = material.mean(axis=0), places.mean(axis=0)
    u, _, vt = np.linalg.svd((material - m).T @ (places - p))
    opened = (layers.material[region] - m) @ (u @ vt) + p
    move = (opened - _places(layers, region)).mean(axis=0)
    return area, np.asarray(move / np.hypot(*move))


def _places(layers: LayerMap, where: NDArray[np.bool_]) -> NDArray[np.float64]:
    rows, columns = np.nonzero(where)
    return layers.origin + layers.resolution * np.column_stack([columns, rows])


def on_border(wrinkle: Wrinkle, layers: LayerMap) -> bool:
    """Whether a ridge lies along a true border of a layer."""
    borders = layers.borders()
    if not borders.any():
        return False
    distance, _ = cKDTree(_places(layers, borders)).query(wrinkle.curve[:, :2])
    return float(np.mean(np.asarray(distance) < _NEAR_BORDER)) > _ON_BORDER


def _range_map(cell: Cell, cloth: Cloth, state: ClothState, sensor: str, seed: int) -> RangeMap:
    """Return the range map of a look at the cloth from the home posture."""
    if sensor == "truth":
        from unwrinkle.systems.perception.true_range_map import true_range_map

        return true_range_map(cloth, state, seed)
    head = nominal_calibration().stereo_head(cell.limits.head)
    home = np.array(cell.robot.named_states["home"], dtype=float)
    gaze = head.gaze_at(np.array([0.0, -1.10, cell.table.height]), float(home[0]))
    posture = CellPosture(home, np.array([*gaze.left, *gaze.right]))
    photographer = CellPhotographer(cell, cloth, head, seed)
    if sensor == "depth":
        return map_of(photographer.depth(posture, state, seed), cell, seed=seed)
    pair = photographer.pair(posture, state, seed)
    return map_of(StereoCapture(StereoPair(*pair, "look"), head, gaze), cell, seed=seed)
