"""Geometric model of a pinch grasp: two blades descend astride a fold, close and lift.

The cloth solver has no rigid blades; a conservative geometric rule decides whether they catch
cloth:

1. The open blades descend along their axis. Cloth under a tip is pressed flat; the tool stops where
   all layers under a tip lie on the table and on each other.
2. The cloth between the blades descends with the cloth that the tips press down beside it, by the
   mean of both.
3. Cloth that remains between the blades, above both tips, by LEAST_DEPTH over at least half of
   their width is caught. The tips slide over flat cloth; real blades may gather it up.
4. The caught cloth moves with the tool in the shape that it had between the open blades. It cannot
   slip; `Lift.weight` is the force that the blades would have to hold by friction.
"""

import dataclasses as dc
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.arrays import Array
from unwrinkle.models.blades import Blades
from unwrinkle.models.errors import InputError
from unwrinkle.simulation.cloth.cloth import GRAVITY, Cloth, ClothState, Grip
from unwrinkle.simulation.cloth.fingers import carry
from unwrinkle.simulation.cloth.state import checked_pose

#: Least height of a fold between the blades above their tips, m.
LEAST_DEPTH = 0.005

#: Spacing of the rays along the blades' axis, m.
_RAY_SPACING_M = 1e-3

#: Offset of the rays, m: a ray through the common edge of two triangles would hit none or both.
_RAY_OFFSET_M = (1.37e-6, 2.11e-6)

#: Least number of caught nodes.
_MIN_NODES = 2

#: Height above the table, and above its former place, of lifted cloth, m.
_LIFTED_M = 0.05


@dataclass(frozen=True, eq=False)
class Catch:
    """Cloth between the blades when they are down, before they close.

    Attributes:
        X_WT: (4, 4) pose of the tool.
        withheld: distance above the commanded pose at which it stopped, m.
        layers: largest number of layers under a tip.
        pressed: distance by which the tips press down the cloth beside the fold, mean of both, m.
        depth: height of the fold above both tips over at least half of their width, m; negative
            below them.
        nodes: (k,) grid numbers of the caught nodes; empty if none.
        reason: why nothing is caught; empty if something is.
    """

    X_WT: Array
    withheld: float
    layers: int
    pressed: float
    depth: float
    nodes: NDArray[np.intp]
    reason: str

    @property
    def caught(self) -> bool:
        """Whether the blades hold cloth when they close."""
        return not self.reason


@dataclass(frozen=True, eq=False)
class Lift:
    """Cloth after it was caught and lifted.

    Attributes:
        state: state of the cloth, held above the table.
        area: area of cloth more than 50 mm above the table and above its former place, m^2.
        weight: weight of the cloth that does not touch the table, N.
    """

    state: ClothState
    area: float
    weight: float


def catch(
    cloth: Cloth, state: ClothState, X_WT: NDArray[np.floating], blades: Blades, opening: float
) -> Catch:
    """Compute the cloth between the open blades at a commanded pose.

    Args:
        cloth: the cloth.
        state: state before the grasp.
        X_WT: (4, 4) pose of the tool centre point, z along the blades and downwards, y from the
            lower to the upper blade.
        blades: geometry of the blades.
        opening: distance between the open blades, m.

    Raises:
        InputError: the pose is not rigid or does not point down, or the opening is not positive.
    """
    X = np.array(checked_pose(X_WT, "pinch"))
    if X[2, 2] > -0.1:
        raise InputError(
            f"pinch: the blades' axis has z {X[2, 2]:.2f} in the world; give a pose that points "
            "down"
        )
    if not (np.isfinite(opening) and opening > 0.0):
        raise InputError(f"pinch: opening {opening} m; give one above 0")
    corners = _triangles_near(cloth, state, X, blades, opening)
    inner, outer = blades.gap(opening)
    tips = (
        (inner - blades.thickness, inner, blades.lower_end),
        (outer, outer + blades.thickness, blades.upper_end),
    )
    columns = [_crossings(corners, blades.width, low, high) for low, high, _ in tips]
    counts = [int(np.isfinite(z).sum(axis=0).max(initial=0)) for z in columns]
    withheld = 0.0
    for (low, high, end), count in zip(tips, counts, strict=True):
        lowest = min((X @ np.array([0.0, y, end, 1.0]))[2] for y in (low, high))
        room = lowest - cloth.table.height - count * cloth.material.thickness
        withheld = max(withheld, room / X[2, 2])
    X[:3, 3] -= withheld * X[:3, 2]
    # In the frame of the stopped tool the cloth is `withheld` further down.
    pressed = float(
        np.mean([_pressed(z + withheld, end) for z, (_, _, end) in zip(columns, tips, strict=True)])
    )
    level = min(blades.lower_end, blades.upper_end) - pressed
    fold = _crossings(corners, blades.width, inner, outer) + withheld
    depth = _depth(fold, level, blades.width)
    nodes = _between(cloth, state, X, blades, opening, level)
    reason = ""
    if depth < LEAST_DEPTH:
        reason = (
            f"the cloth between the blades stands {1e3 * depth:.1f} mm above their tips, at least "
            f"{1e3 * LEAST_DEPTH:.0f} mm are needed"
        )
    elif len(nodes) < _MIN_NODES:
        reason = f"the fold between the blades is finer than the cloth's mesh ({len(nodes)} nodes)"
    if reason:
        nodes = nodes[:0]
    return Catch(X, withheld, max(counts), pressed, depth, nodes, reason)


