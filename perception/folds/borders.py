"""Borders of layers: lines along which the cloth steps up to a layer that lies on another.

At each cell the mean height in a window ahead is compared with that in a window behind, in the
direction in which the difference is largest; its maxima across the step are joined to pieces. A
piece is a border if its step is sharp and the cloth behind the crest stays up (a wrinkle comes down
again). A coarse sensor sees the step of one layer as little as its noise; there only high steps
count that stay up far behind them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from unwrinkle.perception._parallel import parallel_rows
from unwrinkle.perception.folds._kernels import steepest_steps
from unwrinkle.perception.folds.height_image import Floats, HeightImage, Points
from unwrinkle.perception.folds.nearest import nearest
from unwrinkle.perception.folds.settings import FoldSettings

#: Number of directions of a step, and how many to both sides of the steepest slope are tried.
_DIRECTIONS = 24
_SPREAD = 2

#: A maximum is the largest step within this distance across it, metres.
_ALONE_M = 0.006

#: Least share of a window that must lie on the garment.
_LEAST_WINDOW = 0.35

#: Spacing of a window's samples across and along the step, cells.
_SAMPLES = (1.0, 2.0)

#: Length of the pieces that borders are judged in, and of the shortest one, metres.
_PIECE_M = 0.06
_LEAST_LENGTH_M = 0.012

#: Cells belong to one line within this distance, cells, and turn, radians.
_JOIN_CELLS = 3.75
_JOIN_TURN = math.radians(35.0)

#: Slope below which the foot of a step is reached, and how far it is sought, metres.
_FOOT_SLOPE = 0.06
_FOOT_REACH_M = 0.03

#: Where the crest of a step is sought, and the cloth behind it, metres.
_CREST_M = 0.012
_REST_M = 0.030

#: A step is sharp by the share of it that is taken within this distance to both sides, metres.
_SHARP_M = 0.004

#: A fine sensor's border: greatest distance of the foot, least height of the cloth behind the crest
#: over the foot, metres, least sharpness.
_MOST_FOOT_M = 0.0086
_LEAST_REST_M = 0.0008
_LEAST_SHARP = 0.5

#: Least height at the foot of a border over that of the lowest cloth: what is lower is the table
#: beside the garment, in a mask that is too wide.
_LEAST_BELOW = 0.6

#: A coarse sensor's border: least share of the step that is left far behind it; and step, metres,
#: and share of a piece that continues one.
_LEAST_FAR = 0.5
_WEAK_STEP_M = 0.009
_WEAK_FAR = 0.3
_CONTINUES_M = 0.014


@dataclass(frozen=True, eq=False)
class Borders:
    """Cells on borders of layers, in pieces of about 60 mm.

    Attributes:
        points: (n, 2) column and row of the cells.
        upwards: (n, 2) unit, from the lower to the upper layer.
        piece: (n,) number of each cell's piece.
        step: (n,) height of each cell's piece, metres.
        resolution: side of a cell, metres.
    """

    points: Points
    upwards: Points
    piece: NDArray[np.intp]
    step: Points
    resolution: float

    @property
    def length(self) -> float:
        """Length of all borders, metres."""
        # Cells of a line are 1 to sqrt(2) apart: 1.1 on average.
        return 1.1 * self.resolution * len(self.points)

    def lines(self) -> list[Points]:
        """Return each piece's cells (k, 2), (column, row), in order along it."""
        lines = []
        for number in np.unique(self.piece):
            points = self.points[self.piece == number]
            axis = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2][0]
            lines.append(points[np.argsort(points @ axis)])
        return lines


@dataclass(frozen=True, eq=False)
class _Steps:
    """Maxima of the step: cells, directions upwards, step."""

    points: Points
    upwards: Points
    step: Points


def find_borders(image: HeightImage, settings: FoldSettings) -> Borders:
    """Find the borders of layers on a garment."""
    steps = _maxima(image, settings)
    piece = _pieces(steps, image.resolution)
    count = np.bincount(piece, minlength=1)
    judged = np.flatnonzero(count >= _LEAST_LENGTH_M / image.resolution)
    good = _fine(image, settings, steps) if settings.fine else _coarse(image, settings, steps)
    features = {name: _medians(values, piece, judged) for name, values in good.items()}
    if settings.fine:
        taken = judged[
            (features["foot"] < _MOST_FOOT_M)
            & (features["rest"] > _LEAST_REST_M)
            & (features["sharp"] > _LEAST_SHARP)
            & (features["step"] > settings.border_step)
            & (features["below"] > _LEAST_BELOW)
        ]
    else:
        share = features["far"] / np.maximum(features["step"], 1e-3)
        strong = (features["step"] > settings.border_step) & (share > _LEAST_FAR)
        weak = (features["step"] > _WEAK_STEP_M) & (share > _WEAK_FAR)
        taken = _continued(steps, piece, judged, strong, weak, image.resolution)
    keep = np.isin(piece, taken)
    height = np.zeros(len(count))
    height[judged] = features["step"]
    return Borders(
        steps.points[keep], steps.upwards[keep], piece[keep], height[piece[keep]], image.resolution
    )


