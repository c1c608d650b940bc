"""What the monitor judges, by itself."""

import re
from collections.abc import Callable

import numpy as np
import pytest

from unwrinkle.hardware.controller.monitor import AXIS_NAMES, Monitor
from unwrinkle.hardware.controller_state import JointFeedback, RobotStatus
from unwrinkle.models.limits import Limits
from unwrinkle.models.site import ControllerSite
from unwrinkle.planning.trajectory import Trajectory

TrajectoryMaker = Callable[..., Trajectory]


class PlayedStream:
    """What a stream tells of a trajectory that is sent on a clock that begins at 0."""

    def __init__(self, trajectory: Trajectory) -> None:
        self._curve = trajectory.interpolant()
        self._end = trajectory.duration

    def reckoned(self, now: float) -> float:
        return now

    def progress(self, now: float) -> float:
        return min(now, self._end)

    def commanded(self, times: np.ndarray) -> np.ndarray:
        return self._curve(np.clip(times, 0.0, self._end))

    commanded_to = commanded


@pytest.fixture
def monitor(limits: Limits) -> Monitor:
    return Monitor(ControllerSite(), limits)


def feedback(positions: np.ndarray, received: float, stamp: float | None = None) -> JointFeedback:
    return JointFeedback(positions, np.zeros(13), received, stamp)


@pytest.mark.parametrize("lag", [0.0, 0.01, 0.055, 0.15, 0.25])
def test_a_lag_within_the_declared_latency_is_no_error(
    monitor: Monitor, make_trajectory: TrajectoryMaker, lag: float
) -> None:
    trajectory = make_trajectory(2)
    stream = PlayedStream(trajectory)
    for now in np.arange(0.0, trajectory.duration + 0.4, 0.025):
        seen = feedback(stream.commanded(np.array([now - lag]))[0], float(now))
        assert monitor.follows(seen, stream) is None  # type: ignore[arg-type]
    assert monitor.following_error < 0.01
    assert monitor.lag == pytest.approx(lag, abs=0.002)


def test_more_lag_than_declared_is_an_error(
    monitor: Monitor, make_trajectory: TrajectoryMaker
) -> None:
    trajectory = make_trajectory(2)
    stream = PlayedStream(trajectory)
    findings = [
        monitor.follows(feedback(stream.commanded(np.array([now - 0.38]))[0], float(now)), stream)  # type: ignore[arg-type]
        for now in np.arange(0.0, trajectory.duration, 0.025)
    ]
    first = next(finding for finding in findings if finding is not None)
    told = re.search(r"a lag of (\d+) ms would fit", first.text)
    assert told is not None and 370 <= int(told[1]) <= 390
    assert monitor.lag == pytest.approx(0.38, abs=0.002)


@pytest.mark.parametrize("axis", [0, 4, 12])
def test_the_axis_that_is_off_is_named(
    monitor: Monitor, make_trajectory: TrajectoryMaker, axis: int
) -> None:
    trajectory = make_trajectory(2)
    stream = PlayedStream(trajectory)
    begin = feedback(stream.commanded(np.array([0.0]))[0], 0.0)
    assert monitor.follows(begin, stream) is None  # type: ignore[arg-type]
    now = 0.5 * trajectory.duration
    seen = stream.commanded(np.array([now - 0.03]))[0]
    seen[axis] += 0.04
    found = monitor.follows(feedback(seen, now), stream)  # type: ignore[arg-type]
    assert found is not None and not found.brake
    assert found.text.startswith(f"{AXIS_NAMES[axis]} is 0.0")
    assert "at most 0.02 rad" in found.text and "would fit" not in found.text


def test_a_group_that_stands_still_is_named(
    monitor: Monitor, make_trajectory: TrajectoryMaker
) -> None:
    trajectory = make_trajectory(2)
    stream = PlayedStream(trajectory)
    found = None
    for now in np.arange(0.0, trajectory.duration, 0.025):
        seen = stream.commanded(np.array([now - 0.15]))[0]
        seen[0] = 0.0
        found = found or monitor.follows(feedback(seen, float(now)), stream)  # type: ignore[arg-type]
    assert found is not None and "ext_axis has not moved at all" in found.text
    assert "controller.groups_moved" in found.text and "would fit" not in found.text


def test_an_arm_that_freezes_gets_no_longer_latency_proposed(
    monitor: Monitor, make_trajectory: TrajectoryMaker
) -> None:
    trajectory = make_trajectory(2)
    stream = PlayedStream(trajectory)
    found = None
    for now in np.arange(0.0, trajectory.duration, 0.025):
        seen = stream.commanded(np.array([min(now, 0.6) - 0.15]))[0]
        found = found or monitor.follows(feedback(seen, float(now)), stream)  # type: ignore[arg-type]
    assert found is not None and "would fit" not in found.text


