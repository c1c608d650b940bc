"""Structure of a plan at the edges of its tolerances: just inside passes, just outside fails."""

import dataclasses as dc
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from unwrinkle.models.robot import Cell
from unwrinkle.planning.plan import FlatteningPlan, GripperEvent, PoseMark
from unwrinkle.planning.trajectory import Trajectory
from unwrinkle.planning.verification import structure
from unwrinkle.planning.verification.structure import (
    GREATEST,
    GREATEST_OFFSET,
    MOST_PARTS,
    check_choice,
    check_grippers,
    check_identity,
    check_numbers,
    check_rest,
    check_sent,
    check_speed,
    check_structure,
)
from unwrinkle.planning.verification.verdict import Findings

from .built import AXES, found_by, kinds_of, result, times_of

HOME = np.zeros(AXES)


def segment(plan: FlatteningPlan, index: int, **changes: Any) -> FlatteningPlan:
    segments = list(plan.segments)
    segments[index] = dc.replace(segments[index], **changes)
    return dc.replace(plan, segments=tuple(segments))


def samples(plan: FlatteningPlan, index: int, **changes: Any) -> FlatteningPlan:
    return segment(plan, index, trajectory=dc.replace(plan.segments[index].trajectory, **changes))


def marks(whole: FlatteningPlan, index: int, **times: float) -> FlatteningPlan:
    poses = tuple(
        dc.replace(mark, time=times.get(mark.name.replace("-", "_"), mark.time))
        for mark in whole.segments[index].poses
    )
    return segment(whole, index, poses=poses)


def event(plan: FlatteningPlan, index: int, **changes: Any) -> FlatteningPlan:
    events = list(plan.events)
    events[index] = dc.replace(events[index], **changes)
    return dc.replace(plan, events=tuple(events))


def arm(plan: FlatteningPlan, index: int, **changes: Any) -> FlatteningPlan:
    arms = list(plan.arms)
    choice = arms[index]
    assert choice is not None
    arms[index] = dc.replace(choice, **changes)
    return dc.replace(plan, arms=(arms[0], arms[1]))


# Clock, poses, contact windows.


def test_a_plan_at_rest_has_the_required_structure(rest: FlatteningPlan, cell: Cell) -> None:
    found = Findings()
    check_numbers(rest, found)
    check_speed(rest, cell, found)
    check_identity(rest, cell, cell.limits_hash, found)
    check_structure(rest, found)
    check_choice(rest, found)
    check_rest(rest, HOME, found)
    check_grippers(rest, cell, found)
    assert check_sent(rest, found) is not None
    assert found.violations == []
    names = ["hash", "speed", "numbers", "structure", "choice", "gripper", "sent"]
    names += ["start", "rest", "continuity"]
    assert [check.name for check in found.checks()] == names


@pytest.mark.parametrize("index", [0, 1, 2])
def test_segments_follow_each_other(rest: FlatteningPlan, index: int) -> None:
    ends = [0.0, *(each.end for each in rest.segments)]
    late = segment(rest, index, start=ends[index] - 0.9e-6)
    assert kinds_of(found_by(check_structure, late)) == set()
    early = segment(rest, index, start=ends[index] - 1.1e-6)
    assert times_of(found_by(check_structure, early), "structure") == [ends[index] - 1.1e-6]


@pytest.mark.parametrize(
    "change",
    [
        lambda plan, x: marks(plan, 0, grasp=2.0 + x),
        lambda plan, x: marks(plan, 0, plan=-x),
        lambda plan, x: marks(plan, 0, touch_table=1.0 - x),
        lambda plan, x: marks(plan, 1, pull=1.0 + x),
        lambda plan, x: marks(plan, 2, free_garment=1.0 + x),
        lambda plan, x: segment(plan, 0, contact=(1.0 - x, 2.0)),
        lambda plan, x: segment(plan, 0, contact=(1.0, 2.0 + x)),
        lambda plan, x: segment(plan, 1, contact=(-x, 1.0)),
        lambda plan, x: segment(plan, 1, contact=(0.0, 1.0 + x)),
        lambda plan, x: segment(plan, 2, contact=(-x, 1.0)),
        lambda plan, x: segment(plan, 2, contact=(0.0, 1.0 + x)),
    ],
)
def test_poses_and_contact_windows_to_the_microsecond(
    rest: FlatteningPlan, change: Callable[[FlatteningPlan, float], FlatteningPlan]
) -> None:
    for inside in (0.0, 0.9e-6):
        assert found_by(check_structure, change(rest, inside)).violations == []
    assert kinds_of(found_by(check_structure, change(rest, 1.1e-6))) == {"structure"}


