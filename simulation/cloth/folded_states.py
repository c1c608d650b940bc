"""Initial states of a simulated garment with folds: a corner or an edge turned over, loose or
pressed, a border pushed in, two folds.
"""

import dataclasses as dc
import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.errors import InputError
from unwrinkle.simulation.cloth.cloth import Cloth
from unwrinkle.simulation.cloth.fingers import carry, let_go, take
from unwrinkle.simulation.cloth.state import ClothState

Centre = tuple[float, float]
Points = NDArray[np.float64]

#: Segments of the half ellipse along which a flap is carried, and the duration of each, s.
_ARC_SEGMENTS = 8
_SEGMENT_S = 0.16

#: Height of the half ellipse over the radius, and above it at least, m.
_ARC_RATIO = 0.7
_ARC_LEAST_M = 0.03

#: Height above the flat cloth at which a flap is let go, m.
_LAID_M = 0.008

#: Distance inside the border at which the fingers hold the cloth, m.
_INSET_M = 0.008

#: A hull edge of the outline is an edge of the garment if its middle lies this near the border, m.
_BORDER_M = 0.01

#: Radius of the fold of a pressed flap over the cloth's thickness.
_PRESSED_RADIUS = (0.6, 0.9)

#: Settling of a fold before it is at rest, s.
_SETTLE_S = 3.0


@dataclass(frozen=True)
class FoldLine:
    """A fold line in the garment's plane, and the material points that hands take.

    Attributes:
        normal: (2,) unit, towards the part that is folded over.
        offset: of the line along the normal, m.
        held: (k, 2) one or two points of the part beyond the line, m.
    """

    normal: Points
    offset: float
    held: Points

    def beyond(self, points: Points) -> Points:
        """Return the distances (n,) of material points (n, 2) beyond the line, m."""
        return points @ self.normal - self.offset


def corner_fold(cloth: Cloth, rng: np.random.Generator) -> FoldLine:
    """Draw a fold line across one of the garment's convex corners."""
    hull = _hull(cloth)
    before, after = np.roll(hull, 1, axis=0), np.roll(hull, -1, axis=0)
    inner = _unit(before - hull) + _unit(after - hull)
    sharp = np.flatnonzero(np.hypot(*inner.T) > 0.9)  # at most about 125 deg
    place = int(rng.choice(sharp))
    direction = -_unit(inner[place])
    normal = _turned(direction, math.radians(rng.uniform(-12.0, 12.0)))
    depth = rng.uniform(0.17, 0.34) * _width(cloth)
    tip = hull[place] + _INSET_M * _unit(inner[place])
    return FoldLine(normal, float(hull[place] @ normal) - depth, tip[None])


def edge_fold(cloth: Cloth, rng: np.random.Generator) -> FoldLine:
    """Draw a fold line along one of the garment's straight edges."""
    hull = _hull(cloth)
    after = np.roll(hull, -1, axis=0)
    length = np.hypot(*(after - hull).T)
    border = cloth.rest[cloth.boundary]
    middles = 0.5 * (hull + after)
    off = np.hypot(*(middles[:, None] - border[None]).transpose(2, 0, 1)).min(axis=1)
    edges = np.flatnonzero((length > 0.4 * length.max()) & (off < _BORDER_M))
    place = int(rng.choice(edges))
    along = _unit(after[place] - hull[place])
    outward = np.array([along[1], -along[0]])
    normal = _turned(outward, math.radians(rng.uniform(-5.0, 5.0)))
    depth = rng.uniform(0.12, 0.30) * _width(cloth)
    inset = np.array([_INSET_M, -_INSET_M])[:, None] * along - _INSET_M * outward
    held = np.stack([hull[place], after[place]]) + inset
    return FoldLine(normal, float(middles[place] @ outward) - depth, held)


def fold(cloth: Cloth, state: ClothState, line: FoldLine) -> ClothState:
    """Carry a part of the cloth over a fold line, along half ellipses, and let it go."""
    beyond = np.maximum(line.beyond(line.held), 0.0)
    hands = range(len(line.held))
    vertices = cloth.vertices(state)
    nodes = [int(np.hypot(*(cloth.rest - point).T).argmin()) for point in line.held]
    for hand, node in zip(hands, nodes, strict=True):
        state = take(cloth, state, hand, vertices[node])
    # The garment's plane is only turned in the world: the normal of the line in it.
    across = np.append(_in_world(cloth, state, line.normal), 0.0)
    angles = np.linspace(0.0, math.pi, _ARC_SEGMENTS + 1)
    for start, end in itertools.pairwise(angles.tolist()):
        moves: list[Points | None] = [None, None]
        for hand in hands:
            radius = float(beyond[hand])
            height = _ARC_RATIO * radius + _ARC_LEAST_M
            rise = height * (math.sin(end) - math.sin(start))
            rise += _LAID_M * (end - start) / math.pi
            move = -radius * (math.cos(start) - math.cos(end)) * across
            moves[hand] = move + np.array([0.0, 0.0, rise])
        state = carry(cloth, state, (moves[0], moves[1]), _SEGMENT_S)
    return cloth.settle(let_go(cloth, state), _SETTLE_S)


