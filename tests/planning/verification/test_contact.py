"""Contact windows, named poses, and open fingers near the table, at the edges of the allowed."""

import dataclasses as dc
from collections.abc import Sequence

import numpy as np
import pytest

from unwrinkle.models.arrays import Array
from unwrinkle.models.robot import Cell
from unwrinkle.planning.plan import FlatteningPlan, PoseMark
from unwrinkle.planning.verification.contact import check_contact
from unwrinkle.planning.verification.model import CellModel
from unwrinkle.planning.verification.tools import ToolLeg
from unwrinkle.planning.verification.verdict import Findings

from .built import TABLE, alone, found_by, kinds_of, leg, result, times_of, tool, tool_leg

ARMS = ("right", "left")
GRASPS = np.array([[0.24, -1.10, TABLE], [-0.24, -1.10, TABLE]])
OUTWARDS = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
SIDEWAYS = np.array([0.0, 1.0, 0.0])
UP = np.array([0.0, 0.0, 1.0])
REACH = 0.150
EDGE = 1e-7
#: The samples of an approach: its begin, and the poses "plan", "touch-table" and "grasp".
TIMES = (0.0, 1.0, 1.5, 2.0)
HEIGHTS = (0.5, 0.1, 0.0, 0.0)


def approach(
    arm: int,
    heights: Sequence[float] = HEIGHTS,
    *,
    off: Array | None = None,
    velocity: Array | None = None,
    held: bool = False,
    contact: tuple[float, float] | None = (1.0, 2.0),
    **bounds: float,
) -> ToolLeg:
    """An arm's tool above its grasp point; the other one stands high above the table."""
    places = GRASPS[arm] + np.outer(heights, UP) + (0.0 if off is None else off)
    own = tool(TIMES, places, velocity=velocity, **bounds)
    other = tool(TIMES, np.tile(GRASPS[1 - arm] + UP, (4, 1)))
    motions = (own, other) if arm == 0 else (other, own)
    return tool_leg(*motions, leg(TIMES, name="approach", held=held, contact=contact))


def shifted(row: int, by: Array) -> Array:
    off = np.zeros((4, 3))
    off[row] = by
    return off


def check(plan: FlatteningPlan, cell: Cell, model: CellModel, *motion: ToolLeg) -> Findings:
    return found_by(check_contact, plan, cell, model, motion)


def poses(plan: FlatteningPlan, /, **times: float) -> FlatteningPlan:
    """The plan whose approach has these poses."""
    marks = tuple(PoseMark(name.replace("_", "-"), time) for name, time in times.items())
    first = dc.replace(plan.segments[0], poses=marks)
    return dc.replace(plan, segments=(first, *plan.segments[1:]))


@pytest.mark.parametrize("arm", [0, 1])
class TestWindow:
    def test_a_tool_is_at_its_place(
        self, rest: FlatteningPlan, cell: Cell, model: CellModel, arm: int
    ) -> None:
        """Beside the line of its pull, before its begin, beyond its end, and above the table."""
        sag, bare = 2e-3, poses(alone(rest, arm))
        pull = rest.target.hands[arm].pull_distance * OUTWARDS[arm]
        for base, direction in (
            (0.0 * UP, SIDEWAYS),
            (0.0 * UP, -OUTWARDS[arm]),
            (0.5 * pull, -SIDEWAYS),
            (pull, OUTWARDS[arm]),
            (0.0 * UP, UP),
        ):
            for far, broken in ((REACH - EDGE, False), (REACH + EDGE, True)):
                off = shifted(2, base + (far - sag) * direction)
                motion = approach(arm, (0.5, 0.0, 0.0, 0.0), off=off, Q2=sag * 8.0 / 0.5**2)
                # The step before the window is longer, and the tool sags more.
                found = check(bare, cell, model, motion)
                assert kinds_of(found) - {"sliding", "sinking"} == (
                    {"contact"} if broken else set()
                )
                # Both steps that end there are in the window; the first is told.
                assert times_of(found, "contact") == ([1.0] if broken else [])
                check_ = result(found, "contact")
                assert (check_.value, check_.limit) == (pytest.approx(far, abs=1e-10), REACH)
                assert check_.margin == pytest.approx(REACH - far, abs=1e-10)
                assert (check_.unit, check_.where) == ("m", f"{ARMS[arm]} tool")
                assert check_.time == 1.0

    def test_what_is_outside_the_window_does_not_count(
        self, rest: FlatteningPlan, cell: Cell, model: CellModel, arm: int
    ) -> None:
        bare = poses(alone(rest, arm))
        far = shifted(1, 0.3 * SIDEWAYS)
        assert kinds_of(check(bare, cell, model, approach(arm, off=far))) == {"contact"}
        for contact in ((1.2, 2.0), (1.5, 2.0), None):
            motion = approach(arm, off=far, contact=contact)
            assert check(bare, cell, model, motion).violations == []
        found = check(bare, cell, model, approach(arm, off=far, contact=None))
        assert "contact" not in {each.name for each in found.checks()}


