"""Motion of the tools over whole legs: place, posture, height and speed, bounded between samples.

Between two samples the deviation of a tool centre point from the chord of its positions is at most
h^2 / 8 times a bound on its acceleration; the same holds for the tool's axes. Where that is too
large, the leg is resampled at more times of the same cubic.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from unwrinkle.models.arrays import Array, Mask
from unwrinkle.perception.target import HandTarget
from unwrinkle.planning.verification.model import CellModel
from unwrinkle.planning.verification.motion import Leg
from unwrinkle.planning.verification.speed_bounds import derivative_bounds, distances_to_axes
from unwrinkle.planning.verification.verdict import Findings

#: Greatest deviation of a tool centre point from its chord between two times, m.
SAG = 0.5e-3
#: Greatest deviation of a tool's axis between two times, rad.
TURN = 1e-3
#: Greatest distance of a tool centre point from its place of work in a contact window, m.
REACH = 0.150
#: Limit of the times that are added to the samples of one plan.
MOST_TIMES = 20_000


@dataclass(frozen=True, eq=False)
class ToolMotion:
    """One arm's tool centre point and axes over one leg.

    Attributes:
        times: (n,) on the plan's clock, s.
        X_WT: (n, 4, 4) at the times.
        velocity: (n, 3) of the tool centre point in the world, m/s.
        P2: (n-1,) bound on its acceleration relative to the turn-table in the intervals, m/s^2.
        Q2: (n-1,) bound on its acceleration in the world, m/s^2.
        P3: (n-1,) bound on its jerk in the world, m/s^3.
        W2: (n-1,) bound on the second derivative of the tool's axes, 1/s^2.
    """

    times: Array
    X_WT: Array
    velocity: Array
    P2: Array
    Q2: Array
    P3: Array
    W2: Array

    @property
    def p_WT(self) -> Array:
        """Positions (n, 3), m."""
        return self.X_WT[:, :3, 3]

    @cached_property
    def step(self) -> Array:
        """Lengths of the intervals, (n-1,), s."""
        return np.diff(self.times)

    @cached_property
    def sag(self) -> Array:
        """Bound on the deviation of positions from their chord, (n-1,), m."""
        return 0.125 * self.step**2 * self.Q2

    @cached_property
    def turn(self) -> Array:
        """Bound on the deviation of the axes from the arc between their directions at the ends,
        (n-1,), rad: twice the chord's.
        """
        return 0.25 * self.step**2 * self.W2

    @cached_property
    def surge(self) -> Array:
        """Bound on the deviation of velocities from their chord, (n-1,), m/s."""
        return 0.125 * self.step**2 * self.P3


def tool_motion(model: CellModel, leg: Leg, X_WJ: Array, X_WT: Array, arm: int) -> ToolMotion:
    """Compute the motion of an arm's tool over a leg.

    Args:
        model: of the cell.
        leg: the motion.
        X_WJ: (n, 15, 4, 4) at its samples, see `CellModel.frames`.
        X_WT: (n, 4, 4) of the arm's tool centre point there.
        arm: 0 right, 1 left.
    """
    chain = model.tool_chains[arm]
    columns = list(chain)
    directions = model.axis_directions()
    p_WT = X_WT[:, :3, 3]
    v = np.zeros_like(p_WT)
    for joint in chain:
        z = X_WJ[:, joint, :3, :3] @ directions[joint]
        v += leg.velocities[:, joint, None] * np.cross(z, p_WT - X_WJ[:, joint, :3, 3])
    p_JT = (np.linalg.inv(X_WJ[0, chain[-1]]) @ X_WT[0])[None, :3, 3]
    rho = distances_to_axes(p_JT, X_WJ, directions, chain)
    step = leg.step[:, 0]
    w, a, j = leg.greatest_velocity, leg.greatest_acceleration, np.abs(leg.jerk)
    _, Q2, P3 = derivative_bounds(rho, step, w[:, columns], a[:, columns], j[:, columns])
    own = columns[1:]
    _, P2, _ = derivative_bounds(rho[:, 1:], step, w[:, own], a[:, own], j[:, own])
    # A direction rotates with all joints: |d''| <= |omega'| + |omega|^2.
    rates = w[:, columns]
    before = np.cumsum(rates, axis=1) - rates
    turning = a[:, columns].sum(axis=1) + (rates * before).sum(axis=1)
    return ToolMotion(leg.times, X_WT, v, P2, Q2, P3, turning + rates.sum(axis=1) ** 2)


@dataclass(frozen=True, eq=False)
class ToolLeg:
    """A leg with the motion of both arms' tools, sampled finely enough for the bounds above.

    Attributes:
        leg: the leg, possibly resampled.
        tools: of the right and the left arm.
    """

    leg: Leg
    tools: tuple[ToolMotion, ToolMotion]

    @cached_property
    def in_contact(self) -> Mask:
        """Intervals (n-1,) in the contact window."""
        if self.leg.contact is None:
            return np.zeros(len(self.leg.step), dtype=bool)
        begin, end = self.leg.contact
        times = self.leg.times
        return np.asarray((times[:-1] >= begin - 1e-9) & (times[1:] <= end + 1e-9))

    @cached_property
    def working(self) -> Mask:
        """Intervals (n-1,) in the contact window, or in which a gripper is closed."""
        return np.ones(len(self.leg.step), dtype=bool) if self.leg.held else self.in_contact


def away_from_place(tool: ToolMotion, hand: HandTarget, share: float, model: CellModel) -> Array:
    """Compute the distance (n,), m, of a tool from its place of work: horizontally from the line of
    its pull, or vertically.

    The greater of the two is returned; the line runs from the grasp to the put-down point on the
    table.

    Args:
        tool: motion of the tool.
        hand: of the target, served by this tool.
        share: of the hand's pull distance.
        model: of the cell.
    """
    way = share * hand.pull_distance * hand.pull_direction
    square = float(way @ way)
    p_GT = tool.p_WT[:, :2] - hand.p_WG[:2]
    along = p_GT @ way / square if square > 0.0 else np.zeros(len(p_GT))
    across = np.linalg.norm(p_GT - np.clip(along, 0.0, 1.0)[:, None] * way, axis=1)
    return np.asarray(np.maximum(across, np.abs(tool.p_WT[:, 2] - model.table_height)))


def tool_legs(
    model: CellModel,
    legs: Sequence[Leg],
    frames: Sequence[tuple[Array, Array]],
    near: float,
    found: Findings,
    *,
    closely: bool,
) -> list[ToolLeg]:
    """Compute the tools' motion over the segments, resampled where the bounds need it.

    Args:
        model: of the cell.
        legs: the motion; gripper strokes are skipped.
        frames: per leg the result of `CellModel.frames` at its samples.
        near: height above the table below which the bounds must hold too, m.
        found: receives a violation `contact` if a plan needs more times than the limit.
        closely: resample; False for a motion that is refused anyway.
    """
    result = []
    left = MOST_TIMES
    for leg, (X_WJ, X_WT) in zip(legs, frames, strict=True):
        if leg.name == "grippers":
            continue
        tools = [tool_motion(model, leg, X_WJ, X_WT[:, arm], arm) for arm in (0, 1)]
        tool_leg = ToolLeg(leg, (tools[0], tools[1]))
        floor = model.table_height + near
        times = _times(tool_leg, floor) if closely else leg.times
        if len(times) - len(leg.times) > left:
            found.fail(
                "contact",
                f"the motion of the tools during {leg.name} cannot be verified within {MOST_TIMES} "
                "configurations: its samples are too far apart",
                float(leg.times[0]),
            )
        elif len(times) > len(leg.times):
            left -= len(times) - len(leg.times)
            finer = leg.at_times(times)
            X_WJ, X_WT = model.frames(finer.positions)
            tools = [tool_motion(model, finer, X_WJ, X_WT[:, arm], arm) for arm in (0, 1)]
            tool_leg = ToolLeg(finer, (tools[0], tools[1]))
        result.append(tool_leg)
    return result


def _times(tool_leg: ToolLeg, floor: float) -> Array:
    """Return a leg's samples, the ends of its contact window, and the times between that the bounds
    need, s.
    """
    leg = tool_leg.leg
    low, high = leg.contact or (np.inf, -np.inf)
    # An interval that contains an end of the window counts as working.
    working = (leg.times[1:] > low) & (leg.times[:-1] < high)
    working |= leg.held
    for tool in tool_leg.tools:
        z = tool.p_WT[:, 2]
        working |= np.minimum(z[:-1], z[1:]) - tool.sag < floor
    needed = np.ones(len(leg.step))
    for tool in tool_leg.tools:
        for value, most in ((tool.sag, SAG), (tool.turn, TURN)):
            needed = np.maximum(needed, np.sqrt(value / most))
    counts = np.where(working, np.ceil(np.minimum(needed, 2.0 * MOST_TIMES)), 1).astype(int)
    ends = np.array([t for t in (low, high) if leg.times[0] < t < leg.times[-1]])
    if counts.max(initial=1) == 1 and not len(np.setdiff1d(ends, leg.times)):
        return leg.times
    if counts.sum() > 2 * MOST_TIMES + len(leg.times):
        return np.zeros(
            3 * MOST_TIMES + len(leg.times)
        )  # refused by the caller: only the count matters
    inside = np.repeat(leg.times[:-1], counts)
    share = np.concatenate([np.arange(n) / n for n in counts])
    times = inside + share * np.repeat(leg.step[:, 0], counts)
    return np.unique(np.concatenate([times, leg.times[-1:], ends]))