def pressed(cloth: Cloth, state: ClothState, line: FoldLine, radius: float) -> ClothState:
    """Lay a part of a flat cloth over a fold line without bulge, at once.

    The part goes round a half circle and lies parallel to the cloth below.

    Args:
        cloth: the cloth.
        state: flat.
        line: of the fold.
        radius: of the fold, m.
    """
    plane = cloth.outline.plane.reshape(-1, 2)
    beyond = line.beyond(plane)
    arc = math.pi * radius
    on_arc = np.clip(beyond / radius, 0.0, math.pi)
    back = np.where(
        beyond > 0.0, radius * np.sin(on_arc) - np.maximum(beyond - arc, 0.0) - beyond, 0.0
    )
    positions = state.positions.copy()
    positions[:2] += np.outer(_in_world(cloth, state, line.normal), back)
    positions[2] += np.where(beyond > 0.0, radius * (1.0 - np.cos(on_arc)), 0.0)
    return dc.replace(state, positions=positions)


def pushed_in(
    cloth: Cloth, state: ClothState, line: FoldLine, rng: np.random.Generator
) -> ClothState:
    """Push a border of the cloth inwards, towards a point that is held, so that it piles up."""
    vertices = cloth.vertices(state)
    middle, span = line.held.mean(axis=0), line.held[1] - line.held[0]
    place = middle + rng.uniform(-0.25, 0.25) * span
    anchor = place - rng.uniform(0.42, 0.52) * _width(cloth) * line.normal
    for hand, point in enumerate((place, anchor)):
        node = int(np.hypot(*(cloth.rest - point).T).argmin())
        state = take(cloth, state, hand, vertices[node])
    inward = -np.append(_in_world(cloth, state, line.normal), 0.0)
    far = rng.uniform(0.28, 0.38) * _width(cloth)
    up = np.array([0.0, 0.0, 0.004])
    state = carry(cloth, state, (up, None), 0.1)
    state = carry(cloth, state, (far * inward, None), 1.0)
    return cloth.settle(let_go(cloth, state), _SETTLE_S)


def folded_state(cloth: Cloth, name: str, centre: Centre, seed: int) -> ClothState:
    """Return a settled folded state by its name: corner, edge, pressed, pushed or twice.

    Fold line, its place and the garment's turn on the table are drawn from the seed.

    Raises:
        InputError: unknown name, bad centre.
        ClothError: the solver failed.
    """
    makers: dict[str, Callable[[ClothState, np.random.Generator], ClothState]] = {
        "corner": lambda state, rng: fold(cloth, state, corner_fold(cloth, rng)),
        "edge": lambda state, rng: fold(cloth, state, edge_fold(cloth, rng)),
        "pressed": lambda state, rng: _pressed(cloth, state, rng),
        "pushed": lambda state, rng: pushed_in(cloth, state, edge_fold(cloth, rng), rng),
        "twice": lambda state, rng: _twice(cloth, state, rng),
    }
    if name not in makers:
        raise InputError(f"no folded start is called {name!r}; try one of {', '.join(makers)}")
    rng = np.random.default_rng(seed)
    turn = math.radians(rng.uniform(-12.0, 12.0))
    return makers[name](cloth.flat(centre, turn), rng)


def _pressed(cloth: Cloth, state: ClothState, rng: np.random.Generator) -> ClothState:
    draw = corner_fold if rng.uniform() < 0.5 else edge_fold
    radius = rng.uniform(*_PRESSED_RADIUS) * cloth.material.thickness
    return pressed(cloth, state, draw(cloth, rng), radius)


def _twice(cloth: Cloth, state: ClothState, rng: np.random.Generator) -> ClothState:
    first = edge_fold(cloth, rng)
    state = fold(cloth, state, first)
    for _ in range(20):
        second = corner_fold(cloth, rng)
        if first.beyond(second.held).max() < 0.0:  # not the part that was folded over
            break
    return fold(cloth, state, second)


def _hull(cloth: Cloth) -> Points:
    """Return the convex hull's corners (n, 2) of the flat garment, anti-clockwise, simplified."""
    hull = cv2.convexHull(cloth.rest.astype(np.float32))
    near = cv2.approxPolyDP(hull, 1.5 * cloth.outline.spacing, True)[:, 0].astype(float)
    x, y = near.T
    area = float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
    return near if area > 0.0 else near[::-1]


def _width(cloth: Cloth) -> float:
    """Return the smaller side of the flat garment, m."""
    return float(np.ptp(cloth.rest, axis=0).min())


def _unit(vectors: Points) -> Points:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def _turned(vector: Points, angle: float) -> Points:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s], [s, c]]) @ vector


def _in_world(cloth: Cloth, state: ClothState, direction: Points) -> Points:
    """Return a direction (2,) of the garment's plane in the world, by the best rigid fit."""
    places = cloth.vertices(state)[:, :2]
    rest = cloth.rest - cloth.rest.mean(axis=0)
    u, _, vt = np.linalg.svd(rest.T @ (places - places.mean(axis=0)))
    return np.asarray(direction @ u @ vt)
