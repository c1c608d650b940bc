"""Checks of the hands' work on the cloth.

Places of grasp, pull and put-down, speed while holding, stretch, slack.
"""

from collections.abc import Sequence

import numpy as np

from unwrinkle.models.arrays import Array
from unwrinkle.models.robot import Cell
from unwrinkle.perception.target import STRETCH_LIMIT
from unwrinkle.planning.plan import ArmChoice, FlatteningPlan
from unwrinkle.planning.verification.model import CellModel
from unwrinkle.planning.verification.tools import ToolLeg, ToolMotion
from unwrinkle.planning.verification.verdict import Findings

ARMS = ("right", "left")
#: Greatest horizontal distance of the tool centre point from the grasp or put-down point, m.
PLACE_TOLERANCE = 5e-3
#: Greatest distance from the line between the two points, m: the tolerance of its ends, and 1 mm
#: for the motion between samples.
LINE_TOLERANCE = 6e-3
#: Range of the tool centre point's height above the working table at the gripper events, m.
HEIGHTS = (-1e-4, 8e-3)
#: Greatest decrease of the grippers' distance while they hold, and greatest backward motion of a
#: hand on its pull, m.
SLACK = 5e-3
#: Relative tolerance for rounding.
TOLERANCE = 1e-9


def check_hands(
    plan: FlatteningPlan, cell: Cell, model: CellModel, legs: Sequence[ToolLeg], found: Findings
) -> None:
    """Check the tools' places at the gripper events, and their path, speed and stretch of the cloth
    while holding.

    Args:
        plan: the plan.
        cell: with the limits at the plan's speed.
        model: of the cell.
        legs: the segments with the motion of their tools.
        found: receives the checks `grasp`, `pull`, `put_down`, `table`, `tip_speed`, `stretch`,
            `slack`.
    """
    holding = [leg for leg in legs if leg.leg.held]
    _check_speed(holding, cell.limits.tip_speed_holding, found)
    if plan.dual:
        limit = STRETCH_LIMIT * plan.target.geodesic_distance
        for leg in holding:
            _check_stretch(leg, limit, found)
    for arm, choice in enumerate(plan.arms):
        if choice is None or choice.side not in (0, 1):
            continue
        work = _Work(plan, arm, choice, cell, model)
        for leg in legs:
            if leg.leg.name == "approach":
                work.check_place("grasp", leg.tools[arm], found)
            elif leg.leg.name == "pull":
                work.check_place("put_down", leg.tools[arm], found)
                work.check_pull(leg.tools[arm], found)
                if not plan.dual:
                    work.check_alone(leg.tools[arm], found)


def _between(values: Array, sag: Array) -> Array:
    """Bound the norm of a vector in every interval.

    The greater norm at its ends, plus the deviation from the chord.
    """
    return np.maximum(values[:-1], values[1:]) + sag


def _check_speed(holding: Sequence[ToolLeg], limit: float, found: Findings) -> None:
    for arm, name in enumerate(ARMS):
        for leg in holding:
            tool = leg.tools[arm]
            bound = _between(np.linalg.norm(tool.velocity, axis=1), tool.surge)
            i = int(np.argmax(bound))
            worst, time = float(bound[i]), float(tool.times[i])
            if not worst <= limit * (1.0 + TOLERANCE):
                found.fail(
                    "tip_speed",
                    f"the {name} gripper's tip moves at up to {worst:.4f} m/s at {time:.3f} s of "
                    f"{leg.leg.name} while cloth is held, {worst - limit:.4f} m/s more than the "
                    f"limit {limit:g} m/s",
                    time,
                )
            found.check("tip_speed", worst, limit, limit - worst, "m/s", f"{name} tip", time)


def _check_stretch(leg: ToolLeg, limit: float, found: Findings) -> None:
    right, left = leg.tools
    distance = np.linalg.norm(left.p_WT - right.p_WT, axis=1)
    bound = _between(distance, 0.125 * right.step**2 * (right.P2 + left.P2))
    i = int(np.argmax(bound))
    worst, time = float(bound[i]), float(right.times[i])
    if not worst <= limit * (1.0 + TOLERANCE):
        found.fail(
            "stretch",
            f"the grippers are up to {worst:.4f} m apart at {time:.3f} s, "
            f"{1e3 * (worst - limit):.1f} mm more than the {limit:.4f} m that the cloth between "
            f"them allows ({STRETCH_LIMIT} x its length)",
            time,
        )
    found.check("stretch", worst, limit, limit - worst, "m", "between the grippers", time)
    decrease = np.maximum.accumulate(distance) - distance
    i = int(np.argmax(decrease))
    worst, time = float(decrease[i]), float(right.times[i])
    if not worst <= SLACK:
        found.fail(
            "slack",
            f"the distance of the holding grippers has decreased by {1e3 * worst:.1f} mm at "
            f"{time:.3f} s, {1e3 * (worst - SLACK):.1f} mm more than the {1e3 * SLACK:.0f} mm "
            "allowed",
            time,
        )
    found.check("slack", worst, SLACK, SLACK - worst, "m", "between the grippers", time)


