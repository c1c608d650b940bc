"""The seven poses of the flattening motion, and smooth Cartesian pieces between them.

Plan, touch-table, grasp, pull, put-on-table, free-garment, leave-table (Sun et al. 2015, Fig. 5).
The grippers close at the third and open at the fifth pose, which divides the motion into three
pieces: approach, pull, release.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from unwrinkle.models.arrays import Array
from unwrinkle.perception.target import HandTarget
from unwrinkle.planning.search.settings import MotionShape

POSES = ("plan", "touch-table", "grasp", "pull", "put-on-table", "free-garment", "leave-table")
PIECES = (("approach", 0, 2), ("pull", 2, 4), ("release", 4, 6))
#: Distance of a rounded path from its corner over the radius and the change of direction.
_CUT_OFF = 0.15625
#: Iterations that move a corner outwards until its rounding passes through the pose; each leaves
#: about a fifth of the error.
_MEET_STEPS = 5


@dataclass(frozen=True)
class Freedom:
    """Values of one hand's freedoms. Angles in rad.

    Attributes:
        offset: turn of the grasp direction about the vertical (Algorithm 1).
        tilt: of the tool below the horizontal.
        share: pull distance over the target's.
    """

    offset: float
    tilt: float
    share: float = 1.0


def seven_positions(hand: HandTarget, freedom: Freedom, shape: MotionShape) -> Array:
    """Compute p_WT (7, 3) of the tool centre point at the seven poses, m."""
    u = approach_direction(hand, freedom.offset)
    f = np.append(hand.pull_direction, 0.0)
    u = np.append(u, 0.0)
    pull = freedom.share * hand.pull_distance
    down = hand.p_WG + [0.0, 0.0, shape.table_gap]
    up = np.array([0.0, 0.0, shape.height])
    put = down + pull * f
    return np.array(
        [
            down - (shape.touch_distance + shape.back_off) * u + up,
            down - shape.touch_distance * u,
            down,
            down + shape.pull_fraction * pull * f + [0.0, 0.0, shape.lift],
            put,
            put - shape.free_distance * u,
            put - shape.leave_distance * u + up,
        ]
    )


def approach_direction(hand: HandTarget, offset: float) -> Array:
    """Return the unit direction (2,) of the grasp, turned by an offset, rad."""
    c, s = np.cos(offset), np.sin(offset)
    x, y = hand.grasp_direction
    return np.array([c * x - s * y, s * x + c * y])


def tool_rotation(direction: Array, tilt: Array | float) -> Array:
    """Compute R_WT (..., 3, 3): z along the approach, tilted below the horizontal; y from the lower
    to the upper blade.

    Args:
        direction: (..., 2) unit horizontal approach directions.
        tilt: angles below the horizontal, rad, broadcastable.
    """
    c, s = np.cos(tilt), np.sin(tilt)
    dx, dy = direction[..., 0], direction[..., 1]
    z = np.stack(np.broadcast_arrays(c * dx, c * dy, -s), axis=-1)
    y = np.stack(np.broadcast_arrays(s * dx, s * dy, c), axis=-1)
    return np.stack([np.cross(y, z), y, z], axis=-1)


def tool_poses(positions: Array, rotation: Array) -> Array:
    """Join positions (..., 3), m, and a rotation (3, 3) to X_WT (..., 4, 4)."""
    X = np.zeros((*positions.shape[:-1], 4, 4))
    X[..., :3, :3] = rotation
    X[..., :3, 3] = positions
    X[..., 3, 3] = 1.0
    return X


def piece_counts(positions: Sequence[Array], step: float) -> list[int]:
    """Choose the numbers of intervals of the three pieces so that no hand moves further than about
    a step, m, in one.
    """
    counts = []
    for _, first, last in PIECES:
        longest = 0.0
        for p in positions:
            legs = np.diff(p[first : last + 1], axis=0)
            longest = max(longest, float(np.linalg.norm(legs, axis=1).sum()))
        counts.append(max(8, int(np.ceil(longest / step - 1e-6))))
    return counts


def piece(positions: Array, radius: float, count: int, *, meet: bool = False) -> Array:
    """Compute a piece through three positions with a rounded corner, p_WT (count + 1, 3), m.

    Along the arc length the direction changes from the first leg's to the second's over a blend of
    the given radius, by a quintic with continuous second derivative; the path is its integral and
    has a continuous third derivative.

    Args:
        positions: (3, 3) start, corner, end.
        radius: m; at most 0.9 of the shorter leg is used.
        count: number of intervals, equal in arc length.
        meet: pass through the middle position; else pass it on the inside of the corner.
    """
    start, corner, end = positions
    if meet:
        for _ in range(_MEET_STEPS):
            first, second, _, r = _legs(start, corner, end, radius)
            corner = positions[1] + _CUT_OFF * r * (first - second)
    first, second, lengths, r = _legs(start, corner, end, radius)
    total = lengths.sum()
    s = np.linspace(0.0, total, count + 1)
    if r == 0.0:
        return np.asarray(start + (end - start) * (s / max(total, 1e-12))[:, None])
    x = np.clip((s - lengths[0] + r) / (2.0 * r), 0.0, 1.0)
    # Integral of the smoothstep 6 x^5 - 15 x^4 + 10 x^3 from 0 to x, then the full direction beyond
    # the blend.
    turned = 2.0 * r * (x**6 - 3.0 * x**5 + 2.5 * x**4) + np.maximum(s - lengths[0] - r, 0.0)
    return np.asarray(start + first * s[:, None] + (second - first) * turned[:, None])


def _legs(
    start: Array, corner: Array, end: Array, radius: float
) -> tuple[Array, Array, Array, float]:
    """Return directions and lengths of the two legs, and the blend's radius, m.

    0 if a leg has no length.
    """
    legs = corner - start, end - corner
    lengths = np.array([np.linalg.norm(leg) for leg in legs])
    if lengths.min() < 1e-9:
        return np.zeros(3), np.zeros(3), lengths, 0.0
    return legs[0] / lengths[0], legs[1] / lengths[1], lengths, min(radius, 0.9 * lengths.min())


def pieces(positions: Array, radius: float, counts: list[int]) -> list[Array]:
    """Compute the three pieces of a hand, each (count + 1, 3), m, never below the lowest of the
    seven positions.
    """
    floor = positions[:, 2].min()
    out = []
    for (name, first, last), count in zip(PIECES, counts, strict=True):
        # At the table the inside of the corner lies above it; at the pull pose it would reduce the
        # lift.
        p = piece(positions[first : last + 1], radius, count, meet=name == "pull")
        p[:, 2] = np.maximum(p[:, 2], floor)
        out.append(p)
    return out