@cache
def _window(
    near: tuple[float, float], along: float, resolution: float
) -> tuple[NDArray[np.int64], Points]:
    """Return the offsets (directions, samples, 2), row and column, of a window, and its weights."""
    across = np.arange(near[0], near[1] + 1e-9, _SAMPLES[0] * resolution)
    aside = np.arange(-2.0 * along, 2.0 * along + 1e-9, _SAMPLES[1] * resolution)
    u, v = (grid.ravel() for grid in np.meshgrid(across, aside))
    weights = np.exp(-0.5 * (v / along) ** 2)
    angles = 2.0 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    c, s = np.cos(angles)[:, None], np.sin(angles)[:, None]
    offsets = np.rint(np.stack([s * u + c * v, c * u - s * v], axis=-1) / resolution)
    return offsets.astype(np.int64), weights / weights.sum()


def _maxima(image: HeightImage, settings: FoldSettings) -> _Steps:
    """Find the maxima across the step of the difference between the two windows."""
    z = image.smoothed(settings.level_smoothing)
    zy, zx = (np.asarray(each) for each in np.gradient(z, image.resolution))
    slope = np.asarray(np.hypot(zx, zy))
    least_slope = 0.25 * settings.least_step / settings.near[1]
    inner = image.garment & (image.depth > 0.6 * settings.near[1])
    rows, columns = np.nonzero(inner & (slope > least_slope))
    angle = np.arctan2(zy[rows, columns], zx[rows, columns])
    directions = np.rint(angle / (2.0 * np.pi / _DIRECTIONS)).astype(np.int64) % _DIRECTIONS
    offsets, weights = _window(settings.near, settings.along, image.resolution)
    step = np.zeros(len(rows), dtype=np.float32)
    height = image.smoothed(0.75 * image.resolution)
    parallel_rows(
        steepest_steps,
        len(rows),
        rows,
        columns,
        directions,
        height,
        image.garment.view(np.uint8),
        offsets,
        weights,
        _SPREAD,
        _LEAST_WINDOW,
        step,
        directions,
    )
    field = np.zeros(image.height.shape, dtype=np.float32)
    field[rows, columns] = step
    turn = 2.0 * np.pi * directions / _DIRECTIONS
    upwards = np.column_stack([np.cos(turn), np.sin(turn)])
    points = np.column_stack([columns, rows]).astype(float)
    best = step > settings.least_step
    for distance in np.arange(1.0, _ALONE_M / image.resolution + 1.0):
        ahead = _at(field, points + distance * upwards)
        behind = _at(field, points - distance * upwards)
        best &= (step >= ahead) & (step > behind)
    return _Steps(points[best], upwards[best], step[best].astype(float))


def _pieces(steps: _Steps, resolution: float) -> NDArray[np.intp]:
    """Return the number (n,) of the piece that each cell belongs to: lines, cut to a length."""
    count = len(steps.points)
    if count == 0:
        return np.zeros(0, dtype=np.intp)
    tree = cKDTree(steps.points)
    pairs = tree.query_pairs(_JOIN_CELLS, output_type="ndarray")
    a, b = pairs.T
    like = np.sum(steps.upwards[a] * steps.upwards[b], axis=1) > math.cos(_JOIN_TURN)
    # Neighbours along the step, not the two sides of a ridge.
    between = steps.points[b] - steps.points[a]
    across = np.abs(np.sum(between * steps.upwards[a], axis=1))
    like &= across <= 0.7 * np.hypot(*between.T) + 0.5
    a, b = a[like], b[like]
    graph = coo_array((np.ones(len(a)), (a, b)), shape=(count, count))
    _, lines = connected_components(graph, directed=False)
    numbers = np.zeros(count, dtype=np.intp)
    following = 0
    for line in range(int(lines.max()) + 1):
        where = np.flatnonzero(lines == line)
        points = steps.points[where]
        if len(where) < _LEAST_LENGTH_M / resolution:
            numbers[where] = following
            following += 1
            continue
        axis = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2][0]
        along = (points - points.mean(axis=0)) @ axis
        parts = max(1, round(float(np.ptp(along)) * resolution / _PIECE_M))
        cut = np.linspace(along.min(), along.max(), parts + 1)[1:-1]
        numbers[where] = following + np.searchsorted(cut, along)
        following += parts
    return numbers


