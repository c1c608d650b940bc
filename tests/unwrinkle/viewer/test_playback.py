"""Posture of robot and grippers at a time of the plan's clock."""

import dataclasses as dc

import numpy as np
import pytest

from unwrinkle.models.robot import Cell
from unwrinkle.planning.plan import FlatteningPlan, GripperEvent
from unwrinkle.planning.search.key_poses import POSES
from unwrinkle.viewer.playback import Playback
from unwrinkle.viewer.preview import MOST_FRAMES


def test_playback_follows_segments_and_rests_between(plan: FlatteningPlan, cell: Cell) -> None:
    playback = Playback(plan, cell)
    for segment in plan.segments:
        trajectory = segment.trajectory
        for k in (0, 17, -1):
            time = segment.start + float(trajectory.times[k])
            np.testing.assert_allclose(
                playback.positions(time), trajectory.positions[k], atol=1e-12
            )
    end = plan.segments[0].trajectory.positions[-1]
    np.testing.assert_allclose(playback.positions(plan.segments[0].end + 0.4), end, atol=1e-12)
    np.testing.assert_allclose(playback.positions(-1.0), 0.0, atol=1e-12)
    np.testing.assert_allclose(playback.positions(99.0), 0.0, atol=1e-12)
    assert playback.duration == pytest.approx(plan.segments[-1].end)


def test_grippers_move_during_the_dwell_at_their_speed(plan: FlatteningPlan, cell: Cell) -> None:
    playback = Playback(plan, cell)
    close, open_ = (event.time for event in plan.events)
    stroke = cell.scenario.gripper.opening
    half = 0.5 * stroke / cell.limits.gripper.velocity
    for time, opening in (
        (0.0, stroke),
        (close, stroke),
        (close + half, 0.5 * stroke),
        (close + 0.7, 0.0),
        (open_, 0.0),
        (open_ + half, 0.5 * stroke),
        (playback.duration, stroke),
    ):
        np.testing.assert_allclose(playback.openings(time), opening, atol=1e-12)


def test_gripper_that_takes_no_part_stays_open(plan: FlatteningPlan, cell: Cell) -> None:
    events = (GripperEvent(1.0, (True, False), 0.75), GripperEvent(2.75, (False, False), 0.75))
    playback = Playback(dc.replace(plan, events=events), cell)
    np.testing.assert_allclose(playback.openings(1.75), [0.0, 0.03], atol=1e-12)
    assert [s.name for s in playback.steps if not s.pose] == ["close gripper", "open gripper"]


def test_steps_are_the_seven_poses_and_both_events_in_order(
    plan: FlatteningPlan, cell: Cell
) -> None:
    steps = Playback(plan, cell).steps
    assert [step.name for step in steps if step.pose] == list(POSES)
    assert [step.name for step in steps] == [
        *POSES[:3],
        "close grippers",
        *POSES[3:5],
        "open grippers",
        *POSES[5:],
    ]
    times = [step.time for step in steps]
    assert times == sorted(times)
    assert times[4] == pytest.approx(plan.segments[1].start + 0.5)


def test_frames_are_bounded(plan: FlatteningPlan, cell: Cell) -> None:
    playback = Playback(plan, cell)
    times = playback.frame_times(30.0, MOST_FRAMES)
    assert times[0] == 0.0
    assert times[-1] == playback.duration
    assert 1.0 / 31.0 < times[1] <= 1.0 / 30.0
    assert len(playback.frame_times(1e4, MOST_FRAMES)) == MOST_FRAMES
