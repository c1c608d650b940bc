"""The stream of points against a channel that the test answers by hand."""

from collections import deque
from collections.abc import Callable

import numpy as np
import pytest

from unwrinkle.hardware.motoros.messages import (
    Message,
    MessageType,
    MotionReply,
    MultiPoint,
    Result,
    TrajectoryPoint,
)
from unwrinkle.hardware.motoros.motion_channel import Asked
from unwrinkle.hardware.streaming.path_clock import PathClock
from unwrinkle.hardware.streaming.sent_cubics import StreamLimits
from unwrinkle.hardware.streaming.stream import START_DWELL_S, PointStream
from unwrinkle.models.site import ControllerSite
from unwrinkle.planning.trajectory import Trajectory

TrajectoryMaker = Callable[..., Trajectory]


class HandChannel:
    """Keeps what is sent; the test answers."""

    def __init__(self) -> None:
        self.sent: deque[tuple[Asked, Message]] = deque()
        self.points = 0
        self.quiet = True

    def point(self, message: Message, group: int, sequence: int, now: float) -> Asked:
        asked = Asked(message.type, group, sequence, now, now + 0.5)
        self.sent.append((asked, message))
        self.points += 1
        return asked

    def answer(self, stream: PointStream, now: float, result: int = Result.SUCCESS) -> Message:
        asked, message = self.sent.popleft()
        reply = MotionReply(asked.group, asked.sequence, asked.what, result)
        stream.answered(asked, reply, now)
        return message


class Bench:
    """A stream, its channel and what it recorded."""

    def __init__(self, trajectory: Trajectory, limits: StreamLimits, **site: object) -> None:
        self.channel = HandChannel()
        self.records: list[tuple[int, float, np.ndarray]] = []
        self.clock = PathClock(trajectory, limits)
        self.stream = PointStream(
            self.clock,
            ControllerSite(**site),  # type: ignore[arg-type]
            self.channel,  # type: ignore[arg-type]
            lambda now, sequence, time, q, v: self.records.append((sequence, time, q)),
        )
        self.now = 50.0

    def turn(self, step: float = 0.002) -> None:
        """Answer all that was sent before, and poll."""
        self.now += step
        for _ in range(len(self.channel.sent)):
            self.channel.answer(self.stream, self.now)
        self.stream.poll(self.now)


@pytest.fixture
def bench(make_trajectory: TrajectoryMaker, stream_limits: StreamLimits) -> Bench:
    return Bench(make_trajectory(1), stream_limits)


def test_a_point_goes_out_to_all_groups_together(bench: Bench) -> None:
    bench.stream.poll(bench.now)
    points = [TrajectoryPoint.of(message) for _, message in bench.channel.sent]
    assert [point.group for point in points] == [0, 1, 2]
    assert {point.sequence for point in points} == {0}
    assert {point.time for point in points} == {float(np.float32(0.0004))}  # cut to 0 ms
    for _ in range(5):  # nothing more before the answers
        bench.stream.poll(bench.now)
    assert len(bench.channel.sent) == 3
    bench.channel.answer(bench.stream, bench.now)
    bench.channel.answer(bench.stream, bench.now)
    assert bench.stream.acknowledged == 0
    bench.channel.answer(bench.stream, bench.now)
    assert bench.stream.acknowledged == 1 and not bench.channel.sent
    bench.stream.poll(bench.now)
    assert len(bench.channel.sent) == 3


def test_axes_go_to_the_groups_that_the_site_names(
    make_trajectory: TrajectoryMaker, stream_limits: StreamLimits
) -> None:
    trajectory = make_trajectory(1, start=0.01 * np.arange(13))
    for profile in ("groups", "ex"):
        bench = Bench(trajectory, stream_limits, profile=profile, groups=["ext_axis", "r2", "r1"])
        bench.stream.poll(bench.now)
        messages = [message for _, message in bench.channel.sent]
        if profile == "ex":
            assert len(messages) == 1 and messages[0].type == MessageType.JOINT_TRAJ_PT_FULL_EX
            points = [point.positions for point in MultiPoint.of(messages[0]).groups]
        else:
            points = [TrajectoryPoint.of(message).positions for message in messages]
        assert np.allclose(points[0], [0.0] * 10)
        assert np.allclose(points[1][:6], 0.01 * np.arange(7, 13)) and points[1][6:] == (0.0,) * 4
        assert np.allclose(points[2][:6], 0.01 * np.arange(1, 7))


