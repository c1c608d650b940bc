"""Checks of the tools' postures during contact and holding against the postures that the plan
states.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.arrays import Array
from unwrinkle.models.robot import Cell
from unwrinkle.planning.plan import ArmChoice, FlatteningPlan
from unwrinkle.planning.verification.model import CellModel
from unwrinkle.planning.verification.tools import REACH, ToolLeg, ToolMotion, away_from_place
from unwrinkle.planning.verification.verdict import Findings

ARMS = ("right", "left")
#: Greatest difference of tilt, heading and roll from the stated ones, rad.
POSTURE_TOLERANCE = 0.02
#: Greatest excess of the tilt over the gripper's window, rad.
TILT_TOLERANCE = 5e-3
#: Greatest difference of the turn-table from the stated angle, rad.
TURNTABLE_TOLERANCE = 1e-3
#: Greatest motion of a turn-table that is fixed, rad.
FIXED_TOLERANCE = 1e-6
#: Cosine of the tilt below which the heading is undefined: the tool points straight down.
_UPRIGHT = 0.05


def check_postures(
    plan: FlatteningPlan, cell: Cell, model: CellModel, legs: Sequence[ToolLeg], found: Findings
) -> None:
    """Check tilt, heading and roll of the tools, and the turn-table, in contact, near the table,
    and while holding.

    Args:
        plan: the plan.
        cell: its gripper bounds the tilt; its planner may keep the turn-table fixed.
        model: of the cell.
        legs: the segments with the motion of their tools.
        found: receives the checks `tilt`, `heading`, `roll`, `turntable`.
    """
    for leg in legs:
        _check_fixed(cell, leg, found)
        for arm, choice in enumerate(plan.arms):
            if choice is None or choice.side not in (0, 1):
                continue
            # A contact window away from the place of work is a violation of the check `contact`.
            hand = plan.target.hands[choice.side]
            away = away_from_place(leg.tools[arm], hand, choice.share, model)
            near = leg.leg.held | (np.maximum(away[:-1], away[1:]) <= REACH)
            low = _low(leg.tools[arm], model.table_height + cell.scenario.tools.near_table)
            working = np.flatnonzero((leg.working & near) | low)
            if len(working):
                _check_turntable(plan, cell, leg, working, found)
                _check_arm(plan, cell, leg, working, arm, choice, found)


def _low(tool: ToolMotion, height: float) -> NDArray[np.bool_]:
    """Return the intervals (n-1,) in which a tool centre point may be below a height, m."""
    z = tool.p_WT[:, 2]
    return np.asarray(np.minimum(z[:-1], z[1:]) - tool.sag < height)


def _check_arm(
    plan: FlatteningPlan,
    cell: Cell,
    leg: ToolLeg,
    working: NDArray[np.intp],
    arm: int,
    choice: ArmChoice,
    found: Findings,
) -> None:
    tool, name = leg.tools[arm], ARMS[arm]
    claimed = _turned(plan.target.hands[choice.side].grasp_direction, choice.offset)
    tilt, heading, roll = tool_angles(tool.X_WT[:, :3, :3], claimed)
    turn = tool.turn[working]
    window = cell.scenario.gripper
    low = np.minimum(tilt[working], tilt[working + 1]) - turn
    high = np.maximum(tilt[working], tilt[working + 1]) + turn
    lower, upper = window.tilt_lower - TILT_TOLERANCE, window.tilt_upper + TILT_TOLERANCE
    for margins, angles, bound in ((low - lower, low, lower), (upper - high, high, upper)):
        i = int(np.argmin(margins))
        margin, worst = float(margins[i]), float(angles[i])
        time = float(tool.times[working[i]])
        if not margin >= 0.0:
            found.fail(
                "tilt",
                f"the {name} tool is {np.degrees(worst):.1f} degrees below the horizontal at "
                f"{time:.3f} s of {leg.leg.name}, outside {np.degrees(window.tilt_lower):.0f} to "
                f"{np.degrees(window.tilt_upper):.0f} degrees",
                time,
            )
        found.check("tilt", worst, bound, margin, "rad", f"{name} tool", time)
    # Near the vertical a small rotation of the tool changes its heading by much.
    level = np.cos(tilt)
    for kind, angle, share, what in (
        ("tilt", np.abs(tilt - choice.tilt), 1.0, f"tilt of {np.degrees(choice.tilt):.1f} degrees"),
        ("heading", np.abs(heading) * np.maximum(level, _UPRIGHT), 1.0, "grasp direction"),
        ("roll", np.abs(roll), 3.0, "blades that lie flat"),
    ):
        off = np.maximum(angle[working], angle[working + 1]) + share * turn
        i = int(np.argmax(off))
        worst, time = float(off[i]), float(tool.times[working[i]])
        if not worst <= POSTURE_TOLERANCE:
            shown = worst / max(float(level[working[i]]), _UPRIGHT) if kind == "heading" else worst
            found.fail(
                kind,
                f"the {name} tool is {np.degrees(shown):.1f} degrees off the stated {what} at "
                f"{time:.3f} s of {leg.leg.name}, about {np.degrees(POSTURE_TOLERANCE):.1f} are "
                "allowed",
                time,
            )
        if kind != "tilt":
            margin = POSTURE_TOLERANCE - worst
            found.check(kind, worst, POSTURE_TOLERANCE, margin, "rad", f"{name} tool", time)


def tool_angles(R_WT: Array, claimed: Array) -> tuple[Array, Array, Array]:
    """Tilt below the horizontal, heading against a claimed one, and roll about the approach axis,
    rad.

    z of a tool is its approach axis, y goes from the lower to the upper blade. Of the two
    descriptions of one posture (the other has a tilt beyond the vertical) the one nearer to the
    claimed heading is taken.

    Args:
        R_WT: (n, 3, 3).
        claimed: (2,) unit vector.

    Returns:
        Each (n,).
    """
    y, z = R_WT[:, :, 1], R_WT[:, :, 2]
    horizontal = np.hypot(z[:, 0], z[:, 1])
    away = np.arctan2(claimed[1], claimed[0])
    heading = np.where(horizontal < _UPRIGHT, 0.0, _wrapped(np.arctan2(z[:, 1], z[:, 0]) - away))
    tilt = np.arctan2(-z[:, 2], horizontal)
    c, s = np.cos(heading + away), np.sin(heading + away)
    # Across the approach, level; and the blades' direction that goes with no roll.
    across = np.stack([-s, c, np.zeros_like(c)], axis=1)
    level = np.cross(z, across)
    level /= np.maximum(np.linalg.norm(level, axis=1, keepdims=True), 1e-12)
    roll = np.arctan2(np.sum(y * across, axis=1), np.sum(y * level, axis=1))
    over = (np.abs(heading) > 0.5 * np.pi) & (np.abs(roll) > 0.5 * np.pi)
    return (
        np.where(over, np.pi - tilt, tilt),
        np.where(over, _wrapped(heading - np.pi), heading),
        np.where(over, _wrapped(roll - np.pi), roll),
    )


def _check_fixed(cell: Cell, leg: ToolLeg, found: Findings) -> None:
    if cell.scenario.planner.turntable != "fixed":
        return
    axis = cell.robot.turntable_axis
    low, high = (q[:, axis] for q in leg.leg.position_extremes())
    moved = float(high.max() - low.min())
    if not moved <= FIXED_TOLERANCE:
        found.fail(
            "turntable",
            f"the turn-table moves by {moved:.4f} rad during {leg.leg.name}, but it is fixed in "
            "this cell",
            float(leg.leg.times[0]),
        )


def _check_turntable(
    plan: FlatteningPlan, cell: Cell, leg: ToolLeg, working: NDArray[np.intp], found: Findings
) -> None:
    axis = cell.robot.turntable_axis
    low, high = (q[working, axis] for q in leg.leg.position_extremes())
    off = np.maximum(high - plan.turntable, plan.turntable - low)
    i = int(np.argmax(off))
    worst, time = float(off[i]), float(leg.leg.times[working[i]])
    if not worst <= TURNTABLE_TOLERANCE and not found.failed("turntable"):
        found.fail(
            "turntable",
            f"the turn-table is {worst:.4f} rad off the stated {plan.turntable:.4f} rad at "
            f"{time:.3f} s of {leg.leg.name}, at most {TURNTABLE_TOLERANCE:g} rad are allowed",
            time,
        )
    margin = TURNTABLE_TOLERANCE - worst
    found.check("turntable", worst, TURNTABLE_TOLERANCE, margin, "rad", leg.leg.name, time)


def _turned(direction: Array, angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([c * direction[0] - s * direction[1], s * direction[0] + c * direction[1]])


def _wrapped(angle: Array) -> Array:
    return (angle + np.pi) % (2.0 * np.pi) - np.pi
