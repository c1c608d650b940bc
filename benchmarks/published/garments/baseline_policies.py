"""Simple ways to flatten a garment, to compare with: bare hands that see what the stereo head would
see.

Each policy looks at a range map and says where one hand takes the garment and where to it goes:

- `random`: pick a place on the garment, put it down within reach. As in the random policies of
  cloth smoothing (D. Seita et al., "Deep imitation learning of sequential fabric smoothing from an
  algorithmic supervisor", IROS 2020), with every grasp on the garment.
- `contour`: the point of the outline that is farthest from the garment's centroid is pulled
  outwards. It would always be the same corner; so a point that lies within 60 degrees of one of the
  last three pulls waits.
- `wrinkledness`: the grasp point of A. Ramisa et al. (ICRA 2012; see
  perception/wrinkles/wrinkledness.py) is pulled away from the garment's centroid. The paper grasps
  there and does not flatten: the pull is an addition. Of the rules tried on bunched towels (away
  from the centroid or across the local ridge, 2 to 4 cm) this one is the best.

None of them knows the garment's outline, and none stops by itself.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import InputError
from unwrinkle.models.table import Table
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.sensor import noise_profile
from unwrinkle.perception.wrinkles.surface import fit_surface
from unwrinkle.perception.wrinkles.wrinkledness import wrinkledness
from unwrinkle.simulation.cloth.cloth import Cloth
from unwrinkle.simulation.cloth.fingers import STEP, carry, let_go, take
from unwrinkle.simulation.cloth.state import ClothState

#: m/s, of a hand at its fastest.
SPEED = 0.25
#: m: a hand stays this far inside the table's edges.
MARGIN = 0.02
#: m: how far `random` puts things away at most, and how high it lifts them.
REACH, LIFT = 0.15, 0.06
#: m: how far `contour` and `wrinkledness` pull, and how high they lift for it.
DRAG, CREST_DRAG, DRAG_LIFT = 0.08, 0.03, 0.01
_INSET = 0.008  # m: from the outline inwards, so that the fingers have cloth between them
_LOWEST = 0.005  # m above flat: where a hand lets go
_LEAST_DRAG = 0.01  # m: what the table's edge must leave of a pull
_MOST_SETTLING, _SETTLED = 1.5, 5e-3  # s, m/s: as between the pushes of the wrinkle makers
_APART = math.radians(60.0)
_REMEMBERED = 3  # pulls
_OUTLINE_STEP = 0.004  # m: between points of the outline that are looked at


@dataclass(frozen=True, eq=False)
class Pull:
    """What one hand does.

    Attributes:
        point: (3,) where it takes the garment, world, m.
        move: (2,) where to, from there, world x and y, m.
        lift: how high it is lifted for that, m.
    """

    point: Array
    move: Array
    lift: float


Policy = Callable[[RangeMap, Table, np.random.Generator, Sequence[Pull]], Pull | None]


def random_pick_and_place(
    seen: RangeMap, table: Table, rng: np.random.Generator, before: Sequence[Pull]
) -> Pull | None:
    """A place on the garment, and one uniformly in the disc of REACH around it that is on the
    table.
    """
    cells = np.argwhere(_graspable(seen, table))
    if not len(cells):
        return None
    row, column = cells[rng.integers(len(cells))]
    start = seen.world_from_cell(np.array([column, row], dtype=float))
    while True:
        angle, radius = rng.uniform(0.0, 2.0 * np.pi), REACH * np.sqrt(rng.uniform())
        move = radius * np.array([np.cos(angle), np.sin(angle)])
        if table.overhang(start + move) == 0.0:
            return Pull(_grasp(seen, start), move, LIFT)


def contour_pull(
    seen: RangeMap, table: Table, rng: np.random.Generator, before: Sequence[Pull]
) -> Pull | None:
    """The outline's farthest point from the centroid that was not pulled just now, outwards by
    DRAG.
    """
    mask = _graspable(seen, table)
    if not mask.any():
        return None
    centroid = _centroid(seen, mask)
    points = seen.world_from_cell(_outline(mask))
    points = points[:: max(1, round(_OUTLINE_STEP / seen.resolution))]
    rays = points - centroid
    distances = np.hypot(*rays.T)
    rays = rays / np.maximum(distances, 1e-9)[:, None]
    for index in np.argsort(-distances):
        ray = rays[index]
        recent = [pull.move / np.hypot(*pull.move) for pull in before[-_REMEMBERED:]]
        if any(ray @ other > math.cos(_APART) for other in recent):
            continue
        start = points[index] - _INSET * ray
        move = _on_table(start, DRAG * ray, table)
        if move is not None:
            return Pull(_grasp(seen, start), move, DRAG_LIFT)
    return None


def wrinkledness_pull(
    seen: RangeMap, table: Table, rng: np.random.Generator, before: Sequence[Pull]
) -> Pull | None:
    """The grasp point by wrinkledness, away from the garment's centroid by CREST_DRAG."""
    mask = _graspable(seen, table)
    profile = noise_profile(seen.sensor)
    try:
        surface = fit_surface(seen, profile)
    except InputError:  # nothing of the garment is off its rim
        return None
    start = wrinkledness(surface, profile).point
    if start is None or not mask.any() or table.overhang(start) > 0.0:
        return None
    ray = start - _centroid(seen, mask)
    ray = ray / max(1e-9, float(np.hypot(*ray)))
    for sign in (1.0, -1.0):  # at the table's edge the other way
        move = _on_table(start, sign * CREST_DRAG * ray, table)
        if move is not None:
            return Pull(_grasp(seen, start), move, DRAG_LIFT)
    return None