class _Work:
    """Checks of one arm that serves one hand of the target."""

    def __init__(
        self, plan: FlatteningPlan, arm: int, choice: ArmChoice, cell: Cell, model: CellModel
    ) -> None:
        self._name, self._model = ARMS[arm], model
        self._height = cell.scenario.tools.holding_height
        self._other = plan.target.hands[1 - choice.side]
        self._limit = STRETCH_LIMIT * plan.target.geodesic_distance
        hand = plan.target.hands[choice.side]
        self._direction = hand.pull_direction
        self._length = choice.share * hand.pull_distance
        self._begin = hand.p_WG[:2]
        self._end = self._begin + self._length * hand.pull_direction

    def check_place(self, kind: str, tool: ToolMotion, found: Findings) -> None:
        """Check the tool's place and height at the end of its leg, and that the place lies on the
        table.
        """
        place = self._begin if kind == "grasp" else self._end
        p, time, name = tool.p_WT[-1], float(tool.times[-1]), self._name
        off = float(np.hypot(*(p[:2] - place)))
        what = f"the {name} gripper's tip is at ({p[0]:.3f}, {p[1]:.3f}) m at {time:.3f} s"
        if not off <= PLACE_TOLERANCE:
            found.fail(
                kind,
                f"{what}, {1e3 * off:.1f} mm from the {kind.replace('_', '-')} point "
                f"({place[0]:.3f}, {place[1]:.3f}) m, at most {1e3 * PLACE_TOLERANCE:.0f} mm are "
                "allowed",
                time,
            )
        margin = PLACE_TOLERANCE - off
        found.check(kind, off, PLACE_TOLERANCE, margin, "m", f"{name} tip", time)
        height = float(p[2]) - self._model.table_height
        if not HEIGHTS[0] <= height <= HEIGHTS[1]:
            found.fail(
                kind,
                f"{what}, {1e3 * height:.1f} mm above the working table, where 0 to "
                f"{1e3 * HEIGHTS[1]:.0f} mm is needed",
                time,
            )
        for point, x in ((kind.replace("_", "-"), place), ("tip", p[:2])):
            allowed = 0.0 if point != "tip" else PLACE_TOLERANCE
            self._check_table(f"the {name} gripper's {point}", x, allowed, time, found)

    def _check_table(
        self, what: str, place: Array, allowed: float, time: float, found: Findings
    ) -> None:
        beyond = float(self._model.beyond_table(place))
        if not beyond <= allowed:
            found.fail(
                "table",
                f"{what} is at ({place[0]:.3f}, {place[1]:.3f}) m at {time:.3f} s, "
                f"{1e3 * beyond:.0f} mm beyond the edge of the working table",
                time,
            )
        found.check("table", beyond, allowed, allowed - beyond, "m", f"{self._name} gripper", time)

    def check_pull(self, tool: ToolMotion, found: Findings) -> None:
        """Check that the tool stays near the line from grasp to put-down and low, and does not go
        back, while it holds.
        """
        along = (tool.p_WT[:, :2] - self._begin) @ self._direction
        nearest = np.clip(along, 0.0, max(self._length, 0.0))[:, None] * self._direction
        off = _between(np.linalg.norm(tool.p_WT[:, :2] - self._begin - nearest, axis=1), tool.sag)
        i = int(np.argmax(off))
        worst, time = float(off[i]), float(tool.times[i])
        if not worst <= LINE_TOLERANCE:
            found.fail(
                "pull",
                f"the {self._name} gripper is {1e3 * worst:.1f} mm off the line of its pull at "
                f"{time:.3f} s, at most {1e3 * LINE_TOLERANCE:.0f} mm are allowed while cloth is "
                "held",
                time,
            )
        margin = LINE_TOLERANCE - worst
        found.check("pull", worst, LINE_TOLERANCE, margin, "m", f"{self._name} tip", time)
        height = _between(tool.p_WT[:, 2] - self._model.table_height, tool.sag)
        i = int(np.argmax(height))
        worst, time = float(height[i]), float(tool.times[i])
        if not worst <= self._height:
            found.fail(
                "pull",
                f"the {self._name} gripper holds cloth up to {1e3 * worst:.0f} mm above the "
                f"working table at {time:.3f} s, at most {1e3 * self._height:.0f} mm are allowed",
                time,
            )
        back = np.maximum.accumulate(along) - along
        i = int(np.argmax(back))
        worst, time = float(back[i]), float(tool.times[i])
        if not worst <= SLACK:
            found.fail(
                "slack",
                f"the {self._name} gripper has moved back along its pull by {1e3 * worst:.1f} mm "
                f"at {time:.3f} s, at most {1e3 * SLACK:.0f} mm are allowed",
                time,
            )
        found.check("slack", worst, SLACK, SLACK - worst, "m", f"{self._name} tip", time)

    def check_alone(self, tool: ToolMotion, found: Findings) -> None:
        """Check that an arm that pulls alone keeps within the length of the cloth to the other
        grasp point.
        """
        distance = np.linalg.norm(tool.p_WT - self._other.p_WG, axis=1)
        bound = _between(distance, tool.sag)
        i = int(np.argmax(bound))
        worst, time = float(bound[i]), float(tool.times[i])
        if not worst <= self._limit * (1.0 + TOLERANCE):
            found.fail(
                "stretch",
                f"the {self._name} gripper is {worst:.4f} m from the other hand's grasp point at "
                f"{time:.3f} s, {1e3 * (worst - self._limit):.1f} mm more than the "
                f"{self._limit:.4f} m that the cloth between them allows ({STRETCH_LIMIT} x its "
                "length)",
                time,
            )
        where = f"{self._name} tip to the other grasp point"
        found.check("stretch", worst, self._limit, self._limit - worst, "m", where, time)
