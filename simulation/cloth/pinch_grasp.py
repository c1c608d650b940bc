"""What a gripper of two blades does to simulated cloth when it comes down astride a fold, closes and lifts.

The cloth knows no rigid blades, so whether they catch anything is decided by geometry, on the cautious side:

1. The open blades come down along their own axis. What lies under a tip is pressed flat, but no further: a tip
   stops where all layers under it lie on the table and on each other, and the whole tool with it.
2. The cloth between the blades goes down with the cloth that the tips press down beside it, by the mean of both.
3. Cloth that then still stands between the blades, above both tips, by LEAST_DEPTH over at least half of their
   width is caught. The tips slide over all that lies flat: they never gather up flat cloth, as real blades may.
4. What is caught goes with the tool from then on, in the shape that it had between the open blades. It cannot
   slip out; `Lift.weight` tells what the blades would have to hold by friction.
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

LEAST_DEPTH = 0.005  # m: of fold between the blades above their tips
_CELL = 1e-3  # m: of the rays along the blades' axis
_ASIDE = (
    1.37e-6,
    2.11e-6,
)  # m: a ray along the common edge of two triangles would pass none of them, or both
_LEAST_NODES = 2
_LIFTED = 0.05  # m: above the table and above where it lay


@dataclass(frozen=True, eq=False)
class Catch:
    """What the blades have between them when they are down, before they close.

    Attributes:
        X_WT: (4, 4) where the tool stands.
        withheld: how far above the wanted pose it was stopped, m.
        layers: the most layers under a tip.
        pressed: how far the tips press the cloth beside the fold down, mean of both, m.
        depth: by how much the fold stands above both tips over at least half of their width, m; negative where it
            stays below.
        nodes: (k,) numbers in the grid of the nodes that are caught; empty if nothing is.
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
    """What became of the cloth that was caught.

    Attributes:
        state: of the cloth, the tool holding it above the table.
        area: of cloth that is over 50 mm above the table and above where it lay, m^2.
        weight: of the cloth that does not touch the table, N.
    """

    state: ClothState
    area: float
    weight: float


def catch(
    cloth: Cloth, state: ClothState, X_WT: NDArray[np.floating], blades: Blades, opening: float
) -> Catch:
    """Return what the open blades have between them at a pose.

    Args:
        cloth: the cloth.
        state: as the blades find it.
        X_WT: (4, 4) of the tool centre point, z along the blades and downwards, y from the lower to the upper.
        blades: their geometry.
        opening: distance between the open blades, m.

    Raises:
        InputError: no pose, one that does not point downwards, or an opening that is not positive.
    """
    X = np.array(checked_pose(X_WT, "pinch"))
    if X[2, 2] > -0.1:
        raise InputError(
            f"pinch: the blades' axis has z {X[2, 2]:.2f} in the world; give a pose that points down"
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
    # Seen from the tool further up, the cloth is further down.
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
    elif len(nodes) < _LEAST_NODES:
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
    """Lift what is caught and hold it there.

    Args:
        cloth: the cloth.
        state: as the blades found it.
        held: what they caught, not nothing.
        hand: 0 right, 1 left; it must be empty.
        height: to lift by, m.
        duration: of the lift, s, a multiple of 20 ms.
        hold: time afterwards, s.

    Raises:
        InputError: nothing is caught, the hand holds something, or a bad time.
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
    up = (after > cloth.table.height + _LIFTED) & (after > before + _LIFTED)
    off = after > cloth.flat_height + cloth.material.thickness
    weight = float(off.sum()) * cell * cloth.material.areal_density * -GRAVITY[2]
    return Lift(state, float(up.sum()) * cell, weight)


def _triangles_near(
    cloth: Cloth, state: ClothState, X_WT: Array, blades: Blades, opening: float
) -> Array:
    """Corners (m, 3, 3) in T of the cloth's triangles that may lie under the blades or between them."""
    p = (cloth.vertices(state) - X_WT[:3, 3]) @ X_WT[:3, :3]
    corners = p[cloth.triangles]
    low, high = corners.min(axis=1), corners.max(axis=1)
    reach = 2.0 * blades.thickness + opening
    near = (low[:, 0] <= 0.5 * blades.width) & (high[:, 0] >= -0.5 * blades.width)
    near &= (low[:, 1] <= reach) & (high[:, 1] >= 0.0)
    return np.asarray(corners[near])


def _crossings(corners: Array, width: float, low: float, high: float) -> Array:
    """z (m, k) where rays along the blades' axis pass triangles (m, 3, 3); NaN where they do not.

    The rays stand CELL apart over |x| <= width / 2 and low <= y <= high, sorted by x, then y.
    """
    x = (np.arange(round(width / _CELL)) + 0.5) * _CELL - 0.5 * width
    count = max(1, round((high - low) / _CELL))
    y = low + (np.arange(count) + 0.5) * (high - low) / count
    rays = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2) + _ASIDE
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
    """How far a tip at z = end goes below the uppermost cloth under it, mean over the tip, m."""
    top = np.where(np.isfinite(z), z, np.inf).min(axis=0, initial=np.inf)
    return float(np.maximum(end - top, 0.0).mean())


def _depth(z: Array, level: float, width: float) -> float:
    """How far the fold stands above the level: highest across, median along the blades' width, m."""
    top = np.where(np.isfinite(z), z, np.inf).min(axis=0, initial=np.inf)
    crest = top.reshape(round(width / _CELL), -1).min(axis=1)
    # Beside the cloth there is nothing: as if it lay far below.
    return float(np.median(np.maximum(level - crest, -1.0)))


def _between(
    cloth: Cloth, state: ClothState, X_WT: Array, blades: Blades, opening: float, level: float
) -> NDArray[np.intp]:
    """Numbers of the nodes between the blades and above the level."""
    p = (cloth.vertices(state) - X_WT[:3, 3]) @ X_WT[:3, :3]
    low, high = blades.gap(opening)
    inside = (np.abs(p[:, 0]) <= 0.5 * blades.width) & (p[:, 1] >= low) & (p[:, 1] <= high)
    return np.asarray(cloth.numbers[inside & (p[:, 2] <= level)])
