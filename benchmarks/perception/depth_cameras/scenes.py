"""Scenes that depth cameras are compared on.

A leaf over the table, and a garment with steep folds.
"""

import base64

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.perception.depth_cameras.results import EdgeFigures
from unwrinkle.models.robot import Cell
from unwrinkle.simulation.depth_cameras.cameras import DepthCameraModel, depth_reading
from unwrinkle.simulation.rendering.meshes import height_field_mesh, towel_mesh
from unwrinkle.simulation.rendering.renderer import Renderer
from unwrinkle.simulation.rendering.synthetic_towel import Ridge, Towel, overhead_pose
from unwrinkle.simulation.rendering.textures import uniform

TABLE = 0.70
CENTRE = (0.0, -1.10)
LEAF_HEIGHT = 0.25  # above the table
NEAR = 0.10  # of the renderer: the time-of-flight camera sees from 0.2 m
UNITS = 1e-4  # metres per step of a stored picture
_LEAF = (0.11, 0.045)  # half axes
_CURVE = 0.02  # the leaf's tips hang so far
_FLYING = 0.02  # a reading so far from every surface lies in the air
_RING = 4  # pixels around an edge


def leaf_scene(cell: Cell) -> Renderer:
    """A leaf that hangs over the table, as the paper's plants do over their background."""
    leaf = height_field_mesh(
        "leaf",
        lambda x, y: -_CURVE * ((x - CENTRE[0]) / _LEAF[0]) ** 2 - 0.15 * np.abs(y - CENTRE[1]),
        uniform((70, 128, 56)),
        centre=CENTRE,
        size=(2.0 * _LEAF[0] + 0.01, 2.0 * _LEAF[1] + 0.01),
        table_height=TABLE + LEAF_HEIGHT,
        inside=lambda x, y: (
            1.0 - ((x - CENTRE[0]) / _LEAF[0]) ** 2 - ((y - CENTRE[1]) / _LEAF[1]) ** 2
        ),
    )
    return Renderer(cell, [leaf], near=NEAR)


def folded_towel() -> Towel:
    """A towel with folds that stand up steeply: up to 73 degrees."""
    x, y = CENTRE
    return Towel(
        ridges=(
            Ridge((x - 0.02, y), np.radians(78.0), 0.065, 0.012, 0.26),
            Ridge((x + 0.12, y - 0.03), np.radians(100.0), 0.045, 0.010, 0.18),
            Ridge((x - 0.13, y + 0.04), np.radians(60.0), 0.030, 0.010, 0.14),
        )
    )


def garment_scene(cell: Cell) -> Renderer:
    """The folded towel on the table."""
    return Renderer(cell, [towel_mesh(folded_towel(), "print")], near=NEAR)


def look(
    renderer: Renderer, model: DepthCameraModel, height: float, seed: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Truth and reading (h, w) from straight above, heights over the table, NaN where none.

    Args:
        renderer: the scene.
        model: the camera.
        height: of the camera over the table, metres.
        seed: of the look.
    """
    X_WC = overhead_pose(*CENTRE, TABLE + height)
    truth = renderer.depth(model.camera, X_WC)
    reading = depth_reading(renderer, model, X_WC, seed)
    return _over(truth, height), _over(reading, height)


def _over(depth: NDArray[np.float32], height: float) -> NDArray[np.float64]:
    return np.where(depth > 0.0, height - depth.astype(np.float64), np.nan)


def edge_figures(
    truth: NDArray[np.float64], reading: NDArray[np.float64], model: DepthCameraModel, height: float
) -> EdgeFigures:
    """Measure what happens around the leaf's edge."""
    leaf = np.nan_to_num(truth, nan=-1.0) > 0.5 * LEAF_HEIGHT
    ring = np.ones((2 * _RING + 1,) * 2, np.uint8)
    mask = leaf.astype(np.uint8)
    edge = (np.asarray(cv2.dilate(mask, ring)) - np.asarray(cv2.erode(mask, ring))) > 0
    has = np.isfinite(reading)
    low, high = np.nanmin(truth[leaf]), np.nanmax(truth[leaf])
    air = (reading > _FLYING) & (reading < low - _FLYING)
    air |= reading > high + _FLYING
    row = leaf.shape[0] // 2
    columns = np.nonzero(leaf[row])[0]
    left, right = int(columns.min()), int(columns.max())
    near = float(height - truth[row, left])
    baseline = float(getattr(model, "baseline", 0.0))
    flying, read = int(np.count_nonzero(air & edge & has)), int(np.count_nonzero(edge & has))
    return EdgeFigures(
        flying=flying / max(read, 1),
        flying_count=flying,
        shadow=(_run(~has[row], left, -1), _run(~has[row], right, 1)),
        shadow_law=model.camera.fx * baseline * (1.0 / near - 1.0 / height),
    )


def _run(hole: NDArray[np.bool_], start: int, way: int) -> int:
    """Number of holes around an edge: from inside it outwards until readings begin again."""
    count, at, away = 0, start - 3 * way, 0
    while 0 <= at < hole.size and (away < 8 or hole[at]):
        count += int(hole[at])
        away += 1
        at += way
    return count


def stored(height: NDArray[np.float64]) -> str:
    """A picture of heights as text: PNG of uint16 tenths of a millimetre over -1 m, 0 for none."""
    units = np.where(np.isfinite(height), np.rint((np.nan_to_num(height) + 1.0) / UNITS), 0.0)
    done, data = cv2.imencode(".png", np.clip(units, 0, 65535).astype(np.uint16))
    assert done
    return base64.b64encode(np.asarray(data).tobytes()).decode("ascii")


def restored(text: str) -> NDArray[np.float64]:
    """What `stored` wrote."""
    data = np.frombuffer(base64.b64decode(text), dtype=np.uint8)
    units = np.asarray(cv2.imdecode(data, cv2.IMREAD_UNCHANGED), dtype=np.float64)
    return np.where(units > 0.0, units * UNITS - 1.0, np.nan)