#: By the names that rows and pages have for them.
POLICIES: dict[str, Policy] = {
    "random": random_pick_and_place,
    "contour": contour_pull,
    "wrinkledness": wrinkledness_pull,
}


def carried_out(cloth: Cloth, state: ClothState, pull: Pull) -> ClothState:
    """The cloth at rest after the hand took it, lifted it, moved it, put it down and let go.

    The hand is never faster than SPEED. Where it takes nothing, nothing changes.

    Raises:
        ClothError: the solver failed.
    """
    # The finger's tip goes between the surface that is seen and the table, never below flat cloth.
    low = cloth.flat_height
    point = np.array([*pull.point[:2], max(low, pull.point[2] - 0.5 * cloth.material.thickness)])
    held = take(cloth, state, 0, point)
    if not held.held:
        return state
    high = point[2] + pull.lift
    end = min(point[2], low + _LOWEST)
    for move in (
        np.array([0.0, 0.0, pull.lift]),
        np.array([*pull.move, 0.0]),
        np.array([0.0, 0.0, end - high]),
    ):
        held = carry(cloth, held, (move, None), _duration(float(np.linalg.norm(move))))
    return cloth.settle(let_go(cloth, held), _MOST_SETTLING, _SETTLED)


def _duration(length: float) -> float:
    """Time for a way from rest to rest whose fastest part (1.5 of its mean) is at SPEED, s."""
    return max(10, math.ceil(1.5 * length / SPEED / STEP)) * STEP


def _graspable(seen: RangeMap, table: Table) -> NDArray[np.bool_]:
    """The garment's largest piece on the table."""
    ny, nx = seen.shape
    x, y = seen.world_from_cell(np.column_stack([np.arange(max(nx, ny))] * 2)).T
    half = 0.5 * np.asarray(table.size) - MARGIN
    on = (np.abs(y[:ny] - table.centre[1]) <= half[1])[:, None]
    on = on & (np.abs(x[:nx] - table.centre[0]) <= half[0])[None, :]
    mask = (seen.garment & seen.valid & on).astype(np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask)
    if count < 2:
        return np.zeros(seen.shape, dtype=bool)
    largest = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    result: NDArray[np.bool_] = np.asarray(labels) == largest
    return result


def _outline(mask: NDArray[np.bool_]) -> Array:
    """(column, row) of the outer outline's cells, in order, (n, 2)."""
    found, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return np.asarray(max(found, key=len), dtype=float).reshape(-1, 2)


def _centroid(seen: RangeMap, mask: NDArray[np.bool_]) -> Array:
    rows, columns = np.nonzero(mask)
    return seen.world_from_cell(np.array([columns.mean(), rows.mean()]))


def _grasp(seen: RangeMap, place: Array) -> Array:
    """World point on the surface that is seen at `place` (2,)."""
    column, row = np.rint(seen.cell_from_world(place)).astype(int)
    return np.array([*place, seen.table_height + float(seen.height[row, column])])


def _on_table(start: Array, move: Array, table: Table) -> Array | None:
    """As much of a move (2,) as ends on the table; None if that is hardly anything."""
    length = float(np.hypot(*move))
    for part in np.linspace(1.0, 0.0, 41):
        if table.overhang(start + part * move, MARGIN) == 0.0:
            return part * move if part * length >= _LEAST_DRAG else None
    return None
