"""Postures of the tools and the turn-table at the edges of what is allowed."""

import dataclasses as dc

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from unwrinkle.models.arrays import Array
from unwrinkle.models.robot import Cell
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.verification.model import CellModel
from unwrinkle.planning.verification.postures import check_postures, tool_angles
from unwrinkle.planning.verification.tools import ToolLeg
from unwrinkle.planning.verification.verdict import Findings

from .built import TABLE, alone, found_by, kinds_of, leg, result, times_of, tool, tool_leg

ARMS = ("right", "left")
GRASPS = np.array([[0.24, -1.10, TABLE], [-0.24, -1.10, TABLE]])
UP = np.array([0.0, 0.0, 1.0])
TIMES = (2.5, 3.0, 3.5)
TURN = 1e-3
TILT = np.radians(45.0)
EDGE = 1e-7


def posture(tilt: float = TILT, heading: float = 0.0, roll: float = 0.0) -> Array:
    """A tool's rotation: approach axis z, y from the lower to the upper blade."""
    angles = [heading, 0.5 * np.pi + tilt, 0.5 * np.pi - roll]
    return np.array(Rotation.from_euler("ZYZ", angles).as_matrix())


def stated(plan: FlatteningPlan, arm: int) -> float:
    """Heading that the plan states, rad."""
    choice = plan.arms[arm]
    assert choice is not None
    x, y = plan.target.hands[choice.side].grasp_direction[:2]
    return float(np.arctan2(y, x)) + choice.offset


def working(
    plan: FlatteningPlan,
    arm: int,
    *changed: tuple[int, dict[str, float]],
    height: float = 0.0,
    held: bool = True,
    contact: tuple[float, float] | None = None,
    turntable: tuple[float, ...] = (0.0, 0.0, 0.0),
    Q2: float = 0.0,
) -> ToolLeg:
    """A tool at its grasp point in the stated posture, changed in some samples, (row, changes)."""
    choice = plan.arms[arm]
    assert choice is not None
    angles = [{"tilt": choice.tilt, "heading": 0.0, "roll": 0.0} for _ in TIMES]
    for row, changes in changed:
        angles[row].update(changes)
    R = np.stack([posture(a["tilt"], stated(plan, arm) + a["heading"], a["roll"]) for a in angles])
    places = np.tile(GRASPS[arm] + height * UP, (3, 1))
    own = tool(TIMES, places, R_WT=R, W2=TURN * 4.0 / 0.5**2, Q2=Q2)
    other = tool(TIMES, np.tile(GRASPS[1 - arm] + UP, (3, 1)))
    motions = (own, other) if arm == 0 else (other, own)
    like = leg(TIMES, {0: turntable}, name="pull", held=held, contact=contact)
    return tool_leg(*motions, like)


def check(plan: FlatteningPlan, cell: Cell, model: CellModel, *motion: ToolLeg) -> Findings:
    return found_by(check_postures, plan, cell, model, motion)


def with_tilt(plan: FlatteningPlan, arm: int, tilt: float, offset: float = 0.0) -> FlatteningPlan:
    arms = list(alone(plan, arm).arms)
    choice = arms[arm]
    assert choice is not None
    arms[arm] = dc.replace(choice, tilt=tilt, offset=offset)
    return dc.replace(plan, arms=(arms[0], arms[1]))


# Angles of a rotation.


def test_angles_are_those_of_the_rotation() -> None:
    rng = np.random.default_rng(1)
    for _ in range(200):
        tilt = rng.uniform(-0.45, 0.45) * np.pi
        heading, roll, away = rng.uniform(-3.1, 3.1, 3)
        claimed = np.array([np.cos(away), np.sin(away)])
        found = [a[0] for a in tool_angles(posture(tilt, away + heading, roll)[None], claimed)]
        again = posture(found[0], away + found[1], found[2])
        np.testing.assert_allclose(again, posture(tilt, away + heading, roll), atol=1e-9)
        if abs(heading) < 0.5 * np.pi or abs(roll) < 0.5 * np.pi:
            np.testing.assert_allclose(found, [tilt, heading, roll], atol=1e-9)
        else:  # tilted beyond the vertical, towards what is claimed
            assert abs(found[1]) <= 0.5 * np.pi and abs(found[2]) <= 0.5 * np.pi
            assert found[0] == pytest.approx(np.pi - tilt)


