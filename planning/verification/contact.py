"""Checks of contact windows, named poses, and the speed of open fingers near the table."""

from collections.abc import Sequence

import numpy as np

from unwrinkle.models.arrays import Array
from unwrinkle.models.robot import Cell
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.verification.model import CellModel
from unwrinkle.planning.verification.tools import REACH, ToolLeg, away_from_place
from unwrinkle.planning.verification.verdict import Findings

ARMS = ("right", "left")
#: Greatest height of a tool centre point above the table at poses at which the blades are down, m.
DOWN = 0.020
#: Greatest distance of a tool centre point from its position at the segment's end, at poses at
#: which the grippers change, m.
END_TOLERANCE = 1e-3
_AT_END = ("grasp", "put-on-table")
_DOWN = ("touch-table", "free-garment")
_CLEAR = ("plan", "leave-table")


def check_contact(
    plan: FlatteningPlan, cell: Cell, model: CellModel, legs: Sequence[ToolLeg], found: Findings
) -> None:
    """Check contact windows and named poses against the tools' positions, and the speed of open
    fingers near the table.

    Args:
        plan: the plan.
        cell: its scenario's `tools` settings bound the speeds.
        model: of the cell.
        legs: the segments with the motion of their tools.
        found: receives the checks `contact`, `sliding`, `sinking`.
    """
    segments = {segment.name: segment for segment in plan.segments}
    for leg in legs:
        for arm, choice in enumerate(plan.arms):
            if choice is None or choice.side not in (0, 1):
                continue
            hand = plan.target.hands[choice.side]
            away = away_from_place(leg.tools[arm], hand, choice.share, model)
            _check_window(leg, away, arm, found)
            segment = segments.get(leg.leg.name)
            if segment is None:
                continue
            heights = leg.tools[arm].p_WT[:, 2] - model.table_height
            for mark in segment.poses:
                time = segment.start + mark.time
                at = int(np.argmin(np.abs(leg.leg.times - time)))
                near = cell.scenario.tools.near_table
                wrong = _wrong_pose(mark.name, float(away[at]), float(heights[at]), near)
                p_WT = leg.tools[arm].p_WT
                off = float(np.linalg.norm(p_WT[at] - p_WT[-1]))
                if mark.name in _AT_END and not off <= END_TOLERANCE:
                    wrong = f"is passed {1e3 * off:.0f} mm from where {segment.name} ends"
                if wrong:
                    found.fail(
                        "contact",
                        f"the pose {mark.name} at {time:.3f} s {wrong} ({ARMS[arm]} arm)",
                        time,
                    )
        if not leg.leg.held:
            for arm in (0, 1):
                _check_speeds(leg, cell, model, arm, found)


def _check_window(leg: ToolLeg, away: Array, arm: int, found: Findings) -> None:
    inside = np.flatnonzero(leg.in_contact)
    if not len(inside):
        return
    bound = np.maximum(away[inside], away[inside + 1]) + leg.tools[arm].sag[inside]
    i = int(np.argmax(bound))
    worst, time = float(bound[i]), float(leg.leg.times[inside[i]])
    if not worst <= REACH:
        found.fail(
            "contact",
            f"the contact window of {leg.leg.name} holds a time ({time:.3f} s) at which the "
            f"{ARMS[arm]} tool is {worst:.3f} m from its place on the table, at most {REACH:g} m "
            "are allowed",
            time,
        )
    found.check("contact", worst, REACH, REACH - worst, "m", f"{ARMS[arm]} tool", time)


def _wrong_pose(name: str, away: float, height: float, near: float) -> str:
    """Describe the error of a tool's position at a named pose; empty if there is none."""
    if name not in (*_AT_END, *_DOWN, *_CLEAR):
        return ""
    if not away <= REACH:
        return (
            f"is passed {away:.3f} m from the place on the table, at most {REACH:g} m are allowed"
        )
    if name in _DOWN and not height <= DOWN:
        return f"is passed {1e3 * height:.0f} mm above the table, where the blades are down"
    if name in _CLEAR and not height >= near:
        return f"is passed {1e3 * height:.0f} mm above the table, where the blades are clear of it"
    return ""


def _check_speeds(leg: ToolLeg, cell: Cell, model: CellModel, arm: int, found: Findings) -> None:
    settings, tool = cell.scenario.tools, leg.tools[arm]
    heights = tool.p_WT[:, 2] - model.table_height
    near = np.flatnonzero(np.minimum(heights[:-1], heights[1:]) - tool.sag < settings.near_table)
    if not len(near):
        return
    surge = tool.surge[near]
    across = np.linalg.norm(tool.velocity[:, :2], axis=1)
    down = np.maximum(-tool.velocity[:, 2], 0.0)
    for kind, speed, limit, what in (
        ("sliding", across, settings.sliding_speed, "slides over the table at"),
        ("sinking", down, settings.sinking_speed, "sinks towards the table at"),
    ):
        bound = np.maximum(speed[near], speed[near + 1]) + surge
        i = int(np.argmax(bound))
        worst, time = float(bound[i]), float(tool.times[near[i]])
        if not worst <= limit:
            found.fail(
                kind,
                f"the {ARMS[arm]} tool {what} up to {worst:.3f} m/s at {time:.3f} s of "
                f"{leg.leg.name}, nearer to it than {1e3 * settings.near_table:.0f} mm; at most "
                f"{limit:g} m/s are allowed",
                time,
            )
        found.check(kind, worst, limit, limit - worst, "m/s", f"{ARMS[arm]} tool", time)