def test_groups_that_begin_a_period_apart_follow(
    monitor: Monitor, make_trajectory: TrajectoryMaker
) -> None:
    trajectory = make_trajectory(2)
    stream = PlayedStream(trajectory)
    for now in np.arange(0.0, trajectory.duration + 0.4, 0.025):
        seen = stream.commanded(np.array([now - 0.15]))[0]
        seen[7:] = stream.commanded(np.array([now - 0.158]))[0][7:]
        assert monitor.follows(feedback(seen, float(now)), stream) is None  # type: ignore[arg-type]
    assert monitor.following_error < 2e-3


def test_impossible_feedback(monitor: Monitor, limits: Limits) -> None:
    still = np.zeros(13)
    assert monitor.plausible(feedback(still, 0.0), None) is None
    moved = still.copy()
    moved[5] = 1.0 * limits.velocity[5] * 0.025
    assert monitor.plausible(feedback(moved, 0.025), feedback(still, 0.0)) is None
    moved[5] = 1.7 * limits.velocity[5] * 0.025 + 5e-3
    found = monitor.plausible(feedback(moved, 0.025), feedback(still, 0.0))
    assert found is not None and "r1_b jumped" in found.text and not found.brake
    # Sets that waited are received at once; the controller's stamps, or its period, tell the time
    # between.
    slow = still.copy()
    slow[5] = 0.05
    assert monitor.plausible(feedback(slow, 1.0, 0.525), feedback(still, 1.0, 0.5)) is None
    assert monitor.plausible(feedback(slow, 1.0), feedback(still, 1.0)) is None
    for bad, words in ((np.nan, "not a finite number"), (1.62, "its limits"), (80.0, "degrees?")):
        wrong = still.copy()
        wrong[3] = bad
        found = monitor.plausible(feedback(wrong, 0.0), None)
        assert found is not None and words in found.text and "r1_u" in found.text
    edge = still.copy()
    edge[3] = limits.upper[3] + 4e-3
    assert monitor.plausible(feedback(edge, 0.0), None) is None


def test_late_polls_are_counted_and_have_a_budget(monitor: Monitor) -> None:
    assert monitor.polled(0.049, streaming=True) is None and monitor.late == 0
    for _ in range(20):
        assert monitor.polled(0.06, streaming=True) is None
    found = monitor.polled(0.06, streaming=True)
    assert found is not None and found.brake and "late 21 times" in found.text
    assert monitor.polled(10.0, streaming=False) is None
    for back in (-0.5, float("nan")):
        found = monitor.polled(back, streaming=False)
        assert found is not None and "clock went back" in found.text and not found.brake
    monitor.restart()
    assert monitor.late == 0


def test_a_robot_that_may_not_move(monitor: Monitor) -> None:
    fine = RobotStatus(1, 0, 0, 0, 1, 2, 1)
    assert monitor.robot(None, True) is None and monitor.robot(fine, True) is None
    for status, words in (
        (RobotStatus(1, 1, 0, 0, 1, 2, 1), "emergency stop"),
        (RobotStatus(1, 0, 0, 0, 1, 1, 1), "teach"),
        (RobotStatus(1, 0, 4100, 1, 1, 2, 1), "code 4100"),
        (RobotStatus(0, 0, 0, 0, 1, 2, 1), "servos are off"),
        (RobotStatus(1, 0, 0, 0, 1, 2, 0), "not possible any more"),
    ):
        found = monitor.robot(status, True)
        assert found is not None and words in found.text and not found.brake
    assert monitor.robot(RobotStatus(0, 0, 0, 0, 0, 2, 0), False) is None


def test_where_the_robot_has_to_stand(monitor: Monitor) -> None:
    seen = feedback(np.zeros(13), 0.0)
    assert monitor.stands(seen, np.full(13, 0.29e-3)) == ""
    off = np.zeros(13)
    off[12] = 2e-3
    assert "2.00 mrad off on r2_t" in monitor.stands(seen, off)


def test_the_controllers_own_start_tolerance_counts_where_it_is_narrower(limits: Limits) -> None:
    # 10 pulses, as before MotoROS 1.8.2: 0.122 mrad on S, 0.497 on T.
    old = Monitor(ControllerSite(start_pulses=10.0, start_tolerance=1e-3), limits)
    seen, off = feedback(np.zeros(13), 0.0), np.zeros(13)
    off[12] = 0.45e-3
    assert old.stands(seen, off) == ""
    off[1] = 0.13e-3
    assert "0.13 mrad off on r1_s, at most 0.12 mrad" in old.stands(seen, off)