def test_a_tool_that_points_down_has_no_heading() -> None:
    claimed = np.array([0.6, 0.8])
    upright = np.arccos(0.05)
    for tilt, heading in ((upright + 1e-6, 0.0), (upright - 1e-6, 0.3)):
        R = posture(tilt, np.arctan2(0.8, 0.6) + 0.3)[None]
        found = tool_angles(R, claimed)
        assert found[0] == pytest.approx(tilt) and found[1] == pytest.approx(heading)
    down = tool_angles(posture(0.5 * np.pi, 0.0)[None], claimed)
    assert np.isfinite(np.concatenate(down)).all()


# Where postures count.


@pytest.mark.parametrize("arm", [0, 1])
class TestWhere:
    def off(self, plan: FlatteningPlan, arm: int, **where: object) -> ToolLeg:
        every = [(row, {"roll": 0.5}) for row in range(3)]
        return working(plan, arm, *every, **where)  # type: ignore[arg-type]

    def test_the_stated_posture_has_every_check(
        self, rest: FlatteningPlan, cell: Cell, model: CellModel, arm: int
    ) -> None:
        for offset in (0.0, 0.4, -0.4):
            plan = with_tilt(rest, arm, TILT, offset)
            found = check(plan, cell, model, working(plan, arm))
            assert found.violations == []
            names = {each.name for each in found.checks()}
            assert names == {"tilt", "heading", "roll", "turntable"}

    def test_while_holding_in_contact_and_near_the_table(
        self, rest: FlatteningPlan, cell: Cell, model: CellModel, arm: int
    ) -> None:
        plan, near = alone(rest, arm), cell.scenario.tools.near_table
        for where, counts in (
            ({"held": True, "height": 0.5}, True),
            ({"held": False, "height": 0.15 - EDGE, "contact": (2.5, 3.5)}, True),
            ({"held": False, "height": 0.15 + EDGE, "contact": (2.5, 3.5)}, False),
            ({"held": False, "height": 0.1, "contact": (2.6, 3.4)}, False),
            ({"held": False, "height": near + EDGE}, False),
            ({"held": False, "height": near - EDGE}, True),
            ({"held": False, "height": near + 2e-3 - EDGE, "Q2": 2e-3 * 8.0 / 0.5**2}, True),
            ({"held": False, "height": near + 2e-3 + EDGE, "Q2": 2e-3 * 8.0 / 0.5**2}, False),
        ):
            found = check(plan, cell, model, self.off(plan, arm, **where))
            assert kinds_of(found) == ({"roll"} if counts else set()), where
            assert bool(found.checks()) == counts

    def test_an_arm_without_work_has_no_posture(
        self, rest: FlatteningPlan, cell: Cell, model: CellModel, arm: int
    ) -> None:
        motion = self.off(alone(rest, arm), arm)
        idle = dc.replace(rest, arms=(None, None))
        assert check(idle, cell, model, motion).checks() == ()
        wrong = dc.replace(rest.arms[1 - arm], side=-1)
        arms = (rest.arms[0], wrong) if arm == 0 else (wrong, rest.arms[1])
        both = check(dc.replace(rest, arms=arms), cell, model, motion, motion)
        assert [each.kind for each in both.violations] == ["roll", "roll"]


# Edges.