@pytest.mark.parametrize(
    ("index", "contact"), [(0, (1.5, 1.4)), (0, (0.9, 2.0)), (1, (0.2, 1.2)), (2, (0.5, 1.5))]
)
def test_a_wrong_contact_window_is_told_at_its_begin(
    rest: FlatteningPlan, index: int, contact: tuple[float, float]
) -> None:
    found = found_by(check_structure, segment(rest, index, contact=contact))
    assert times_of(found, "structure") == [rest.segments[index].start + contact[0]]
    empty = segment(rest, 0, contact=(1.5, 1.5))
    assert found_by(check_structure, empty).violations == []


def renamed(plan: FlatteningPlan, index: int, name: str) -> FlatteningPlan:
    poses = plan.segments[index].poses
    return segment(plan, index, poses=(dc.replace(poses[0], name=name), *poses[1:]))


@pytest.mark.parametrize(
    "change",
    [
        lambda plan: segment(plan, 1, name="push"),
        lambda plan: dc.replace(plan, segments=plan.segments[::-1]),
        lambda plan: dc.replace(plan, segments=(*plan.segments, plan.segments[2])),
        lambda plan: dc.replace(plan, arms=(None, None)),
        lambda plan: arm(plan, 0, side=1),
        lambda plan: arm(plan, 1, side=2),
        lambda plan: arm(plan, 1, side=-1),
        lambda plan: renamed(plan, 0, "grasp"),
        lambda plan: renamed(plan, 1, "push"),
        lambda plan: renamed(plan, 2, "leave"),
        lambda plan: segment(plan, 1, poses=plan.segments[1].poses[:1]),
        lambda plan: segment(plan, 1, poses=(*plan.segments[1].poses, PoseMark("rest", 1.0))),
    ],
)
def test_names_and_hands_are_the_expected_ones(
    rest: FlatteningPlan, change: Callable[[FlatteningPlan], FlatteningPlan]
) -> None:
    assert kinds_of(found_by(check_structure, change(rest))) == {"structure"}


def test_one_arm_may_serve_either_hand(rest: FlatteningPlan) -> None:
    for arms in ((rest.arms[0], None), (None, rest.arms[0]), rest.arms[::-1]):
        assert found_by(check_structure, dc.replace(rest, arms=arms)).violations == []


# Start, rest, continuity.


@pytest.mark.parametrize("axis", [0, 12])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_start_is_where_the_robot_stands(rest: FlatteningPlan, axis: int, sign: float) -> None:
    for off, broken in ((0.99e-4, False), (1.01e-4, True)):
        standing = HOME.copy()
        standing[axis] = sign * off
        found = found_by(check_rest, rest, standing)
        assert kinds_of(found) == ({"start"} if broken else set())
        assert times_of(found, "start") == ([0.0] if broken else [])
        check = result(found, "start")
        assert (check.value, check.limit) == (pytest.approx(off), 1e-4)
        assert check.margin == pytest.approx(1e-4 - off)
        assert (check.unit, check.where, check.time) == ("rad", f"axis {axis}", 0.0)


@pytest.mark.parametrize("index", [0, 1, 2])
@pytest.mark.parametrize("row", [0, -1])
def test_segments_rest_at_both_ends(rest: FlatteningPlan, index: int, row: int) -> None:
    old = rest.segments[index]
    time = old.start if row == 0 else old.end
    for speed, broken in ((0.99e-9, False), (1.01e-9, True), (-1.01e-9, True)):
        velocities = old.trajectory.velocities.copy()
        velocities[row, 4] = speed
        velocities[1, 5] = 1.0
        found = found_by(check_rest, samples(rest, index, velocities=velocities), HOME)
        assert kinds_of(found) == ({"rest"} if broken else set())
        assert times_of(found, "rest") == ([time] if broken else [])
        check = result(found, "rest")
        assert (check.value, check.limit) == (pytest.approx(abs(speed)), 1e-9)
        assert check.margin == pytest.approx(1e-9 - abs(speed))
        assert (check.unit, check.where, check.time) == ("rad/s", old.name, time)


