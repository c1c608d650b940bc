"""The noise of a depth map on its table, in the sensor's own steps.

For real maps and simulated ones.
"""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.harness.data import data_folder
from benchmarks.perception.depth_cameras.results import NoiseFigures
from unwrinkle.models.errors import InputError
from unwrinkle.perception.depth.capture import Capture
from unwrinkle.perception.depth.range_mapping import load_capture, segment_capture
from unwrinkle.perception.sensor import noise_profile

LAGS = (1, 2, 4, 8, 16, 32, 64)
_SETS = (("uc3m_textiles", "*_depth_mm.png"), ("clopema_ctu_spread_garments", "cloD*.png"))
_CAMERA = "xtion-pro-live"
_LEVELS = (0.9, 1.2)  # metres
_LEAST_STEP = 0.001  # 1/m; two levels of one step are no nearer
_AWAY = 12  # pixels from the garment
_PER_COLUMN = 60  # readings that a column's mean needs


def real_captures() -> list[Path]:
    """Files of the real Xtion maps; none where they are not at hand."""
    found: list[Path] = []
    for name, pattern in _SETS:
        try:
            found += sorted(data_folder(name).glob(pattern))
        except InputError:
            continue
    return found


def real_capture(path: Path) -> Capture:
    """One real map."""
    return load_capture(path, _CAMERA)


def levels_of(depth: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    """The different readings between 0.9 and 1.2 m, metres, in order."""
    inside = depth[(depth > _LEVELS[0]) & (depth < _LEVELS[1])]
    return np.unique(np.rint(inside.astype(np.float64) * 1e4)) * 1e-4


def step_of(levels: NDArray[np.float64], start: float) -> tuple[float, float]:
    """Step of inverse depth that explains readings, 1/m, and the RMS of what is left, metres.

    Args:
        levels: different readings in order, metres.
        start: a step within some percent, 1/m.
    """
    inverse = 1.0 / levels
    step = start
    line = np.zeros(2)
    for _ in range(20):
        number = np.concatenate([[0.0], np.cumsum(np.rint(-np.diff(inverse) / step))])
        basis = np.column_stack([np.ones_like(number), -number])
        line = np.linalg.lstsq(basis, inverse, rcond=None)[0]
        step = max(float(line[1]), _LEAST_STEP)
    rest = 1.0 / (basis @ line) - levels
    return step, float(np.sqrt(np.mean(rest**2)))


def noise_figures(capture: Capture, step: float, seed: int = 0) -> NoiseFigures:
    """Measure the table's readings in a capture.

    Args:
        capture: of a garment on its table.
        step: of inverse depth, 1/m.
        seed: of the table's consensus.
    """
    profile = noise_profile(capture.camera.sensor)
    table, parts = segment_capture(capture, profile, seed=seed)
    kernel = np.ones((2 * _AWAY + 1,) * 2, np.uint8)
    near = np.asarray(cv2.dilate(parts.garment.astype(np.uint8), kernel)) > 0
    on = table.table & ~near & (capture.depth > 0.0)
    inverse = np.divide(1.0, capture.depth, out=np.zeros(on.shape), where=on)
    x, y = capture.camera.rays()
    rest = _without(inverse / step, on, [np.ones_like(x), x, y])[0]
    plane_rms = _rms(rest, on)
    v, u = np.meshgrid(*(np.linspace(-1.0, 1.0, n) for n in on.shape), indexing="ij")
    rest, weights = _without(rest, on, [np.ones_like(u), u, v, u * u, u * v, v * v])
    count = np.count_nonzero(on, axis=0)
    enough = count >= _PER_COLUMN
    means = np.where(on, rest, 0.0).sum(axis=0) / np.maximum(count, 1) * enough
    rest = np.where(on, rest - means, 0.0)
    return NoiseFigures(
        distance=table.distance,
        table_rms=table.rms,
        plane_rms=plane_rms,
        bow=tuple(float(weight) for weight in weights[3:]),
        column_rms=float(np.sqrt(np.mean(means[enough] ** 2))),
        rest_rms=_rms(rest, on),
        along_rows=tuple(_alike(rest, on, lag, 1) for lag in LAGS),
        along_columns=tuple(_alike(rest, on, lag, 0) for lag in LAGS),
        holes=float(np.mean(capture.depth == 0.0)),
        garment_holes=float(np.mean(capture.depth[parts.garment] == 0.0)),
        columns=tuple(
            [
                round(float(mean), 3) if good else None
                for mean, good in zip(means, enough, strict=True)
            ]
        ),
    )


def _without(
    values: NDArray[np.float64], on: NDArray[np.bool_], basis: list[NDArray[np.float64]]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Values less their best fit in a basis, and its weights."""
    chosen = np.column_stack([part[on] for part in basis])
    weights = np.linalg.lstsq(chosen, values[on], rcond=None)[0]
    rest = values - np.stack(basis, axis=-1) @ weights
    return np.asarray(rest, dtype=np.float64), np.asarray(weights, dtype=np.float64)


def _rms(values: NDArray[np.float64], on: NDArray[np.bool_]) -> float:
    return float(np.sqrt(np.mean(values[on] ** 2)))


def _alike(rest: NDArray[np.float64], on: NDArray[np.bool_], lag: int, axis: int) -> float:
    """Correlation of the rest with itself, shifted by a lag along an axis."""
    first = [slice(None), slice(None)]
    second = [slice(None), slice(None)]
    first[axis], second[axis] = slice(None, -lag), slice(lag, None)
    a, b = (tuple(window) for window in (first, second))
    both = on[a] & on[b]
    return float(np.mean((rest[a] * rest[b])[both]) / np.mean(rest[on] ** 2))