@pytest.mark.parametrize("arm", [0, 1])
class TestEdges:
    def expect(
        self, found: Findings, kind: str, broken: bool, off: float, arm: int, time: float
    ) -> None:
        assert kinds_of(found) == ({kind} if broken else set())
        assert times_of(found, kind) == ([time] if broken else [])
        check_ = result(found, kind)
        assert check_.value == pytest.approx(off, abs=1e-9)
        assert (check_.limit, check_.unit) == (0.02, "rad")
        assert check_.margin == pytest.approx(0.02 - off, abs=1e-9)
        assert (check_.where, check_.time) == (f"{ARMS[arm]} tool", time)

    @pytest.mark.parametrize(("row", "time"), [(0, 2.5), (2, 3.0)])
    def test_roll_and_heading(
        self, rest: FlatteningPlan, cell: Cell, model: CellModel, arm: int, row: int, time: float
    ) -> None:
        plan = alone(rest, arm)
        for sign in (1.0, -1.0):
            for off, broken in ((0.02 - EDGE, False), (0.02 + EDGE, True)):
                roll = working(plan, arm, (row, {"roll": sign * (off - 3.0 * TURN)}))
                self.expect(check(plan, cell, model, roll), "roll", broken, off, arm, time)
                heading = sign * (off - TURN) / np.cos(TILT)
                turned = working(plan, arm, (row, {"heading": heading}))
                self.expect(check(plan, cell, model, turned), "heading", broken, off, arm, time)

    def test_the_tilt_is_the_stated_one(
        self, rest: FlatteningPlan, cell: Cell, model: CellModel, arm: int
    ) -> None:
        plan = alone(rest, arm)
        for sign in (1.0, -1.0):
            for off, broken in ((0.02 - EDGE, False), (0.02 + EDGE, True)):
                motion = working(plan, arm, (1, {"tilt": TILT + sign * (off - TURN)}))
                found = check(plan, cell, model, motion)
                assert times_of(found, "tilt") == ([2.5] if broken else [])

    @pytest.mark.parametrize("side", ["lower", "upper"])
    def test_the_tilt_stays_in_the_grippers_window(
        self, rest: FlatteningPlan, cell: Cell, model: CellModel, arm: int, side: str
    ) -> None:
        window = cell.scenario.gripper
        bound, out = (window.tilt_lower, -1.0) if side == "lower" else (window.tilt_upper, 1.0)
        for over, broken in ((5e-3 - EDGE, False), (5e-3 + EDGE, True)):
            plan = with_tilt(rest, arm, bound)
            motion = working(plan, arm, (2, {"tilt": bound + out * (over - TURN)}))
            found = check(plan, cell, model, motion)
            assert times_of(found, "tilt") == ([3.0] if broken else [])
            check_ = result(found, "tilt")
            assert check_.value == pytest.approx(bound + out * over, abs=1e-9)
            assert check_.limit == pytest.approx(bound + out * 5e-3)
            assert check_.margin == pytest.approx(5e-3 - over, abs=1e-9)
            assert check_.unit == "rad"
            assert (check_.where, check_.time) == (f"{ARMS[arm]} tool", 3.0)

    def test_a_heading_counts_less_near_the_vertical(
        self, rest: FlatteningPlan, cell: Cell, model: CellModel, arm: int
    ) -> None:
        steep = min(np.radians(80.0), cell.scenario.gripper.tilt_upper)
        plan = with_tilt(rest, arm, steep)
        for off, broken in ((0.02 - EDGE, False), (0.02 + EDGE, True)):
            heading = (off - TURN) / np.cos(steep)
            motion = working(plan, arm, *((row, {"heading": heading}) for row in range(3)))
            assert kinds_of(check(plan, cell, model, motion)) == ({"heading"} if broken else set())


# Turn-table.


def test_the_turntable_stands_at_the_stated_angle(
    rest: FlatteningPlan, cell: Cell, model: CellModel
) -> None:
    plan = dc.replace(alone(rest, 0), turntable=0.3)
    for sign in (1.0, -1.0):
        for off, broken in ((1e-3 - 1e-9, False), (1e-3 + 1e-9, True)):
            motion = working(plan, 0, turntable=(0.3, 0.3 + sign * off, 0.3))
            found = check(plan, cell, model, motion, motion)
            # The cubic through samples at rest does not leave their range.
            assert times_of(found, "turntable") == ([2.5] if broken else [])
            check_ = result(found, "turntable")
            assert check_.value == pytest.approx(off, abs=1e-12)
            assert (check_.limit, check_.unit, check_.where) == (1e-3, "rad", "pull")
            assert check_.margin == pytest.approx(1e-3 - off, abs=1e-12)
            assert check_.time == 2.5


def test_a_fixed_turntable_does_not_move(
    rest: FlatteningPlan, cell: Cell, model: CellModel
) -> None:
    """In any segment, with or without work."""
    planner = dc.replace(cell.scenario.planner, turntable="fixed")
    fixed = dc.replace(cell, scenario=dc.replace(cell.scenario, planner=planner))
    plan = alone(rest, 0)
    for moved, broken in ((1e-6 - 1e-9, False), (1e-6 + 1e-9, True)):
        motion = working(plan, 0, height=0.5, held=False, turntable=(0.0, 0.5 * moved, moved))
        assert check(plan, cell, model, motion).violations == []
        found = check(plan, fixed, model, motion, motion)
        assert times_of(found, "turntable") == ([2.5, 2.5] if broken else [])