@pytest.mark.parametrize("index", [1, 2])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_segments_begin_where_the_one_before_ended(
    rest: FlatteningPlan, index: int, sign: float
) -> None:
    for gap, broken in ((0.99e-9, False), (1.01e-9, True)):
        plan = rest
        for later in range(index, 3):  # moved as a whole, so that there is one gap
            positions = np.zeros((3, AXES))
            positions[:, 7] = sign * gap
            plan = samples(plan, later, positions=positions)
        found = found_by(check_rest, plan, HOME)
        start = rest.segments[index].start
        assert kinds_of(found) == ({"continuity"} if broken else set())
        assert times_of(found, "continuity") == ([start] if broken else [])
        check = result(found, "continuity")
        assert (check.value, check.limit) == (pytest.approx(gap, rel=1e-6), 1e-9)
        assert (check.unit, check.where, check.time) == ("rad", "axis 7", start)


# Gripper events.


def test_grippers_close_for_the_pull_and_open_after_it(rest: FlatteningPlan, cell: Cell) -> None:
    for index, states in enumerate([(False, False), (True, True), (False, False)]):
        for gripper in (0, 1):
            wrong = tuple(not s if i == gripper else s for i, s in enumerate(states))
            found = found_by(check_grippers, segment(rest, index, closed=wrong), cell)
            assert times_of(found, "gripper") == [rest.segments[index].start]
    for index, states in enumerate([(True, True), (False, False)]):
        for gripper in (0, 1):
            wrong = tuple(not s if i == gripper else s for i, s in enumerate(states))
            found = found_by(check_grippers, event(rest, index, closed=wrong), cell)
            assert times_of(found, "gripper") == [rest.events[index].time]


@pytest.mark.parametrize("other", [0, 1])
def test_the_gripper_of_an_arm_that_takes_no_part_stays_open(
    rest: FlatteningPlan, cell: Cell, other: int
) -> None:
    states = (other != 0, other != 1)
    alone = tuple(None if i == other else choice for i, choice in enumerate(rest.arms))
    plan = dc.replace(rest, arms=alone)
    assert kinds_of(found_by(check_grippers, plan, cell)) == {"gripper"}
    plan = event(segment(plan, 1, closed=states), 0, closed=states)
    assert found_by(check_grippers, plan, cell).violations == []


@pytest.mark.parametrize("index", [0, 1])
@pytest.mark.parametrize("early", [True, False])
def test_grippers_change_while_the_arms_rest(
    rest: FlatteningPlan, cell: Cell, index: int, early: bool
) -> None:
    before, after = rest.segments[index].end, rest.segments[index + 1].start
    for over, broken in ((0.9e-6, False), (1.1e-6, True)):
        time = before - over if early else after - 0.5 + over
        found = found_by(check_grippers, event(rest, index, time=time), cell)
        assert times_of(found, "gripper") == ([time] if broken else [])


@pytest.mark.parametrize("index", [0, 1])
def test_grippers_get_the_time_of_their_stroke(
    rest: FlatteningPlan, cell: Cell, index: int
) -> None:
    needed = cell.scenario.gripper.opening / cell.limits.gripper.velocity
    for dwell, broken in ((needed - 0.9e-6, False), (needed - 1.1e-6, True)):
        found = found_by(check_grippers, event(rest, index, dwell=dwell), cell)
        assert times_of(found, "gripper") == ([rest.events[index].time] if broken else [])
        check = result(found, "gripper")
        assert (check.value, check.limit) == (pytest.approx(dwell), pytest.approx(needed))
        assert check.margin == pytest.approx(dwell - needed)
        assert (check.unit, check.time) == ("s", rest.events[index].time)


def test_there_are_two_gripper_events(rest: FlatteningPlan, cell: Cell) -> None:
    extra = GripperEvent(6.0, (False, False), 0.5)
    for events in ((), rest.events[:1], (*rest.events, extra)):
        found = found_by(check_grippers, dc.replace(rest, events=events), cell)
        assert kinds_of(found) == {"gripper"}
    assert [check.value for check in found.checks()] == [0.5]