def test_a_busy_group_alone_gets_the_same_point_again(bench: Bench) -> None:
    bench.stream.poll(bench.now)
    first = [message.encode() for _, message in bench.channel.sent]
    bench.channel.answer(bench.stream, bench.now)
    bench.channel.answer(bench.stream, bench.now, Result.BUSY)
    bench.channel.answer(bench.stream, bench.now)
    bench.stream.poll(bench.now + 0.001)
    assert not bench.channel.sent
    bench.stream.poll(bench.now + 0.006)
    assert [message.encode() for _, message in bench.channel.sent] == [first[1]]
    bench.channel.answer(bench.stream, bench.now + 0.008)
    assert bench.stream.acknowledged == 1 and not bench.stream.problem


def test_busy_for_too_long_is_a_problem(bench: Bench) -> None:
    bench.stream.poll(bench.now)
    for _ in range(1000):
        for _ in range(len(bench.channel.sent)):
            bench.channel.answer(bench.stream, bench.now, Result.BUSY)
        if bench.stream.problem:
            break
        bench.now += 0.005
        bench.stream.poll(bench.now)
    assert "busy with point 0 (group 0) for 2.00 s, at most 2 s" in bench.stream.problem


def test_points_are_never_further_ahead_than_the_lead(bench: Bench) -> None:
    ahead = []
    for _ in range(400):
        bench.turn()
        if bench.stream.acknowledged > 2:
            ahead.append(bench.records[-1][1] - bench.stream.executed(bench.now))
    assert max(ahead) <= 0.12 + 1e-9
    assert min(ahead[100:]) > 0.12 - 0.0081
    assert not bench.stream.ran_out(bench.now)
    # One point of rest more than the plan has, at the begin.
    assert [sequence for sequence, _, _ in bench.records] == list(range(len(bench.records)))
    assert bench.records[1][1] == pytest.approx(START_DWELL_S)
    assert np.array_equal(bench.records[1][2], bench.records[0][2])


def test_a_queue_that_runs_out_is_told(bench: Bench) -> None:
    for _ in range(200):
        bench.turn()
    assert not bench.stream.ran_out(bench.now)
    late = bench.now + 0.13
    assert "nothing is sent late" in bench.stream.ran_out(late) or "silent about" in (
        bench.stream.ran_out(late)
    )
    bench.stream.stop()
    sent = bench.channel.points
    bench.stream.poll(late)
    assert bench.channel.points == sent and not bench.stream.ran_out(late)


def test_groups_that_start_apart_are_a_problem(bench: Bench) -> None:
    bench.turn()
    bench.turn()  # the point of rest is on its way
    assert bench.records[-1][0] == 1
    bench.channel.answer(bench.stream, bench.now)
    bench.channel.answer(bench.stream, bench.now)
    bench.channel.answer(bench.stream, bench.now, Result.BUSY)
    bench.now += 0.03
    bench.stream.poll(bench.now)
    bench.channel.answer(bench.stream, bench.now)
    assert "started 30 ms apart" in bench.stream.problem


def test_a_refusal_is_told_in_plain_words(bench: Bench) -> None:
    bench.stream.poll(bench.now)
    asked, _ = bench.channel.sent.popleft()
    bench.stream.answered(asked, MotionReply(0, 0, 14, Result.INVALID, 3011), bench.now)
    assert "refuses point 0 (group 0)" in bench.stream.problem
    assert "not where the robot is commanded to stand" in bench.stream.problem


def test_what_was_sent_is_known_between_points(bench: Bench) -> None:
    for _ in range(300):
        bench.turn()
    curve = bench.clock.trajectory.interpolant()
    times = bench.stream.executed(bench.now) - np.linspace(0.0, 0.1, 7)
    assert np.abs(bench.stream.commanded(times) - curve(times - START_DWELL_S)).max() < 1e-12
    assert bench.stream.progress(bench.now) == pytest.approx(
        bench.stream.executed(bench.now) - START_DWELL_S, abs=1e-9
    )


def test_hold_and_resume_begin_with_rest(bench: Bench) -> None:
    for _ in range(300):
        bench.turn()
    bench.clock.set_rate(0.0)
    for _ in range(600):
        bench.turn()
    assert bench.stream.at_rest(bench.now) and not bench.stream.ended(bench.now)
    count = len(bench.records)
    for _ in range(500):
        bench.turn()
    assert len(bench.records) == count
    bench.clock.set_rate(1.0)
    for _ in range(3000):
        bench.turn()
    assert bench.stream.ended(bench.now)
    rest, dwell = bench.records[count - 1], bench.records[count]
    assert np.array_equal(rest[2], dwell[2])
    assert dwell[1] - rest[1] == pytest.approx(START_DWELL_S)
    times = [time for _, time, _ in bench.records]
    assert (np.diff(times) > 0.0).all()