def _fine(image: HeightImage, settings: FoldSettings, steps: _Steps) -> dict[str, Points]:
    """Measure each maximum for a fine sensor: step, foot, rest, sharpness, height below."""
    z = image.smoothed(settings.smoothing)
    cell = image.resolution
    on = image.garment.astype(np.float32)

    def ray(reach: float, sign: float) -> tuple[Points, NDArray[np.bool_], Points]:
        distance = np.arange(0.0, reach / cell + 1e-9, 0.5)
        points = steps.points[:, None] + sign * distance[:, None] * steps.upwards[:, None]
        inside = np.logical_and.accumulate(_at(on, points) > 0.5, axis=1)
        return _at(z, points), inside, distance * cell

    down, on_down, distance = ray(_FOOT_REACH_M, -1.0)
    gentle = np.diff(down, axis=1) / np.diff(distance) > -_FOOT_SLOPE
    gentle[:, distance[1:] < 0.002] = False
    ends = gentle | ~on_down[:, 1:]
    ends[:, -1] = True
    place = np.argmax(ends, axis=1)
    foot, level = distance[place], np.take_along_axis(down, place[:, None], axis=1)[:, 0]
    up, on_up, distance = ray(_CREST_M + _REST_M, 1.0)
    near = distance <= _CREST_M
    crest = np.argmax(np.where(near & on_up, up, -np.inf), axis=1)
    behind = (np.arange(len(distance)) >= crest[:, None]) & on_up
    behind &= distance <= distance[crest][:, None] + _REST_M
    rest = np.where(behind, up, np.inf).min(axis=1, initial=np.inf) - level
    rest[~np.isfinite(rest)] = 0.0
    half = _SHARP_M / cell
    rise = _at(z, steps.points + half * steps.upwards) - _at(z, steps.points - half * steps.upwards)
    sharp = rise / np.maximum(steps.step, 1e-4)
    base = float(np.percentile(z[image.garment], 20.0))
    below = level / max(base, 1e-4)
    return {"step": steps.step, "foot": foot, "rest": rest, "sharp": sharp, "below": below}


def _coarse(image: HeightImage, settings: FoldSettings, steps: _Steps) -> dict[str, Points]:
    """Measure each maximum for a coarse sensor: step, and what is left of it far behind."""
    z = image.smoothed(settings.smoothing)
    on = image.garment.astype(np.float32)

    def level(sign: float) -> Points:
        distance = np.arange(settings.far[0], settings.far[1] + 1e-9, 0.004) / image.resolution
        points = steps.points[:, None] + sign * distance[:, None] * steps.upwards[:, None]
        inside = _at(on, points) > 0.5
        count = inside.sum(axis=1)
        mean = np.where(inside, _at(z, points), 0.0).sum(axis=1) / np.maximum(count, 1)
        return np.asarray(np.where(count > 0.3 * len(distance), mean, np.nan))

    far = np.nan_to_num(level(1.0) - level(-1.0), nan=0.0)
    return {"step": steps.step, "far": far}


def _continued(
    steps: _Steps,
    piece: NDArray[np.intp],
    judged: NDArray[np.intp],
    strong: NDArray[np.bool_],
    weak: NDArray[np.bool_],
    resolution: float,
) -> NDArray[np.intp]:
    """Return the strong pieces and the weak ones that continue them."""
    taken = strong.copy()
    for _ in range(3):
        members = np.isin(piece, judged[taken])
        if not members.any():
            break
        tree = cKDTree(steps.points[members])
        for k in np.flatnonzero(weak & ~taken):
            own = piece == judged[k]
            distance, beside = nearest(tree, steps.points[own])
            place = int(np.argmin(distance))
            like = steps.upwards[own].mean(axis=0) @ steps.upwards[members][beside[place]] > 0.0
            taken[k] = like and distance[place] * resolution < _CONTINUES_M
    return judged[taken]


def _medians(values: Points, piece: NDArray[np.intp], judged: NDArray[np.intp]) -> Points:
    """Return the medians of values over the cells of each judged piece."""
    order = np.argsort(piece, kind="stable")
    ordered = piece[order]
    starts, ends = np.searchsorted(ordered, judged), np.searchsorted(ordered, judged, side="right")
    return np.array(
        [np.median(values[order[a:b]]) for a, b in zip(starts, ends, strict=True)], dtype=float
    )


def _at(image: Floats, points: Points) -> Points:
    """Interpolate an image at (..., 2) points (column, row)."""
    flat = points.reshape(-1, 2)
    values = map_coordinates(image, [flat[:, 1], flat[:, 0]], order=1, mode="nearest")
    return np.asarray(values, dtype=float).reshape(points.shape[:-1])