@pytest.mark.parametrize("arm", [0, 1])
class TestPoses:
    def test_the_poses_of_an_approach(
        self, rest: FlatteningPlan, cell: Cell, model: CellModel, arm: int
    ) -> None:
        assert check(alone(rest, arm), cell, model, approach(arm)).violations == []

    @pytest.mark.parametrize(
        ("row", "inside", "outside"),
        [
            (1, 0.010 + EDGE, 0.010 - EDGE),  # clear of the table where the contact begins
            (2, 0.020 - EDGE, 0.020 + EDGE),  # down where the table is touched
            (1, REACH - EDGE, REACH + EDGE),
        ],
    )
    def test_heights(
        self,
        rest: FlatteningPlan,
        cell: Cell,
        model: CellModel,
        arm: int,
        row: int,
        inside: float,
        outside: float,
    ) -> None:
        plan = alone(rest, arm)
        for height, broken in ((inside, False), (outside, True)):
            heights = [height if i == row else z for i, z in enumerate(HEIGHTS)]
            motion = approach(arm, heights, contact=None)
            found = check(plan, cell, model, motion)
            assert kinds_of(found) == ({"contact"} if broken else set())
            assert times_of(found, "contact") == ([TIMES[row]] if broken else [])

    def test_poses_are_passed_within_reach(
        self, rest: FlatteningPlan, cell: Cell, model: CellModel, arm: int
    ) -> None:
        """All but the pose "pull", wherever they are in the segment."""
        for name, heights in (
            ("plan", (0.1, 0.1, 0.1, 0.1)),
            ("leave-table", (0.1, 0.1, 0.1, 0.1)),
            ("touch-table", (0.0, 0.0, 0.0, 0.0)),
            ("free-garment", (0.0, 0.0, 0.0, 0.0)),
            ("grasp", (0.0, 0.0, 0.0, 0.0)),
            ("put-on-table", (0.0, 0.0, 0.0, 0.0)),
            ("pull", (0.0, 0.0, 0.0, 0.0)),
        ):
            for row in (1, 3):
                plan = poses(alone(rest, arm), **{name.replace("-", "_"): TIMES[row] + 0.1})
                for far, broken in ((REACH - EDGE, False), (REACH + EDGE, name != "pull")):
                    off = np.tile(far * SIDEWAYS, (4, 1))
                    motion = approach(arm, heights, off=off, contact=None)
                    found = check(plan, cell, model, motion)
                    expected = [TIMES[row] + 0.1] if broken else []
                    assert times_of(found, "contact") == pytest.approx(expected)

    @pytest.mark.parametrize("name", ["grasp", "put_on_table"])
    def test_grippers_change_where_the_segment_ends(
        self, rest: FlatteningPlan, cell: Cell, model: CellModel, arm: int, name: str
    ) -> None:
        plan = poses(alone(rest, arm), **{name: 1.5})
        direction = np.array([2.0, -1.0, 2.0]) / 3.0
        for far, broken in ((1e-3 - EDGE, False), (1e-3 + EDGE, True)):
            motion = approach(arm, off=shifted(2, far * direction), contact=None)
            found = check(plan, cell, model, motion)
            assert times_of(found, "contact") == ([1.5] if broken else [])

    def test_an_arm_is_told_by_its_name(
        self, rest: FlatteningPlan, cell: Cell, model: CellModel, arm: int
    ) -> None:
        found = check(alone(rest, arm), cell, model, approach(arm, (0.5, 0.5, 0.0, 0.0)))
        assert found.violations and all(ARMS[arm] in each.message for each in found.violations)


