"""The hands' work on the cloth at the edges of what is allowed, in motions of straight lines."""

import dataclasses as dc
from collections.abc import Sequence

import numpy as np
import pytest

from unwrinkle.models.arrays import Array
from unwrinkle.models.robot import Cell
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.verification import hands
from unwrinkle.planning.verification.hands import check_hands
from unwrinkle.planning.verification.model import CellModel
from unwrinkle.planning.verification.tools import ToolLeg, ToolMotion
from unwrinkle.planning.verification.verdict import Findings

from .built import TABLE, alone, found_by, kinds_of, leg, result, times_of, tool, tool_leg

TIMES = (2.5, 3.0, 3.5)
STILL = np.tile([0.3, -1.0, TABLE], (3, 1))
#: Grasp points of the target and the directions of their pulls.
GRASPS = np.array([[0.24, -1.10, TABLE], [-0.24, -1.10, TABLE]])
OUTWARDS = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
SIDEWAYS = np.array([0.0, 1.0, 0.0])
UP = np.array([0.0, 0.0, 1.0])
PULL = 0.03
ARMS = ("right", "left")
EDGE = 1e-7


def pulling(arm: int, way: Sequence[float] = (0.0, 0.5 * PULL, PULL)) -> Array:
    """Places (n, 3) of an arm's tool at distances along its pull."""
    return np.array(GRASPS[arm] + np.outer(way, OUTWARDS[arm]))


def pair(arm: int, own: ToolMotion, name: str, *, held: bool = True) -> ToolLeg:
    """A leg of one tool, the other one where its pull begins or passes."""
    other = tool(own.times, pulling(1 - arm, np.linspace(0.0, PULL, len(own.times))))
    motions = (own, other) if arm == 0 else (other, own)
    return tool_leg(*motions, leg(own.times, name=name, held=held))


def carried(right: ToolMotion, left: ToolMotion) -> ToolLeg:
    """A leg that is no segment of the plan, in which cloth is held."""
    return tool_leg(right, left, leg(right.times, name="carry", held=True))


def expect(
    found: Findings, kind: str, broken: bool, value: float, limit: float, where: str, time: float
) -> None:
    """One check of that value, and violations of that kind alone."""
    assert kinds_of(found) == ({kind} if broken else set())
    assert times_of(found, kind) == ([time] if broken else [])
    check = result(found, kind)
    assert check.passed != broken
    assert check.value == pytest.approx(value, abs=1e-10)
    assert check.limit == pytest.approx(limit, abs=1e-10)
    assert check.margin == pytest.approx(limit - value, abs=1e-10)
    assert (check.unit, check.where, check.time) == (
        "m/s" if kind == "tip_speed" else "m",
        where,
        time,
    )


def test_a_straight_pull_has_every_check(
    rest: FlatteningPlan, cell: Cell, model: CellModel
) -> None:
    both = [tool(TIMES, pulling(arm)) for arm in (0, 1)]
    ends = [tool(TIMES, pulling(arm, (-0.1, -0.05, 0.0))) for arm in (0, 1)]
    legs = [
        tool_leg(*ends, leg(TIMES, name="approach")),
        tool_leg(*both, leg(TIMES, name="pull", held=True)),
    ]
    found = found_by(check_hands, rest, cell, model, legs)
    assert found.violations == []
    names = {check.name for check in found.checks()}
    assert names == {"table", "tip_speed", "stretch", "slack", "grasp", "pull", "put_down"}


# Speed while holding.


@pytest.mark.parametrize("arm", [0, 1])
@pytest.mark.parametrize(("row", "time"), [(0, 2.5), (2, 3.0)])
def test_a_tip_that_holds_keeps_its_speed(
    rest: FlatteningPlan, cell: Cell, model: CellModel, arm: int, row: int, time: float
) -> None:
    """The norm of its velocity, and what it may gain between samples."""
    limit = cell.limits.tip_speed_holding
    surge = 0.05
    for factor, broken in ((1.0, False), (1.0 + 0.5e-9, False), (1.0 + 3e-9, True), (1.5, True)):
        velocity = np.zeros((3, 3))
        velocity[row] = (limit * factor - surge) * np.array([2.0, -1.0, 2.0]) / 3.0
        own = tool(TIMES, STILL, velocity=velocity, P3=surge * 8.0 / 0.5**2)
        other = tool(TIMES, STILL)
        legs = [carried(*((own, other) if arm == 0 else (other, own)))]
        found = found_by(check_hands, alone(rest, arm), cell, model, legs)
        expect(found, "tip_speed", broken, factor * limit, limit, f"{ARMS[arm]} tip", time)


