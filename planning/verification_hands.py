"""What the hands do with the cloth: where they grasp and put down, how fast they hold, how far they stretch."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.robot import Cell
from unwrinkle.perception.target import STRETCH_LIMIT
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.verification_bounds import derivative_bounds, distances_to_axes
from unwrinkle.planning.verification_model import ARM_AXES, CellModel
from unwrinkle.planning.verification_motion import Leg
from unwrinkle.planning.verification_verdict import Findings

Array = NDArray[np.float64]

ARMS = ("right", "left")
#: From the tool centre point to the grasp or put-down point, horizontally, m.
PLACE_TOLERANCE = 5e-3
#: Of the tool centre point above the working table at the gripper events, m.
HEIGHTS = (-1e-4, 8e-3)
#: The cloth may go slack by so much while it is held, m.
SLACK = 5e-3
TILT_TOLERANCE = 1e-3
#: Relative, for rounding.
TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False)
class _Tip:
    """A tool centre point over one leg; P2 and P3 bound its second and third derivative in the intervals.

    Attributes:
        p_WT: (n, 3) at the samples.
        speed: (n,) at the samples, in the world.
        P2: (n-1,) of its position against the turn-table.
        P3: (n-1,) of its position in the world.
    """

    p_WT: Array
    speed: Array
    P2: Array
    P3: Array


def check_hands(
    plan: FlatteningPlan,
    cell: Cell,
    model: CellModel,
    legs: Sequence[Leg],
    frames: Sequence[tuple[Array, Array]],
    found: Findings,
) -> None:
    """Check places and tilts at the gripper events, and speed and stretch while holding.

    Args:
        plan: the plan.
        cell: with the limits at the plan's speed.
        model: of the cell.
        legs: the motion.
        frames: per leg what `CellModel.frames` gives at its samples.
        found: takes the checks `grasp`, `put_down`, `tilt`, `tip_speed`, `stretch`, `slack`.
    """
    holding = [
        (leg, [_tip(model, leg, X_WJ, X_WT[:, arm], arm) for arm in (0, 1)])
        for leg, (X_WJ, X_WT) in zip(legs, frames, strict=True)
        if leg.held and leg.name != "grippers"
    ]
    _check_speed(holding, cell.limits.tip_speed_holding, found)
    if plan.dual:
        _check_stretch(holding, STRETCH_LIMIT * plan.target.geodesic_distance, found)
    for leg, (_, X_WT) in zip(legs, frames, strict=True):
        for kind, name in (("grasp", "approach"), ("put_down", "pull")):
            if leg.name == name:
                _check_places(kind, plan, cell, model, float(leg.times[-1]), X_WT[-1], found)


def _tip(model: CellModel, leg: Leg, X_WJ: Array, X_WT: Array, arm: int) -> _Tip:
    chain = ARM_AXES[arm]
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
    _, _, P3 = derivative_bounds(rho, step, w[:, columns], a[:, columns], j[:, columns])
    own = columns[1:]
    _, P2, _ = derivative_bounds(rho[:, 1:], step, w[:, own], a[:, own], j[:, own])
    return _Tip(p_WT, np.linalg.norm(v, axis=1), P2, P3)


def _between(values: Array, curvature: Array, step: Array) -> Array:
    """Bound on the norm of a vector in every interval, from its norm at the ends and a bound of its second derivative.

    It leaves the chord by at most h^2 / 8 of that, and the norm on a chord is greatest at an end.
    """
    return np.maximum(values[:-1], values[1:]) + 0.125 * step**2 * curvature


def _check_speed(holding: Sequence[tuple[Leg, list[_Tip]]], limit: float, found: Findings) -> None:
    for arm, name in enumerate(ARMS):
        for leg, tips in holding:
            bound = _between(tips[arm].speed, tips[arm].P3, leg.step[:, 0])
            i = int(np.argmax(bound))
            worst, time = float(bound[i]), float(leg.times[i])
            if worst > limit * (1.0 + TOLERANCE):
                found.fail(
                    "tip_speed",
                    f"the {name} gripper's tip moves at up to {worst:.4f} m/s at {time:.3f} s of {leg.name} while "
                    f"cloth is held, {worst - limit:.4f} m/s more than the limit {limit:g} m/s",
                    time,
                )
            found.check("tip_speed", worst, limit, limit - worst, "m/s", f"{name} tip", time)


def _check_stretch(
    holding: Sequence[tuple[Leg, list[_Tip]]], limit: float, found: Findings
) -> None:
    for leg, (right, left) in holding:
        distance = np.linalg.norm(left.p_WT - right.p_WT, axis=1)
        bound = _between(distance, right.P2 + left.P2, leg.step[:, 0])
        i = int(np.argmax(bound))
        worst, time = float(bound[i]), float(leg.times[i])
        if worst > limit * (1.0 + TOLERANCE):
            found.fail(
                "stretch",
                f"the grippers are up to {worst:.4f} m apart at {time:.3f} s, {1e3 * (worst - limit):.1f} mm more "
                f"than the {limit:.4f} m that the cloth between them allows ({STRETCH_LIMIT} x its length)",
                time,
            )
        found.check("stretch", worst, limit, limit - worst, "m", "between the grippers", time)
        decrease = np.maximum.accumulate(distance) - distance
        i = int(np.argmax(decrease))
        worst, time = float(decrease[i]), float(leg.times[i])
        if worst > SLACK:
            found.fail(
                "slack",
                f"the grippers have come {1e3 * worst:.1f} mm nearer to each other by {time:.3f} s while they hold, "
                f"{1e3 * (worst - SLACK):.1f} mm more than the {1e3 * SLACK:.0f} mm allowed",
                time,
            )
        found.check("slack", worst, SLACK, SLACK - worst, "m", "between the grippers", time)


def _check_places(
    kind: str,
    plan: FlatteningPlan,
    cell: Cell,
    model: CellModel,
    time: float,
    X_WT: Array,
    found: Findings,
) -> None:
    window = cell.scenario.gripper
    for arm, name in enumerate(ARMS):
        choice = plan.arms[arm]
        if choice is None or choice.side not in (0, 1):
            continue
        hand = plan.target.hands[choice.side]
        place = hand.p_WG[:2].copy()
        if kind == "put_down":
            place += choice.share * hand.pull_distance * hand.pull_direction
        p = X_WT[arm, :3, 3]
        off = float(np.hypot(*(p[:2] - place)))
        what = f"the {name} gripper's tip is at ({p[0]:.3f}, {p[1]:.3f}) m at {time:.3f} s"
        if off > PLACE_TOLERANCE:
            found.fail(
                kind,
                f"{what}, {1e3 * off:.1f} mm from where it has to {kind.replace('_', ' ')} "
                f"({place[0]:.3f}, {place[1]:.3f}) m, at most {1e3 * PLACE_TOLERANCE:.0f} mm are allowed",
                time,
            )
        margin = PLACE_TOLERANCE - off
        found.check(kind, off, PLACE_TOLERANCE, margin, "m", f"{name} tip", time)
        height = float(p[2]) - model.table_height
        if not HEIGHTS[0] <= height <= HEIGHTS[1]:
            found.fail(
                kind,
                f"{what}, {1e3 * height:.1f} mm above the working table, where 0 to {1e3 * HEIGHTS[1]:.0f} mm is "
                "needed",
                time,
            )
        tilt = float(np.arcsin(np.clip(-X_WT[arm, 2, 2], -1.0, 1.0)))
        margin = min(tilt - window.tilt_lower, window.tilt_upper - tilt)
        if margin < -TILT_TOLERANCE:
            found.fail(
                "tilt",
                f"the {name} tool is {np.degrees(tilt):.1f} degrees below the horizontal at {time:.3f} s, outside "
                f"{np.degrees(window.tilt_lower):.0f} to {np.degrees(window.tilt_upper):.0f} degrees",
                time,
            )
        limit = window.tilt_lower if tilt - window.tilt_lower == margin else window.tilt_upper
        found.check("tilt", tilt, limit, margin, "rad", f"{name} tool", time)
