"""The seven poses of the flattening motion and the smooth Cartesian pieces between them.

Plan, touch-table, grasp, pull, put-on-table, free-garment, leave-table (Sun et al. 2015, Fig. 5). The gripper closes at the third
and opens at the fifth, which cuts the motion into three pieces: approach, pull, release.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from unwrinkle.models.arrays import Array
from unwrinkle.perception.target import HandTarget
from unwrinkle.planning.search.settings import MotionShape

POSES = ("plan", "touch-table", "grasp", "pull", "put-on-table", "free-garment", "leave-table")
PIECES = (("approach", 0, 2), ("pull", 2, 4), ("release", 4, 6))
#: A rounded corner passes the corner at this times its radius times the change of direction.
_CUT_OFF = 0.15625
#: Steps of the iteration that moves a corner out until its rounding meets the pose; each leaves about a fifth.
_MEET_STEPS = 5


@dataclass(frozen=True)
class Freedom:
    """What the search chose for one hand. Angles in rad.

    Attributes:
        offset: the grasp direction turned by this about the vertical (Algorithm 1).
        tilt: of the tool below the horizontal.
        share: the hand's pull distance over the target's.
    """

    offset: float
    tilt: float
    share: float = 1.0


def seven_positions(hand: HandTarget, freedom: Freedom, shape: MotionShape) -> Array:
    """p_WT (7, 3) of the tool centre point at the seven poses, m."""
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
    """Unit direction (2,) of the grasp, turned by an offset in rad."""
    c, s = np.cos(offset), np.sin(offset)
    x, y = hand.grasp_direction
    return np.array([c * x - s * y, s * x + c * y])


def tool_rotation(direction: Array, tilt: Array | float) -> Array:
    """R_WT (..., 3, 3): z along the approach (tilted below the horizontal), y from the lower to the upper blade.

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
    """X_WT (..., 4, 4) from positions (..., 3) and a rotation (3, 3)."""
    X = np.zeros((*positions.shape[:-1], 4, 4))
    X[..., :3, :3] = rotation
    X[..., :3, 3] = positions
    X[..., 3, 3] = 1.0
    return X


def piece_counts(positions: Sequence[Array], step: float) -> list[int]:
    """Numbers of intervals for the three pieces, so that no hand moves by more than about a step, m, in one."""
    counts = []
    for _, first, last in PIECES:
        longest = 0.0
        for p in positions:
            legs = np.diff(p[first : last + 1], axis=0)
            longest = max(longest, float(np.linalg.norm(legs, axis=1).sum()))
        counts.append(max(8, int(np.ceil(longest / step - 1e-6))))
    return counts


def piece(positions: Array, radius: float, count: int, *, meet: bool = False) -> Array:
    """A piece through three poses with its corner rounded, p_WT (count + 1, 3).

    Along the arc length the direction turns from the first leg's to the second's over a blend of the given radius, by a quintic
    that is smooth to the second derivative; the path is its integral, so it is smooth to the third.

    Args:
        positions: (3, 3) start, corner, end.
        radius: m; at most 0.9 of the shorter leg is used.
        count: intervals, equal in arc length.
        meet: the rounded path goes through the middle pose; else it passes it on the inside.
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
    # Integral of the smoothstep 6 x^5 - 15 x^4 + 10 x^3 from 0 to x, then the full direction beyond the blend.
    turned = 2.0 * r * (x**6 - 3.0 * x**5 + 2.5 * x**4) + np.maximum(s - lengths[0] - r, 0.0)
    return np.asarray(start + first * s[:, None] + (second - first) * turned[:, None])


def _legs(
    start: Array, corner: Array, end: Array, radius: float
) -> tuple[Array, Array, Array, float]:
    """Directions and lengths of the two legs, and the blend's radius; 0 where a leg has no length."""
    legs = corner - start, end - corner
    lengths = np.array([np.linalg.norm(leg) for leg in legs])
    if lengths.min() < 1e-9:
        return np.zeros(3), np.zeros(3), lengths, 0.0
    return legs[0] / lengths[0], legs[1] / lengths[1], lengths, min(radius, 0.9 * lengths.min())


def pieces(positions: Array, radius: float, counts: list[int]) -> list[Array]:
    """The three pieces of a hand, each (count + 1, 3), never below the lowest of the seven poses."""
    floor = positions[:, 2].min()
    out = []
    for (name, first, last), count in zip(PIECES, counts, strict=True):
        # Down at the table the inside of the corner is above it; up at the pull pose it would cost lift.
        p = piece(positions[first : last + 1], radius, count, meet=name == "pull")
        p[:, 2] = np.maximum(p[:, 2], floor)
        out.append(p)
    return out