def test_speeds_count_while_a_gripper_is_closed(
    rest: FlatteningPlan, cell: Cell, model: CellModel
) -> None:
    fast = tool(TIMES, STILL, velocity=np.ones((3, 3)))
    still = tool(TIMES, STILL)
    free = tool_leg(fast, fast, leg(TIMES, name="carry"))
    assert found_by(check_hands, rest, cell, model, [free]).checks() == ()
    for motions in ((fast, still), (still, fast)):
        held = [carried(*motions)] * 2
        found = found_by(check_hands, rest, cell, model, held)
        assert [each.kind for each in found.violations] == ["tip_speed"] * 2


# Stretch and slack of the cloth between two hands.


@pytest.mark.parametrize("arm", [0, 1])
def test_two_hands_keep_within_the_length_of_the_cloth(
    rest: FlatteningPlan, cell: Cell, model: CellModel, arm: int
) -> None:
    """1.1 times the cloth's length; accelerations of both tools may take them further apart."""
    limit = 1.1 * rest.target.geodesic_distance
    bounds = (2.0, 3.0)
    more = 0.125 * 0.5**2 * sum(bounds)
    direction = np.array([2.0, -1.0, 2.0]) / 3.0
    for factor, broken in ((1.0 + 0.5e-9, False), (1.0 + 3e-9, True), (1.2, True)):
        apart = np.array([0.1, 0.2, limit * factor - more])
        places = STILL + np.outer(apart, direction)
        own, other = tool(TIMES, places, P2=bounds[0]), tool(TIMES, STILL, P2=bounds[1])
        legs = [carried(*((own, other) if arm == 0 else (other, own)))]
        found = found_by(check_hands, rest, cell, model, legs)
        expect(found, "stretch", broken, factor * limit, limit, "between the grippers", 3.0)
        assert (result(found, "slack").value, result(found, "slack").margin) == (0.0, 5e-3)
        # One arm alone stretches nothing between two grippers.
        assert "stretch" not in kinds_of(found_by(check_hands, alone(rest, arm), cell, model, legs))


def test_two_hands_that_hold_do_not_come_nearer(
    rest: FlatteningPlan, cell: Cell, model: CellModel
) -> None:
    """Against the greatest distance before, wherever it was."""
    direction = np.array([2.0, -1.0, 2.0]) / 3.0
    times = (2.5, 2.7, 2.9, 3.5)
    for back, broken in ((5e-3 - EDGE, False), (5e-3 + EDGE, True), (0.1, True)):
        apart = np.array([0.4, 0.5, 0.5 - back, 0.5 - 0.5 * back])
        places = STILL[0] + np.outer(apart, direction)
        legs = [carried(tool(times, places), tool(times, np.tile(STILL[0], (4, 1))))]
        found = found_by(check_hands, rest, cell, model, legs)
        expect(found, "slack", broken, back, 5e-3, "between the grippers", 2.9)