@pytest.mark.parametrize("arm", [0, 1])
class TestSpeeds:
    def test_open_fingers_near_the_table_keep_their_speed(
        self, rest: FlatteningPlan, cell: Cell, model: CellModel, arm: int
    ) -> None:
        """Sideways and down, with what they gain between samples; upwards they may be faster."""
        surge, bare = 0.01, poses(alone(rest, arm))
        settings = cell.scenario.tools
        for kind, direction, limit in (
            ("sliding", np.array([0.6, -0.8, 0.0]), settings.sliding_speed),
            ("sinking", -UP, settings.sinking_speed),
        ):
            for row, time in ((2, 1.0), (3, 1.5)):
                for speed, broken in ((limit - EDGE, False), (limit + EDGE, True)):
                    velocity = shifted(row, (speed - surge) * direction)
                    motion = approach(arm, velocity=velocity, P3=surge * 8.0 / 0.5**2)
                    found = check(bare, cell, model, motion)
                    assert kinds_of(found) == ({kind} if broken else set())
                    assert times_of(found, kind) == ([time] if broken else [])
                    check_ = result(found, kind)
                    assert check_.value == pytest.approx(speed, abs=1e-10)
                    assert (check_.limit, check_.unit) == (limit, "m/s")
                    assert check_.margin == pytest.approx(limit - speed, abs=1e-10)
                    assert (check_.where, check_.time) == (f"{ARMS[arm]} tool", time)
        rising = approach(arm, velocity=shifted(3, 2.0 * settings.sinking_speed * UP))
        assert check(bare, cell, model, rising).violations == []

    def test_speeds_count_near_the_table_and_with_open_grippers(
        self, rest: FlatteningPlan, cell: Cell, model: CellModel, arm: int
    ) -> None:
        bare, near = poses(alone(rest, arm)), cell.scenario.tools.near_table
        sag = 2e-3
        fast = np.tile([1.0, 0.0, -1.0], (4, 1))
        for height, broken in ((near + sag + EDGE, False), (near + sag - EDGE, True)):
            heights = (0.5, 0.5, height, height)
            motion = approach(arm, heights, velocity=fast, contact=None, Q2=sag * 8.0 / 0.5**2)
            found = check(bare, cell, model, motion)
            assert kinds_of(found) == ({"sliding", "sinking"} if broken else set())
            names = {each.name for each in found.checks()}
            assert ("sliding" in names) == ("sinking" in names) == broken
        held = approach(arm, velocity=fast, held=True, contact=None)
        assert check(bare, cell, model, held).violations == []

    def test_arms_without_a_part_keep_their_speed_too(
        self, rest: FlatteningPlan, cell: Cell, model: CellModel, arm: int
    ) -> None:
        """And an arm with work is checked whatever the other one is."""
        fast = np.tile([1.0, 0.0, 0.0], (4, 1))
        motion = approach(arm, velocity=fast)
        idle = poses(alone(rest, 1 - arm))
        assert "sliding" in kinds_of(check(idle, cell, model, motion))
        far = approach(arm, off=shifted(2, 0.3 * SIDEWAYS))
        assert "contact" in kinds_of(check(alone(rest, arm), cell, model, far))
        wrong = dc.replace(rest.arms[1 - arm], side=2)
        arms = (rest.arms[0], wrong) if arm == 0 else (wrong, rest.arms[1])
        assert "contact" in kinds_of(check(dc.replace(rest, arms=arms), cell, model, far))


def test_a_leg_that_is_no_segment_has_its_window_and_speeds(
    rest: FlatteningPlan, cell: Cell, model: CellModel
) -> None:
    """Its poses are those of no segment; the legs after it are checked too."""
    places = np.tile(GRASPS[0] + 0.3 * SIDEWAYS, (4, 1))
    high = np.tile(GRASPS[1] + UP, (4, 1))
    fast = np.tile([1.0, 0.0, 0.0], (4, 1))
    stroke = leg(TIMES, name="grippers", contact=(1.0, 2.0))
    other = tool_leg(tool(TIMES, places, velocity=fast), tool(TIMES, high), stroke)
    found = check(alone(rest, 0), cell, model, other)
    assert kinds_of(found) == {"contact", "sliding"}
    assert times_of(found, "contact") == [1.0]
    both = check(alone(rest, 0), cell, model, other, approach(0, (0.5, 0.0, 0.0, 0.0)))
    assert times_of(both, "contact") == [1.0, 1.0]  # the window of the one, a pose of the other