def lift(
    cloth: Cloth,
    state: ClothState,
    held: Catch,
    *,
    hand: int = 0,
    height: float = 0.10,
    duration: float = 1.0,
    hold: float = 0.5,
) -> Lift:
    """Lift the caught cloth and hold it.

    Args:
        cloth: the cloth.
        state: state before the grasp.
        held: a catch with cloth.
        hand: 0 right, 1 left; it must be empty.
        height: height of the lift, m.
        duration: of the lift, s, a multiple of 20 ms.
        hold: holding time afterwards, s.

    Raises:
        InputError: nothing is caught, the hand is not empty, or a time is not usable.
        ClothError: the solver failed.
    """
    if not held.caught or state.grips[hand] is not None:
        raise InputError("pinch: nothing is caught, or the hand is full; lift what a catch holds")
    before = cloth.vertices(state)[:, 2]
    X_WT = held.X_WT
    p_TN = (state.positions[:, held.nodes].T - X_WT[:3, 3]) @ X_WT[:3, :3]
    grip, way = Grip(held.nodes, p_TN, X_WT), (0.0, 0.0, height)
    grips = (grip, state.grips[1]) if hand == 0 else (state.grips[0], grip)
    moves = (way, None) if hand == 0 else (None, way)
    state = carry(cloth, dc.replace(state, grips=grips), moves, duration)
    state = cloth.advance(state, hold)
    after = cloth.vertices(state)[:, 2]
    cell = cloth.outline.area / len(after)
    up = (after > cloth.table.height + _LIFTED_M) & (after > before + _LIFTED_M)
    off = after > cloth.flat_height + cloth.material.thickness
    weight = float(off.sum()) * cell * cloth.material.areal_density * -GRAVITY[2]
    return Lift(state, float(up.sum()) * cell, weight)


def _triangles_near(
    cloth: Cloth, state: ClothState, X_WT: Array, blades: Blades, opening: float
) -> Array:
    """Return the triangles (m, 3, 3), in T, that may lie under or between the blades."""
    p = (cloth.vertices(state) - X_WT[:3, 3]) @ X_WT[:3, :3]
    corners = p[cloth.triangles]
    low, high = corners.min(axis=1), corners.max(axis=1)
    reach = 2.0 * blades.thickness + opening
    near = (low[:, 0] <= 0.5 * blades.width) & (high[:, 0] >= -0.5 * blades.width)
    near &= (low[:, 1] <= reach) & (high[:, 1] >= 0.0)
    return np.asarray(corners[near])


def _crossings(corners: Array, width: float, low: float, high: float) -> Array:
    """Return z (m, k) of rays along the blades' axis on triangles (m, 3, 3); NaN without a hit.

    The rays are _RAY_SPACING_M apart over |x| <= width / 2 and low <= y <= high, sorted by x, then
    y.
    """
    x = (np.arange(round(width / _RAY_SPACING_M)) + 0.5) * _RAY_SPACING_M - 0.5 * width
    count = max(1, round((high - low) / _RAY_SPACING_M))
    y = low + (np.arange(count) + 0.5) * (high - low) / count
    rays = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2) + _RAY_OFFSET_M
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    u, v = (b - a)[:, :2], (c - a)[:, :2]
    area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    area = np.where(np.abs(area) < 1e-14, np.nan, area)[:, None]
    d = rays[None] - a[:, None, :2]
    s = (d[..., 0] * v[:, None, 1] - d[..., 1] * v[:, None, 0]) / area
    t = (u[:, None, 0] * d[..., 1] - u[:, None, 1] * d[..., 0]) / area
    z = a[:, None, 2] + s * (b - a)[:, None, 2] + t * (c - a)[:, None, 2]
    return np.where((s >= 0.0) & (t >= 0.0) & (s + t <= 1.0), z, np.nan)


def _pressed(z: Array, end: float) -> float:
    """Return the depth of a tip at z = end below the uppermost cloth under it, mean, m."""
    top = np.where(np.isfinite(z), z, np.inf).min(axis=0, initial=np.inf)
    return float(np.maximum(end - top, 0.0).mean())


def _depth(z: Array, level: float, width: float) -> float:
    """Return the fold's height above the level: maximum across, median along the width, m."""
    top = np.where(np.isfinite(z), z, np.inf).min(axis=0, initial=np.inf)
    crest = top.reshape(round(width / _RAY_SPACING_M), -1).min(axis=1)
    # Rays without cloth count as cloth 1 m below the level.
    return float(np.median(np.maximum(level - crest, -1.0)))


def _between(
    cloth: Cloth, state: ClothState, X_WT: Array, blades: Blades, opening: float, level: float
) -> NDArray[np.intp]:
    """Return the numbers of the nodes between the blades and above the level."""
    p = (cloth.vertices(state) - X_WT[:3, 3]) @ X_WT[:3, :3]
    low, high = blades.gap(opening)
    inside = (np.abs(p[:, 0]) <= 0.5 * blades.width) & (p[:, 1] >= low) & (p[:, 1] <= high)
    return np.asarray(cloth.numbers[inside & (p[:, 2] <= level)])