def test_a_limit_itself_is_allowed(
    rest: FlatteningPlan, cell: Cell, model: CellModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In numbers without rounding."""
    monkeypatch.setattr(hands, "SLACK", 2.0**-7)
    for further, broken in ((0.0, False), (2.0**-30, True)):
        places = np.outer([0.5, 0.5 - 2.0**-7 - further, 0.5], [1.0, 0.0, 0.0])
        legs = [carried(tool(TIMES, places), tool(TIMES, np.zeros((3, 3))))]
        found = found_by(check_hands, rest, cell, model, legs)
        assert kinds_of(found) == ({"slack"} if broken else set())


# Places of grasp and put-down.


@pytest.mark.parametrize("arm", [0, 1])
@pytest.mark.parametrize(
    ("name", "kind", "end"), [("approach", "grasp", 0.0), ("pull", "put_down", PULL)]
)
class TestPlaces:
    def at(self, arm: int, name: str, end: float, off: Array) -> list[ToolLeg]:
        way = (0.0, 0.5 * PULL, PULL) if end else (-0.2, -0.1, 0.0)
        places = pulling(arm, way)
        places[-1] += off
        return [pair(arm, tool(TIMES, places), name, held=name == "pull")]

    @pytest.mark.parametrize("angle", [0.3, 2.0, 4.0])
    def test_within_five_millimetres(
        self,
        rest: FlatteningPlan,
        cell: Cell,
        model: CellModel,
        arm: int,
        name: str,
        kind: str,
        end: float,
        angle: float,
    ) -> None:
        for far, broken in ((5e-3 - EDGE, False), (5e-3 + EDGE, True)):
            off = far * np.array([np.cos(angle), np.sin(angle), 0.0])
            legs = self.at(arm, name, end, off)
            found = found_by(check_hands, alone(rest, arm), cell, model, legs)
            expect(found, kind, broken, far, 5e-3, f"{ARMS[arm]} tip", 3.5)

    def test_height_above_the_table(
        self,
        rest: FlatteningPlan,
        cell: Cell,
        model: CellModel,
        arm: int,
        name: str,
        kind: str,
        end: float,
    ) -> None:
        inside, outside = (-1e-4 + EDGE, 8e-3 - EDGE), (-1e-4 - EDGE, 8e-3 + EDGE)
        for height, broken in [(z, False) for z in inside] + [(z, True) for z in outside]:
            legs = self.at(arm, name, end, height * UP)
            found = found_by(check_hands, alone(rest, arm), cell, model, legs)
            expect(found, kind, broken, 0.0, 5e-3, f"{ARMS[arm]} tip", 3.5)

    def test_on_the_table(
        self,
        rest: FlatteningPlan,
        cell: Cell,
        model: CellModel,
        arm: int,
        name: str,
        kind: str,
        end: float,
    ) -> None:
        """Grasp and put-down points on it, the tip no more than its tolerance beyond."""
        edge = -1.2 + 0.4  # of the table, towards +y
        other = alone(rest, arm)
        hand = rest.target.hands[arm]
        for beyond, tip, broken in (
            (-EDGE, 0.0, 0),
            (EDGE, 0.0, 1),
            (-1e-3, 4e-3 - EDGE, 0),
            (-1e-6, 2e-6, 0),
            (5e-4, 4.5e-3 + EDGE, 2),
        ):
            shift = np.array([0.0, edge - hand.p_WG[1] + beyond, 0.0])
            moved = dc.replace(hand, p_WG=hand.p_WG + shift)
            both = (moved, rest.target.hands[1]) if arm == 0 else (rest.target.hands[0], moved)
            plan = dc.replace(
                other, target=dc.replace(rest.target, hands=both, geodesic_distance=1.0)
            )
            way = (0.0, 0.5 * PULL, PULL) if end else (-0.2, -0.1, 0.0)
            places = pulling(arm, way) + shift
            places[-1] += tip * SIDEWAYS
            legs = [pair(arm, tool(TIMES, places), name, held=name == "pull")]
            found = found_by(check_hands, plan, cell, model, legs)
            assert times_of(found, "table") == [3.5] * broken
            assert kinds_of(found) == ({"table"} if broken else set())
            check = result(found, "table")
            margins = [-beyond, 5e-3 - beyond - tip]
            assert check.margin == pytest.approx(min(margins), abs=1e-10)
            assert check.limit == pytest.approx([0.0, 5e-3][int(np.argmin(margins))])
            assert check.value == pytest.approx(check.limit - check.margin, abs=1e-10)
            assert (check.unit, check.where) == ("m", f"{ARMS[arm]} gripper")
            assert check.time == 3.5


def test_an_arm_puts_down_at_its_share_of_the_pull(
    rest: FlatteningPlan, cell: Cell, model: CellModel
) -> None:
    """And serves the hand that the plan says."""
    for arm, side, share in ((0, 0, 2.0), (1, 0, 0.5), (0, 1, 0.0)):
        choice = dc.replace(rest.arms[0], side=side, share=share)
        arms = (choice, None) if arm == 0 else (None, choice)
        plan = dc.replace(rest, arms=arms)
        good = pulling(side, np.array([0.0, 0.5, 1.0]) * share * PULL)
        for way, expected in ((good, set()), (good + 0.01 * OUTWARDS[side], {"put_down", "pull"})):
            legs = [pair(arm, tool(TIMES, way), "pull")]
            assert kinds_of(found_by(check_hands, plan, cell, model, legs)) == expected
        beside = [pair(arm, tool(TIMES, pulling(1 - side)), "approach", held=False)]
        found = found_by(check_hands, plan, cell, model, beside)
        assert kinds_of(found) == {"grasp"}


# The way of the pull.


@pytest.mark.parametrize("arm", [0, 1])
def test_a_hand_stays_on_the_line_of_its_pull(
    rest: FlatteningPlan, cell: Cell, model: CellModel, arm: int
) -> None:
    """6 mm in any direction but up, its ends included; as far as it may go between samples."""
    sag = 1e-3
    for row, off, time in (
        (0, -OUTWARDS[arm], 2.5),
        (1, SIDEWAYS, 2.5),
        (2, -SIDEWAYS, 3.0),
        (2, OUTWARDS[arm], 3.0),
    ):
        for far, broken in ((6e-3 - EDGE, False), (6e-3 + EDGE, True)):
            places = pulling(arm)
            places[row] += (far - sag) * off
            own = tool(TIMES, places, Q2=sag * 8.0 / 0.5**2)
            found = found_by(check_hands, alone(rest, arm), cell, model, [pair(arm, own, "pull")])
            assert kinds_of(found) - {"put_down"} == ({"pull"} if broken else set())
            assert times_of(found, "pull") == ([time] if broken else [])
            check = result(found, "pull")
            assert (check.value, check.limit) == (pytest.approx(far, abs=1e-10), 6e-3)
            assert check.margin == pytest.approx(6e-3 - far, abs=1e-10)
            assert (check.unit, check.where, check.time) == ("m", f"{ARMS[arm]} tip", time)


@pytest.mark.parametrize("arm", [0, 1])
def test_a_hand_that_pulls_stays_low(
    rest: FlatteningPlan, cell: Cell, model: CellModel, arm: int
) -> None:
    limit, sag = cell.scenario.tools.holding_height, 1e-3
    for height, broken in ((limit - EDGE, False), (limit + EDGE, True)):
        places = pulling(arm)
        places[1] += (height - sag) * UP
        own = tool(TIMES, places, Q2=sag * 8.0 / 0.5**2)
        found = found_by(check_hands, alone(rest, arm), cell, model, [pair(arm, own, "pull")])
        assert kinds_of(found) == ({"pull"} if broken else set())
        assert times_of(found, "pull") == ([2.5] if broken else [])


@pytest.mark.parametrize("arm", [0, 1])
def test_a_hand_does_not_go_back(
    rest: FlatteningPlan, cell: Cell, model: CellModel, arm: int
) -> None:
    times = (2.5, 2.7, 2.9, 3.5)
    for back, broken in ((5e-3 - EDGE, False), (5e-3 + EDGE, True), (0.015, True)):
        own = tool(times, pulling(arm, (0.0, 0.02, 0.02 - back, PULL)))
        found = found_by(check_hands, alone(rest, arm), cell, model, [pair(arm, own, "pull")])
        expect(found, "slack", broken, back, 5e-3, f"{ARMS[arm]} tip", 2.9)
        free = [pair(arm, own, "release")]
        assert "slack" not in {
            check.name
            for check in found_by(check_hands, alone(rest, arm), cell, model, free).checks()
        }


@pytest.mark.parametrize("arm", [0, 1])
def test_one_hand_keeps_within_the_length_of_the_cloth(
    rest: FlatteningPlan, cell: Cell, model: CellModel, arm: int
) -> None:
    """Against the other hand's grasp point, where nothing holds the cloth."""
    limit, sag = 1.1 * rest.target.geodesic_distance, 1e-3
    choice = dc.replace(rest.arms[arm], share=4.0)
    plan = dc.replace(rest, arms=(choice, None) if arm == 0 else (None, choice))
    for factor, broken in ((1.0 + 0.5e-9, False), (1.0 + 4e-9, True), (1.05, True)):
        far = factor * limit - 0.48 - sag
        own = tool(TIMES, pulling(arm, (0.0, 0.5 * far, far)), Q2=sag * 8.0 / 0.5**2)
        found = found_by(check_hands, plan, cell, model, [pair(arm, own, "pull")])
        assert kinds_of(found) - {"put_down", "pull"} == ({"stretch"} if broken else set())
        assert times_of(found, "stretch") == ([3.0] if broken else [])
        check = result(found, "stretch")
        assert (check.value, check.limit) == (pytest.approx(factor * limit), pytest.approx(limit))
        assert check.margin == pytest.approx(limit * (1.0 - factor), abs=1e-10)
        assert (check.unit, check.time) == ("m", 3.0)
        assert check.where == f"{ARMS[arm]} tip to the other grasp point"


def test_an_arm_without_a_hand_has_no_work(
    rest: FlatteningPlan, cell: Cell, model: CellModel
) -> None:
    """A side that is none is a violation of the structure."""
    wild = tool(TIMES, STILL)
    legs = [tool_leg(wild, wild, leg(TIMES, name=name)) for name in ("approach", "pull")]
    for arms in ((None, None), (dc.replace(rest.arms[0], side=2), None)):
        plan = dc.replace(rest, arms=arms)
        assert found_by(check_hands, plan, cell, model, legs).checks() == ()
    # The first has none, the second is checked all the same.
    for arms in ((None, rest.arms[1]), (dc.replace(rest.arms[0], side=-1), rest.arms[1])):
        found = found_by(check_hands, dc.replace(rest, arms=arms), cell, model, legs)
        assert {"grasp", "put_down", "pull"} <= kinds_of(found)