# Choice, speed, identity.


@pytest.mark.parametrize("index", [0, 1])
def test_offset_and_share_of_an_arm(rest: FlatteningPlan, index: int) -> None:
    light = arm(arm(rest, 0, share=0.0), 1, share=0.0)
    within = [{"offset": GREATEST_OFFSET}, {"offset": -GREATEST_OFFSET}]
    within += [{"share": 0.0}, {"share": 2.0}]
    beyond = [{"offset": 1.001 * GREATEST_OFFSET}, {"offset": -1.001 * GREATEST_OFFSET}]
    beyond += [{"share": -1e-9}, {"share": 2.0 + 1e-9}, {"share": np.nan}]
    assert pytest.approx(np.radians(75.0)) == GREATEST_OFFSET
    for changes in within:
        assert found_by(check_choice, arm(light, index, **changes)).violations == []
    for changes in beyond:
        assert kinds_of(found_by(check_choice, arm(light, index, **changes))) == {"choice"}


def test_arms_pull_no_further_together_than_their_number(rest: FlatteningPlan) -> None:
    for extra, broken in ((0.5e-9, False), (2e-9, True)):
        uneven = arm(arm(rest, 0, share=0.4), 1, share=1.6 + extra)
        found = found_by(check_choice, uneven)
        assert kinds_of(found) == ({"choice"} if broken else set())
        check = result(found, "choice")
        assert (check.value, check.limit) == (pytest.approx(2.0), 2.0)
        alone = arm(dc.replace(rest, arms=(None, rest.arms[1])), 1, share=1.0 + extra)
        assert kinds_of(found_by(check_choice, alone)) == ({"choice"} if broken else set())
    check = result(found_by(check_choice, arm(rest, 0, share=0.25)), "choice")
    assert (check.value, check.limit, check.margin) == (1.25, 2.0, 0.75)


def test_speed_is_above_0_and_up_to_the_cells(rest: FlatteningPlan, cell: Cell) -> None:
    allowed = cell.scenario.speed
    for speed in (1e-6, 0.5 * allowed, allowed):
        found = found_by(check_speed, dc.replace(rest, speed=speed), cell)
        assert found.violations == []
        check = result(found, "speed")
        assert (check.value, check.limit, check.margin) == (speed, allowed, allowed - speed)
    for speed in (0.0, -0.1, np.nextafter(allowed, 2.0), np.nan):
        found = found_by(check_speed, dc.replace(rest, speed=speed), cell)
        assert kinds_of(found) == {"speed"}


def test_each_hash_is_compared(rest: FlatteningPlan, cell: Cell) -> None:
    found = found_by(check_identity, rest, cell, cell.limits_hash)
    assert found.violations == []
    assert result(found, "hash").where == rest.content_hash[:12]
    assert kinds_of(found_by(check_identity, rest, cell, "0" * 64)) == {"hash"}
    for name in ("robot", "robot_hash", "limits_hash"):
        other = dc.replace(rest, **{name: "other"})
        assert len(found_by(check_identity, other, cell, cell.limits_hash).violations) == 1


# Numbers.


def test_as_many_parts_as_are_read(rest: FlatteningPlan) -> None:
    poses = rest.segments[0].poses

    def crowded(count: int) -> list[FlatteningPlan]:
        return [
            dc.replace(rest, segments=count * rest.segments[:1]),
            dc.replace(rest, events=count * rest.events[:1]),
            segment(rest, 0, poses=count * poses[:1]),
            segment(rest, 2, poses=count * poses[:1]),
        ]

    for plan in crowded(MOST_PARTS):
        assert found_by(check_numbers, plan).violations == []
    for plan in crowded(MOST_PARTS + 1):
        found = found_by(check_numbers, plan)
        assert [violation.kind for violation in found.violations] == ["numbers"]


@pytest.mark.parametrize(
    "place",
    [
        lambda plan, x: dc.replace(plan, turntable=x),
        lambda plan, x: dc.replace(plan, speed=x),
        lambda plan, x: arm(plan, 0, offset=x),
        lambda plan, x: arm(plan, 1, tilt=x),
        lambda plan, x: arm(plan, 1, share=x),
        lambda plan, x: event(plan, 1, time=x),
        lambda plan, x: event(plan, 0, dwell=x),
        lambda plan, x: segment(plan, 2, start=x),
        lambda plan, x: segment(plan, 1, contact=(x, 1.0)),
        lambda plan, x: segment(plan, 1, contact=(0.0, x)),
        lambda plan, x: marks(plan, 2, leave_table=x),
    ],
)
def test_numbers_up_to_a_million(
    rest: FlatteningPlan, place: Callable[[FlatteningPlan, float], FlatteningPlan]
) -> None:
    for sign in (1.0, -1.0):
        assert found_by(check_numbers, place(rest, sign * GREATEST)).violations == []
        beyond = found_by(check_numbers, place(rest, sign * np.nextafter(GREATEST, np.inf)))
        assert [violation.kind for violation in beyond.violations] == ["numbers"]
    for none in (np.nan, -np.inf):
        found = found_by(check_numbers, place(rest, none))
        assert [violation.kind for violation in found.violations] == ["numbers"]


def test_sides_are_whole_numbers(rest: FlatteningPlan) -> None:
    for index in (0, 1):
        assert found_by(check_numbers, arm(rest, index, side=np.int64(1))).violations == []
        for side in (1.0, True, "1", None):
            found = found_by(check_numbers, arm(rest, index, side=side))
            assert [violation.kind for violation in found.violations] == ["numbers"]
    alone = dc.replace(rest, arms=(None, rest.arms[1]))
    assert found_by(check_numbers, alone).violations == []


def test_as_many_samples_as_are_verified(
    rest: FlatteningPlan, monkeypatch: pytest.MonkeyPatch
) -> None:
    for most, broken in ((9, False), (8, True)):  # three segments of three
        monkeypatch.setattr(structure, "MOST_SAMPLES", most)
        found = found_by(check_numbers, rest)
        assert kinds_of(found) == ({"numbers"} if broken else set())
        check = result(found, "numbers")
        assert (check.value, check.limit, check.margin) == (9.0, most, most - 9.0)


# What is sent.


def test_a_sent_plan_has_whole_milliseconds_and_float32(rest: FlatteningPlan) -> None:
    t = rest.segments[1].trajectory
    odd = Trajectory(np.array([0.0, 0.5, 1.0003]), t.positions + 0.1, t.velocities)
    plan = segment(rest, 1, trajectory=odd, contact=(0.2, 1.0003))
    found = Findings()
    sent = check_sent(plan, found)
    assert sent is not None and found.violations == []
    assert sent.segments[1].trajectory.times == pytest.approx([0.0, 0.5, 1.001], abs=1e-12)
    assert np.all(sent.segments[1].trajectory.positions == float(np.float32(0.1)))
    # Contact to the end stays contact to the end; another end is kept.
    assert sent.segments[1].contact == (0.2, 1.001)
    assert [each.contact for each in sent.segments[::2]] == [(1.0, 2.0), (0.0, 1.0)]
    assert [each.name for each in sent.segments] == ["approach", "pull", "release"]
    check = result(found, "sent")
    assert (check.value, check.limit) == (pytest.approx(3e-4), 1e-3)
    assert check.margin == pytest.approx(7e-4)
    assert (check.unit, check.where) == ("s", "pull")
    assert check.time == pytest.approx(2.5 + 1.0003)


@pytest.mark.parametrize(("before", "end"), [(0.5e-6, 1.001), (2e-6, 1.0003 - 2e-6)])
def test_contact_to_the_end_is_meant_to_the_microsecond(
    rest: FlatteningPlan, before: float, end: float
) -> None:
    t = rest.segments[1].trajectory
    odd = Trajectory(np.array([0.0, 0.5, 1.0003]), t.positions, t.velocities)
    plan = segment(rest, 1, trajectory=odd, contact=(0.0, 1.0003 - before))
    sent = check_sent(plan, Findings())
    assert sent is not None and sent.segments[1].contact == (0.0, end)


@pytest.mark.parametrize("index", [0, 2])
def test_what_the_controller_cannot_represent(rest: FlatteningPlan, index: int) -> None:
    long = np.array([0.0, 4000.0, 8000.001])
    found = Findings()
    assert check_sent(samples(rest, index, times=long), found) is None
    assert times_of(found, "sent") == [rest.segments[index].start]
