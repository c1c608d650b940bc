"""The virtual controller against its firmware.

Start, points, increments, stops, lost connections, feedback.
"""

import dataclasses as dc
from collections.abc import Callable
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from unwrinkle.hardware.motoros.messages import (
    Command,
    FeedbackBody,
    GroupPoint,
    Message,
    MotionControl,
    MotionReply,
    MultiFeedback,
    MultiPoint,
    ReplyCode,
    Result,
    RobotStatusBody,
    Subcode,
    TrajectoryPoint,
    ping,
)
from unwrinkle.simulation.controllers.controller import (
    GROUP_AXES,
    VirtualController,
    VirtualControllerSettings,
)

LOWER, UPPER = np.full(13, -2.0), np.full(13, 2.5)
VELOCITY = np.linspace(3.0, 4.0, 13)
START = np.linspace(-0.3, 0.3, 13)
STEP = 0.02
SUCCESS, BUSY = (Result.SUCCESS, 0), (Result.BUSY, 0)


def make(started: bool = True, **changes: object) -> VirtualController:
    settings = dc.replace(VirtualControllerSettings(), **changes)
    controller = VirtualController(settings, START, (LOWER, UPPER, VELOCITY))
    if started:
        start(controller)
    return controller


def start(controller: VirtualController) -> None:
    controller.handle_motion(MotionControl(-1, 0, Command.START_TRAJ_MODE).to_message())
    while controller.starting:
        controller.advance()
    assert [MotionReply.of(m).result for m in controller.late_replies()] == [Result.SUCCESS]


def ask(controller: VirtualController, command: int, group: int = -1) -> tuple[int, int]:
    (reply,) = controller.handle_motion(MotionControl(group, 4, command).to_message())
    told = MotionReply.of(reply)
    assert (told.group, told.sequence, told.command) == (group, 4, command)
    return told.result, told.subcode


def at(t: float) -> float:
    """A time that is sent so that cutting it to whole milliseconds leaves it."""
    return (round(1e3 * t) + 0.4) / 1e3


def path(t: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Half a radian there and back within 2 s, at rest at both ends."""
    w = np.pi
    away = 0.25 * (1.0 - np.cos(w * t))
    return START + away, np.full(13, 0.25 * w * np.sin(w * t))


def point(group: int, sequence: int, **changes: object) -> TrajectoryPoint:
    """The path's point of one group."""
    q, v = path(sequence * STEP)
    axes = list(GROUP_AXES[group])
    whole = TrajectoryPoint(group, sequence, at(sequence * STEP), tuple(q[axes]), tuple(v[axes]))
    return dc.replace(whole, **changes)


def reply_to(controller: VirtualController, body: TrajectoryPoint | MultiPoint) -> MotionReply:
    (reply,) = controller.handle_motion(body.to_message())
    return MotionReply.of(reply)


def give(controller: VirtualController, body: TrajectoryPoint | MultiPoint) -> tuple[int, int]:
    told = reply_to(controller, body)
    return told.result, told.subcode


def stream(controller: VirtualController, count: int) -> int:
    """Send points of all groups, waiting where it is busy; how often it was."""
    busy = 0
    for sequence in range(count):
        for group in range(3):
            while (answer := give(controller, point(group, sequence))) == BUSY:
                controller.advance()
                busy += 1
            assert answer == SUCCESS, (sequence, group)
    controller.advance()
    return busy


def run(controller: VirtualController, seconds: float) -> None:
    for _ in range(round(seconds / controller.settings.period)):
        controller.advance()


def rest(controller: VirtualController) -> None:
    for _ in range(1000):
        if not controller.moving:
            return
        controller.advance()
    pytest.fail("it does not come to rest")


# ---------------------------------------------------------------- start


def test_trajectory_mode_takes_servo_and_job_time_and_answers_then() -> None:
    controller = make(started=False, servo_time=0.1, job_time=0.05)
    assert ask(controller, Command.CHECK_MOTION_READY) == (
        Result.FAILURE,
        Subcode.NOT_READY_SERVO_OFF,
    )
    message = MotionControl(-1, 3, Command.START_TRAJ_MODE).to_message()
    assert controller.handle_motion(message) == []
    servo = 0.0
    while controller.starting:
        controller.advance()
        servo = servo or (controller.time if controller.pendant.servo else 0.0)
    (reply,) = controller.late_replies()
    assert MotionReply.of(reply).sequence == 3
    assert servo == pytest.approx(0.1, abs=0.005)
    assert controller.time == pytest.approx(0.15, abs=0.005)
    assert ask(controller, Command.CHECK_MOTION_READY) == SUCCESS
    assert ask(controller, Command.START_TRAJ_MODE) == SUCCESS
    assert controller.late_replies() == []


BREAKS = [
    (lambda c: c.pendant.press_e_stop(), Subcode.NOT_READY_E_STOP),
    (lambda c: c.pendant.set_mode("teach"), Subcode.NOT_READY_NOT_PLAY),
    (lambda c: c.pendant.set_remote(False), Subcode.NOT_READY_NOT_REMOTE),
    (lambda c: c.pendant.press_hold(), Subcode.NOT_READY_HOLD),
    (lambda c: c.pendant.raise_alarm(4107, lasting=True), Subcode.NOT_READY_ALARM),
]


@pytest.mark.parametrize(("break_it", "code"), BREAKS)
def test_a_start_is_refused_for_the_first_reason_that_is_looked_at(
    break_it: Callable[[VirtualController], None], code: int
) -> None:
    controller = make(started=False)
    break_it(controller)
    # Servos are looked at before hold, and nothing switches them on while it is pressed.
    told = Subcode.NOT_READY_SERVO_OFF if code == Subcode.NOT_READY_HOLD else code
    assert ask(controller, Command.START_TRAJ_MODE) == (Result.NOT_READY, told)
    assert not controller.starting and controller.status.motion_possible == 0


@pytest.mark.parametrize(("break_it", "code"), BREAKS)
def test_the_pendant_empties_the_queues_and_ends_motion(
    break_it: Callable[[VirtualController], None], code: int
) -> None:
    controller = make()
    stream(controller, 5)
    run(controller, 0.04)
    before = controller.positions
    assert sum(controller.queued) > 0
    break_it(controller)
    assert sum(controller.queued) == 0
    assert give(controller, point(0, 5)) == (Result.NOT_READY, code)
    rest(controller)
    # Braking: less than v^2 / 2a and a period.
    assert 0.0 < np.abs(controller.positions - before).max() < 0.8**2 / 20.0 + 0.8 * 0.004


def test_hold_leaves_the_queues_of_the_old_firmware_and_its_release_runs_them() -> None:
    controller = make(firmware="2013", accepts="groups")
    stream(controller, 5)
    run(controller, 0.02)
    waiting = controller.queued
    assert min(waiting) > 0
    controller.pendant.press_hold()
    assert give(controller, point(0, 5)) == (Result.NOT_READY, Subcode.NOT_READY_HOLD)
    run(controller, 0.5)
    assert controller.queued == waiting and controller.status.in_motion == 1
    before = controller.positions
    controller.pendant.release_hold()
    controller.advance()
    assert (controller.positions > before).all() and max(controller.queued) < max(waiting)


def test_a_start_under_way_fails_with_the_reason() -> None:
    controller = make(started=False)
    controller.handle_motion(MotionControl(-1, 3, Command.START_TRAJ_MODE).to_message())
    controller.advance()
    controller.pendant.press_e_stop()
    controller.advance()
    (reply,) = controller.late_replies()
    told = MotionReply.of(reply)
    assert (told.result, told.subcode) == (Result.NOT_READY, Subcode.NOT_READY_E_STOP)
    assert not controller.pendant.servo


def test_a_start_resets_an_alarm_unless_an_operator_is_needed() -> None:
    controller = make()
    controller.pendant.raise_alarm(4107)
    assert controller.status.error_code == 4107 and controller.status.drives_powered == 0
    controller.pendant.press_e_stop()
    assert ask(controller, Command.START_TRAJ_MODE) == (Result.NOT_READY, Subcode.NOT_READY_ALARM)
    controller.pendant.release_e_stop()
    controller.handle_motion(MotionControl(-1, 3, Command.START_TRAJ_MODE).to_message())
    assert controller.starting and controller.status.in_error == 0


def test_motion_is_possible_only_in_trajectory_mode() -> None:
    controller = make(started=False)
    assert controller.status.motion_possible == 0
    start(controller)
    assert controller.status.motion_possible == 1
    assert ask(controller, Command.STOP_TRAJ_MODE) == SUCCESS
    assert controller.status.motion_possible == 0
    not_started = Subcode.NOT_READY_NOT_STARTED
    assert ask(controller, Command.CHECK_MOTION_READY) == (Result.FAILURE, not_started)
    assert give(controller, point(0, 0)) == (Result.NOT_READY, not_started)


def test_the_firmware_of_2013_does_not_say_why_it_is_not_ready() -> None:
    controller = make(started=False, firmware="2013")
    assert ask(controller, Command.CHECK_MOTION_READY) == (Result.FAILURE, 0)
    controller.pendant.press_e_stop()
    start_refused = ask(controller, Command.START_TRAJ_MODE)
    assert start_refused == (Result.NOT_READY, Subcode.NOT_READY_E_STOP)


# ---------------------------------------------------------------- points


@pytest.mark.parametrize("period", [0.004, 0.008])
def test_it_follows_the_cubics_between_the_points(period: float) -> None:
    controller = make(period=period)
    stream(controller, 101)
    rest(controller)
    assert controller.underruns == 0 and not controller.audit.findings
    ran = np.array([q for _, q, _ in controller.trace])
    ran = ran[np.flatnonzero((ran != START).any(axis=1))[0] :]
    assert len(ran) >= 1.99 / period
    for number, q in enumerate(ran):
        # Cubics between samples of a cosine, 20 ms apart.
        expected, _ = path(min((number + 1) * period, 2.0))
        np.testing.assert_allclose(q, expected, atol=2e-7)
    np.testing.assert_allclose(controller.positions, START, atol=2e-7)


class Reference:
    """What becomes of one axis' points, by a reading of the firmware that knows nothing of the
    virtual controller.

    Times are whole ms. A point becomes increments that end on a grid of the clock's periods, begun
    by the first point, and at the point itself. One cycle runs one increment, and with it those
    that end within a period after the last end that was run, none that end before it.
    """

    def __init__(self, period: int, position: float) -> None:
        self.period = period
        self.queue: list[tuple[int, float]] = []
        self.begin(0, position, 0.0, position)

    def begin(self, ms: int, q: float, v: float, position: float) -> None:
        self.last, self.made, self.ran, self.rest = (ms, q, v), position, ms, 0

    def point(self, ms: int, q: float, v: float) -> None:
        begin, q0, v0 = self.last
        if ms <= begin:
            return  # taken, but nothing comes of it
        span = (ms - begin) / 1e3
        ends = [*range(begin + (self.rest or self.period), ms, self.period), ms]
        final = begin + (self.rest or self.period) + (len(ends) - 1) * self.period
        whole = np.linalg.solve(
            [[span**2, span**3], [2 * span, 3 * span**2]], [q - q0 - v0 * span, v - v0]
        )
        for end in ends:
            u = (end - begin) / 1e3
            here = q if end == ms else q0 + v0 * u + whole[0] * u**2 + whole[1] * u**3
            self.queue.append((end, here - self.made))
            self.made = here
        if final > ms:
            self.rest = final - ms
        elif len(ends) > 1:
            self.rest = 0  # of a point met exactly with its first increment the old rest stays
        self.last = (ms, q, v)

    def cycle(self) -> float:
        before = self.ran
        self.ran, way = self.queue.pop(0)
        while self.queue and before <= self.queue[0][0] <= before + self.period:
            self.ran, more = self.queue.pop(0)
            way += more
        return way

    def stop(self) -> None:
        self.queue.clear()


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("period", [4, 8])
def test_increments_are_those_of_the_firmware_whatever_the_times(period: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    controller = make(period=1e-3 * period)
    reference = Reference(period, float(START[1]))
    compared = overlaps = 0
    sequence = ms = 0
    for _ in range(400):
        if sequence == 0:
            overlaps += bool(reference.queue)
            ms = int(random.integers(0, 50))
        else:
            ms += int(random.choice([1, 2, 3, 5, 7, period, 9, 13, 2 * period, 23, 0, -3]))
        # So near that a first point is always within its 30 pulses.
        q, v = np.float32(START[1] + random.normal(0.0, 1e-5)), np.float32(random.normal(0.0, 1e-3))
        whole = (float(q), *START[2:7])
        sent = TrajectoryPoint(0, sequence, (ms + 0.5) / 1e3, whole, (float(v),) + (0.0,) * 5)
        assert give(controller, sent) == SUCCESS
        if sequence == 0:
            reference.begin(ms, float(q), float(v), float(controller.positions[1]))
        else:
            reference.point(ms, float(q), float(v))
        for _ in range(int(random.integers(1, 4))):
            before = controller.positions[1]
            controller.advance()
            if reference.queue:
                way = controller.positions[1] - before
                assert way == pytest.approx(reference.cycle(), abs=1e-9), (seed, compared)
                compared += 1
            assert controller.queued[0] == len(reference.queue)
        sequence += 1
        if random.random() < 0.1:
            sequence = 0  # over again, though increments may wait
        elif random.random() < 0.05:
            assert ask(controller, Command.STOP_MOTION) == SUCCESS
            reference.stop()  # and what comes next is taken as if nothing had been
    assert compared > 300 and overlaps > 5


def test_parts_of_a_period_are_run_together() -> None:
    controller = make()
    ran = []
    for sequence in range(3):
        ramp = tuple(START[1:7] + 1e-3 * sequence)
        sent = TrajectoryPoint(0, sequence, at(5.0 + 0.01 * sequence), ramp, (0.1,) * 6)
        assert give(controller, sent) == SUCCESS
        if sequence == 1:
            controller.advance()
            ran.append(float(controller.positions[1] - START[1]))
    for _ in range(4):
        controller.advance()
        ran.append(float(controller.positions[1] - START[1]))
    # Increments end at 4, 8, 10, 12, 16 and 20 ms; 10 and 12 are one cycle's.
    np.testing.assert_allclose(ran, [4e-4, 8e-4, 1.2e-3, 1.6e-3, 2e-3], atol=1e-7)
    assert controller.underruns == 0
    controller.advance()
    assert controller.underruns == 1  # at full speed, when all was run


def test_times_are_cut_to_whole_milliseconds_not_rounded() -> None:
    for time in (0.116, 0.1159, 0.1161, 0.0079999, 0.008, 0.0084, 0.019, 0.57, 1.001, 0.0009):
        controller = make(period=0.001, depth=2000)
        assert give(controller, point(0, 0)) == SUCCESS
        assert give(controller, point(0, 1, time=time)) == SUCCESS
        controller.advance()
        exact = Fraction(float(np.float32(time))) * 1000
        assert controller.queued[0] == max(int(exact) - 1, 0), time
    # Of points on the clock's grid many are cut to the millisecond before.
    cut = [int(Fraction(float(np.float32(0.008 * k))) * 1000) for k in range(135)]
    ways = []
    for sent in (lambda k: 0.008 * k, lambda k: at(0.008 * k)):
        controller = make(period=0.008)
        for k in range(135):
            here = tuple(START[1:7] + 0.0008 * k)
            assert give(controller, TrajectoryPoint(0, k, sent(k), here, (0.1,) * 6)) == SUCCESS
            controller.advance()
        ran = np.diff([q[1] for _, q, _ in controller.trace])
        ways.append(ran[np.flatnonzero(ran)][:130])
    assert sum(b - a != 8 for a, b in pairwise(cut)) > 60
    np.testing.assert_allclose(ways[1], 0.0008, rtol=1e-3)
    assert np.abs(ways[0] / 0.0008 - 1.0).max() > 0.1


def test_it_is_busy_for_up_to_a_period_after_each_point() -> None:
    controller = make()
    assert give(controller, point(0, 0)) == SUCCESS
    assert give(controller, point(0, 1)) == SUCCESS  # a first one is not worked on
    assert give(controller, point(0, 2)) == BUSY
    assert give(controller, point(1, 0)) == SUCCESS  # each group for itself
    controller.advance()
    assert give(controller, point(0, 2)) == SUCCESS
    assert controller.points == 0 and len(controller.received[0]) == 3


def test_a_queue_holds_two_hundred_increments_and_the_group_is_busy_meanwhile() -> None:
    controller = make()
    give(controller, point(0, 0))
    assert give(controller, point(0, 1, time=at(2.0))) == SUCCESS  # five hundred increments
    periods = 0
    while give(controller, point(0, 2, time=at(2.1))) == BUSY:
        controller.advance()
        periods += 1
        # One increment leaves each period.
        assert controller.queued in ((199, 0, 0), (200, 0, 0))
        count = ask(controller, Command.CHECK_QUEUE_COUNT, 0)
        assert count == (Result.SUCCESS, controller.queued[0])
    assert periods == pytest.approx(300, abs=2)
    assert ask(controller, Command.CHECK_QUEUE_COUNT, 1) == SUCCESS


@pytest.mark.parametrize("group", [-1, 3, 5])
def test_the_queue_of_a_group_that_is_not_there_counts_minus_one(group: int) -> None:
    assert ask(make(), Command.CHECK_QUEUE_COUNT, group) == (Result.FAILURE, -1)


@pytest.mark.parametrize(
    ("sequence", "changes", "code"),
    [
        (1, {"time": None}, Subcode.INVALID_INSUFFICIENT),
        (1, {"positions": None}, Subcode.INVALID_INSUFFICIENT),
        (1, {"velocities": None}, Subcode.INVALID_INSUFFICIENT),
        (-1, {}, Subcode.INVALID_SEQUENCE),
        (1, {"time": 14400.0}, Subcode.INVALID_TIME),
        (1, {"velocities": (0.0,) * 5 + (5.0,)}, Subcode.INVALID_SPEED),
        (0, {"velocities": (0.0,) * 5 + (-5.0,)}, Subcode.INVALID_SPEED),
        (0, {"positions": tuple(START[1:7] + 0.01)}, Subcode.INVALID_START),
        (1, {"group": 3}, Subcode.INVALID_GROUP),
        (1, {"group": -1}, Subcode.INVALID_GROUP),
    ],
)
def test_points_that_are_refused(sequence: int, changes: dict[str, object], code: int) -> None:
    controller = make()
    give(controller, point(0, 0))
    wrong = dc.replace(point(0, abs(sequence)), sequence=sequence, **changes)
    told = reply_to(controller, wrong)
    assert (told.result, told.subcode) == (Result.INVALID, code)
    assert (told.group, told.sequence, told.command) == (wrong.group, sequence, 14)
    assert len(controller.received[0]) == 1 and not controller.audit.findings
    assert give(controller, point(0, 1)) == SUCCESS


@pytest.mark.parametrize(
    ("sequence", "changes", "finding"),
    [
        (2, {}, "follows 0"),
        (1000, {}, "follows 0"),
        (1, {"time": at(0.0)}, "does not increase"),
        (1, {"time": -1.0004}, "does not increase"),
        (1, {"time": 0.02}, "whole millisecond"),
        (1, {"positions": (2.6,) * 6}, "position beyond its limit"),
        (1, {"positions": tuple(START[1:7] + 0.2)}, "exceeds a velocity limit"),
        (1, {"velocities": (0.0,) * 7 + (0.1,)}, "joints that the group does not have"),
        (1, {"positions": (*START[1:7], 0.0, 0.1)}, "joints that the group does not have"),
    ],
)
def test_points_that_are_taken_and_noted(
    sequence: int, changes: dict[str, object], finding: str
) -> None:
    controller = make()
    assert give(controller, point(0, 0)) == SUCCESS
    assert not controller.audit.findings
    wrong = dc.replace(point(0, 1), sequence=sequence, **changes)
    assert give(controller, wrong) == SUCCESS
    assert [text for text in controller.audit.findings if finding in text]
    assert len(controller.received[0]) == 2


def test_a_point_that_comes_twice_is_taken_twice_and_noted() -> None:
    controller = make()
    stream(controller, 2)
    assert give(controller, point(0, 1)) == SUCCESS
    assert [text for text in controller.audit.findings if "follows 1" in text]
    assert len(controller.received[0]) == 3


def test_valid_bits_without_a_meaning_are_not_looked_at() -> None:
    controller = make()
    message = point(0, 0).to_message()
    body = message.body[:8] + (0x7FFFFFF7).to_bytes(4, "little") + message.body[12:]
    (reply,) = controller.handle_motion(Message(message.type, 2, 0, body))
    assert MotionReply.of(reply).result == Result.SUCCESS


def test_a_speed_that_a_generous_governor_lets_pass_is_noted() -> None:
    controller = make(speed_cap=2.0)
    assert give(controller, point(0, 0, velocities=(5.0,) * 6)) == SUCCESS
    assert any("a velocity beyond its limit" in text for text in controller.audit.findings)


def test_the_newest_thousand_findings_are_kept() -> None:
    controller = make()
    for number in range(1010):
        give(controller, point(0, 0, time=0.001 * number))
    assert len(controller.audit.findings) == 1000


def test_good_points_are_not_noted() -> None:
    controller = make()
    stream(controller, 40)
    assert not controller.audit.findings


def test_a_time_that_does_not_increase_is_answered_with_success_and_skipped() -> None:
    controller = make()
    assert give(controller, point(0, 0)) == SUCCESS
    for time in (0.0, -5.0):
        assert give(controller, point(0, 50, time=time)) == SUCCESS
        controller.advance()
        assert controller.queued[0] == 0 and np.array_equal(controller.positions, START)
    # The next one goes on from the point before it.
    assert give(controller, point(0, 1)) == SUCCESS
    run(controller, 0.02)
    np.testing.assert_allclose(controller.positions[1:7], path(STEP)[0][1:7], atol=1e-7)


def test_a_cubic_that_leaves_the_limits_between_its_points_is_run_and_noted() -> None:
    begin = UPPER - 1e-3
    controller = VirtualController(VirtualControllerSettings(), begin, (LOWER, UPPER, VELOCITY))
    start(controller)
    near = tuple(begin[:6])
    assert give(controller, TrajectoryPoint(0, 0, at(0.0), near, (0.5,) * 6)) == SUCCESS
    assert give(controller, TrajectoryPoint(0, 1, at(0.1), near, (-0.5,) * 6)) == SUCCESS
    assert any("leaves a position limit" in text for text in controller.audit.findings)
    run(controller, 0.1)
    assert max(q[1] for _, q, _ in controller.trace) > UPPER[1] + 0.01


def test_numbers_that_are_not_finite_are_not_looked_for() -> None:
    taken = 0
    for offset in range(12, 136, 4):
        for bits in (b"\0\0\xc0\x7f", b"\0\0\x80\x7f", b"\0\0\x80\xff"):
            controller = make(delay=0.0)
            give(controller, point(0, 0))
            good = point(0, 1).to_message()
            body = bytearray(good.body)
            body[offset : offset + 4] = bits
            (reply,) = controller.handle_motion(Message(good.type, 2, 0, bytes(body)))
            told = MotionReply.of(reply)
            infinite = bits != b"\0\0\xc0\x7f"
            if told.result == Result.SUCCESS:
                taken += 1
                if offset < 96:  # accelerations are not given
                    assert any("not finite" in text for text in controller.audit.findings)
            else:
                assert infinite and told.subcode in (Subcode.INVALID_SPEED, Subcode.INVALID_TIME)
            run(controller, 0.1)
            # What such a number becomes is not known; what is told of the robot can still be sent.
            assert len([m.encode() for m in controller.feedback()]) == 5
    assert taken > 31


def test_the_first_point_has_to_be_within_thirty_pulses_of_each_axis() -> None:
    # S, L, U, R, B, T of both arms, and the turn-table: mrad.
    tolerances = (0.365, 0.40, 0.38, 0.53, 0.64, 1.49)
    for group, axes in enumerate(GROUP_AXES):
        for slot, axis in enumerate(axes):
            tolerance = 1e-3 * (0.31 if group == 2 else tolerances[slot])
            for off, answer in (
                (1.03 * tolerance, (Result.INVALID, Subcode.INVALID_START)),
                (0.97 * tolerance, SUCCESS),
                (-1.03 * tolerance, (Result.INVALID, Subcode.INVALID_START)),
            ):
                away = START.copy()
                away[axis] += off
                there = point(group, 0, positions=tuple(away[list(axes)]))
                assert give(make(), there) == answer, (group, slot)


def test_older_firmware_allows_ten_pulses() -> None:
    away = (START[1] + 2e-4, *START[2:7])
    assert give(make(start_pulses=30.0), point(0, 0, positions=away)) == SUCCESS
    refused = give(make(start_pulses=10.0), point(0, 0, positions=away))
    assert refused == (Result.INVALID, Subcode.INVALID_START)


def test_a_first_point_off_by_some_pulses_is_reached_with_the_first_increment() -> None:
    controller = make()
    q = START[1:7] + 3e-4
    assert give(controller, point(0, 0, positions=tuple(q))) == SUCCESS
    assert give(controller, point(0, 1, positions=tuple(q), velocities=(0.0,) * 6)) == SUCCESS
    controller.advance()
    np.testing.assert_allclose(controller.positions[1:7], q, atol=1e-7)


def test_the_governor_caps_the_speed_of_points() -> None:
    fast = tuple(0.5 * VELOCITY[1:7])
    for cap, answer in ((1.0, SUCCESS), (0.2, (Result.INVALID, Subcode.INVALID_SPEED))):
        controller = make(speed_cap=cap)
        assert give(controller, point(0, 0, velocities=fast)) == answer
        assert give(controller, point(0, 0)) == SUCCESS
        assert give(controller, point(0, 1, velocities=fast)) == answer


@pytest.mark.parametrize(("cap", "most"), [(1.0, 3), (0.4, 1)])
def test_speeds_are_cut_to_whole_radians_before_they_are_compared(cap: float, most: int) -> None:
    # Integer arithmetic in the released binary; the limit of this axis is 3.083 rad/s, governed
    # 1.233.
    for speed, answer in (
        (most + 0.99, SUCCESS),
        (-most - 0.99, SUCCESS),
        (most + 1.0, (Result.INVALID, Subcode.INVALID_SPEED)),
        (-most - 1.0, (Result.INVALID, Subcode.INVALID_SPEED)),
    ):
        controller = make(speed_cap=cap)
        fast = (speed,) + (0.0,) * 5
        assert give(controller, point(0, 0, velocities=fast)) == answer
        give(controller, point(0, 0))
        assert give(controller, point(0, 1, velocities=fast)) == answer
        noted = any("a velocity beyond its limit" in text for text in controller.audit.findings)
        assert noted == (answer == SUCCESS and cap == 1.0)


def test_points_after_a_stop_need_not_begin_with_a_first_one_but_it_is_noted() -> None:
    controller = make()
    stream(controller, 10)
    run(controller, 0.02)
    assert ask(controller, Command.STOP_MOTION) == SUCCESS
    rest(controller)
    assert not controller.audit.findings
    before = controller.positions
    assert give(controller, point(0, 10)) == SUCCESS
    assert any("follows none" in text for text in controller.audit.findings)
    run(controller, 0.02)
    # It goes on from the last point as if that had been reached: increments, no positions.
    way = path(10 * STEP)[0] - path(9 * STEP)[0]
    moved = controller.positions - before
    assert moved[1:7] == pytest.approx(way[1:7], abs=1e-3)


def test_a_first_point_in_motion_starts_over_or_is_too_far_away() -> None:
    controller = make()
    stream(controller, 3)
    controller.advance()
    q, v = controller.positions[1:7], controller.velocities[1:7]
    waiting = controller.queued[0]
    far = (Result.INVALID, Subcode.INVALID_START)
    assert give(controller, point(0, 0, positions=tuple(q + 0.1))) == far
    assert give(controller, TrajectoryPoint(0, 0, at(0.0), tuple(q), tuple(v))) == SUCCESS
    assert controller.queued[0] == waiting  # they are still run


# ---------------------------------------------------------------- all groups in one message


def groups(sequence: int, *numbers: int) -> tuple[GroupPoint, ...]:
    return tuple(point(number, sequence).point for number in numbers)


def test_one_message_may_carry_fewer_groups_in_any_order() -> None:
    controller = make()
    assert give(controller, MultiPoint(0, groups(0, 0, 1))) == SUCCESS
    told = reply_to(controller, MultiPoint(1, groups(1, 1, 0)))
    assert (told.result, told.group, told.sequence, told.command) == (0, 0, 1, 2016)
    assert [len(points) for points in controller.received] == [2, 2, 0]
    assert controller.points == 0
    assert controller.received[1][-1].positions == pytest.approx(path(STEP)[0][7:13])


def test_one_message_may_carry_further_valid_bits_and_empty_slots() -> None:
    controller = make()
    message = MultiPoint(0, groups(0, 0, 1, 2)).to_message(four_slots=True)
    body = bytearray(message.body)
    for k in range(3):
        body[8 + 132 * k + 4 : 8 + 132 * k + 8] = (0x7F).to_bytes(4, "little")
    (reply,) = controller.handle_motion(Message(message.type, 2, 0, bytes(body)))
    assert MotionReply.of(reply).result == Result.SUCCESS
    assert [len(points) for points in controller.received] == [1, 1, 1]


def test_groups_of_one_message_are_checked_together_but_taken_one_by_one() -> None:
    controller = make()
    give(controller, MultiPoint(0, groups(0, 0, 1, 2)))
    late = groups(1, 0, 1, 2)
    lacking = (*late[:2], dc.replace(late[2], velocities=None))
    told = reply_to(controller, MultiPoint(1, lacking))
    assert (told.group, told.subcode) == (2, Subcode.INVALID_INSUFFICIENT)
    assert [len(points) for points in controller.received] == [1, 1, 1]
    fast = (late[0], dc.replace(late[1], velocities=(9.0,) * 6), late[2])
    told = reply_to(controller, MultiPoint(1, fast))
    assert (told.group, told.subcode) == (1, Subcode.INVALID_SPEED)
    assert [len(points) for points in controller.received] == [2, 1, 1]


def test_a_message_for_all_groups_is_busy_if_one_of_them_is() -> None:
    controller = make()
    give(controller, MultiPoint(0, groups(0, 0, 1, 2)))
    assert give(controller, MultiPoint(1, groups(1, 2))) == SUCCESS
    told = reply_to(controller, MultiPoint(1, groups(1, 0, 1, 2)))
    assert (told.group, told.result) == (2, Result.BUSY)
    assert give(controller, MultiPoint(0, groups(0, 2))) == BUSY  # a first point too
    assert give(controller, MultiPoint(1, groups(1, 0, 1))) == SUCCESS
    controller.advance()
    assert give(controller, MultiPoint(2, groups(2, 0, 0))) == BUSY  # of itself
    assert [len(points) for points in controller.received] == [3, 2, 2]


def test_the_four_hours_are_not_looked_at_in_messages_for_all_groups() -> None:
    controller = make()
    give(controller, MultiPoint(0, groups(0, 0)))
    late = dc.replace(groups(1, 0)[0], time=14400.0)
    assert give(controller, MultiPoint(1, (late,))) == SUCCESS


def test_a_message_for_no_group_gets_the_reply_before_once_more() -> None:
    controller = make()
    (before,) = controller.handle_motion(point(0, 0).to_message())
    none = Message(2016, 2, 0, bytes(8))
    assert controller.handle_motion(none) == [before]


# ---------------------------------------------------------------- answers


def test_the_header_of_every_reply_says_success() -> None:
    controller = make()
    stream(controller, 2)
    replies = [
        *controller.handle_motion(point(0, 0, positions=(1.0,) * 6).to_message()),
        *controller.handle_motion(dc.replace(point(0, 0), group=5).to_message()),
        *controller.handle_motion(MotionControl(9, 1, Command.CHECK_QUEUE_COUNT).to_message()),
        *controller.handle_motion(MotionControl(0, 1, Command.DISCONNECT).to_message()),
        *controller.handle_motion(Message(77, 2, 0, b"")),
    ]
    controller.pendant.press_e_stop()
    replies += controller.handle_motion(point(0, 2).to_message())
    results = [MotionReply.of(reply).result for reply in replies]
    assert results == [3, 3, 2, 2, 3, 5]
    assert {reply.reply for reply in replies} == {ReplyCode.SUCCESS}


def test_commands_that_are_not_known_get_the_reply_before_once_more() -> None:
    controller = make()
    unknown = MotionControl(0, 77, 200199).to_message()
    for asked in (
        MotionControl(1, 5, Command.CHECK_QUEUE_COUNT).to_message(),
        point(0, 0).to_message(),
        dc.replace(point(0, 0), group=4).to_message(),
        ping(),
    ):
        (before,) = controller.handle_motion(asked)
        assert controller.handle_motion(unknown) == [before]
    assert len(controller.received[0]) == 1  # it is the reply that comes again, not the point


def test_synchrony_is_known_to_the_clopema_controller_alone() -> None:
    controller = make()
    (before,) = controller.handle_motion(ping())
    asked = MotionControl(0, 1, Command.CHECK_SYNCHRO).to_message()
    assert controller.handle_motion(asked) == [before]
    controller = make(synchro=True, depth=3)
    assert ask(controller, Command.CHECK_SYNCHRO) == SUCCESS
    for sequence in (0, 1):
        give(controller, point(0, sequence))
    assert ask(controller, Command.CHECK_SYNCHRO) == (Result.FAILURE, 1)
    for _ in range(5):
        controller.advance()
    assert ask(controller, Command.CHECK_SYNCHRO) == SUCCESS


def test_each_profile_knows_its_own_points_alone() -> None:
    both = MultiPoint(0, groups(0, 0, 1, 2))
    unknown = (Result.INVALID, Subcode.INVALID_TYPE)
    old, new = make(accepts="groups"), make(accepts="ex")
    assert give(old, both) == unknown and give(new, point(0, 0)) == unknown
    assert give(old, point(0, 0)) == SUCCESS == give(new, both)
    assert [m.type for m in old.feedback()] == [15, 15, 15, 13]
    assert [m.type for m in new.feedback()] == [15, 15, 15, 2017, 13]


# ---------------------------------------------------------------- stops


def test_a_stop_empties_all_queues_and_what_was_taken() -> None:
    controller = make()
    stream(controller, 10)
    give(controller, point(0, 10))
    assert ask(controller, Command.STOP_TRAJ_MODE) == (Result.FAILURE, 0)
    assert ask(controller, Command.DISCONNECT) == (Result.FAILURE, 0)
    assert ask(controller, Command.STOP_MOTION) == SUCCESS
    assert controller.queued == (0, 0, 0) and controller.moving
    rest(controller)
    assert controller.queued == (0, 0, 0) and controller.underruns == 0
    assert ask(controller, Command.CHECK_MOTION_READY) == SUCCESS
    assert give(controller, point(1, 0)) == (Result.INVALID, Subcode.INVALID_START)
    here = TrajectoryPoint(1, 0, at(0.0), tuple(controller.positions[7:13]), (0.0,) * 6)
    assert give(controller, here) == SUCCESS


def test_a_queue_that_runs_out_in_motion_is_counted_and_brakes() -> None:
    controller = make()
    stream(controller, 26)
    rest(controller)
    assert controller.underruns == 3  # one of each group
    end, speed = path(25 * STEP)
    way = controller.positions - end
    expected = speed**2 / (2.0 * controller.settings.braking)
    np.testing.assert_allclose(way, expected, rtol=0.02)
    # What comes now goes on from where the axes stand, without a jump.
    before = controller.positions
    assert give(controller, point(0, 26)) == SUCCESS
    controller.advance()
    assert np.abs(controller.positions - before).max() < 0.8 * 0.004 * 1.1


def test_disconnect_is_not_answered_but_in_2013() -> None:
    for firmware, replies in (("1.9.12", 0), ("2013", 1)):
        controller = make(firmware=firmware)
        found = controller.handle_motion(MotionControl(0, 1, Command.DISCONNECT).to_message())
        assert len(found) == replies and not controller.pendant.trajectory_mode


# ---------------------------------------------------------------- the motion connection


@pytest.mark.parametrize("period", [0.004, 0.008])
def test_the_queues_outlive_the_connection(period: float) -> None:
    controller = make(period=period)
    stream(controller, 30)
    run(controller, 0.1)
    waiting = controller.queued
    controller.connection_lost()
    run(controller, 0.5)
    # Its tasks end 50 ms later.
    ran = np.subtract(waiting, controller.queued) * period
    assert ((ran > 0.05 - 1.5 * period) & (ran < 0.05 + 1.5 * period)).all()
    assert min(controller.queued) > 0 and not controller.velocities.any()
    still, left = controller.positions, controller.queued
    status = controller.status
    assert (status.in_motion, status.motion_possible) == (1, 1)
    run(controller, 10.0)
    assert controller.queued == left and np.array_equal(controller.positions, still)
    controller.connection_made()
    controller.advance()
    assert (np.abs(controller.positions - still) > 1e-3).any()  # from standstill, at once
    run(controller, 1.0)
    assert controller.queued == (0, 0, 0)


def test_a_stop_before_time_goes_on_saves_the_arms_from_what_was_left() -> None:
    controller = make()
    stream(controller, 30)
    controller.connection_lost()
    run(controller, 1.0)
    still = controller.positions
    controller.connection_made()
    assert ask(controller, Command.STOP_MOTION) == SUCCESS
    run(controller, 0.5)
    assert np.array_equal(controller.positions, still) and controller.status.in_motion == 0


def test_what_was_taken_last_is_worked_on_for_as_long_as_the_tasks_live() -> None:
    controller = make()
    give(controller, point(0, 0))
    give(controller, point(0, 1))
    controller.connection_lost()
    controller.advance()
    assert controller.queued[0] == 4
    full = make(depth=20)
    give(full, point(0, 0))
    give(full, point(0, 1, time=at(1.0)))
    full.advance()
    full.connection_lost()
    run(full, 0.2)
    assert full.queued[0] in (19, 20)
    full.connection_made()
    run(full, 0.1)
    assert full.queued[0] == 0  # the rest of the point is lost with its task


def test_a_start_that_finds_trajectory_mode_on_leaves_the_queues() -> None:
    controller = make()
    stream(controller, 30)
    controller.connection_lost()
    run(controller, 0.5)
    left = controller.queued
    controller.connection_made()
    assert ask(controller, Command.START_TRAJ_MODE) == SUCCESS
    assert controller.queued == left


def test_what_was_left_is_gone_after_a_stop_on_the_pendant() -> None:
    for clear in (
        lambda c: c.pendant.press_hold(),
        lambda c: c.pendant.set_mode("teach"),
        lambda c: c.pendant.press_e_stop(),
        lambda c: c.pendant.set_remote(False),
    ):
        controller = make()
        stream(controller, 30)
        controller.connection_lost()
        run(controller, 0.5)
        assert controller.status.in_motion == 1
        clear(controller)
        assert controller.status.in_motion == 0
        still = controller.positions
        controller.connection_made()
        run(controller, 0.5)
        assert np.array_equal(controller.positions, still)


# ---------------------------------------------------------------- feedback


def test_feedback_tells_what_was_measured_and_no_time() -> None:
    controller = make()
    q, v = np.arange(13) / 8.0, np.arange(13) / 16.0
    *bodies, whole, status = controller.feedback(q, v)
    told = [FeedbackBody.of(message) for message in bodies]
    assert MultiFeedback.of(whole).groups == tuple(told)
    for body, axes in zip(told, GROUP_AXES, strict=True):
        assert body.positions is not None and body.velocities is not None
        assert body.positions[: len(axes)] == tuple(q[list(axes)])
        assert body.velocities[: len(axes)] == tuple(v[list(axes)])
        assert (body.time, body.valid) == (None, 6)
    assert RobotStatusBody.of(status) == RobotStatusBody(1, 0, 0, 0, 1, 2, 1)  # far from commanded
    stamped = make(stamps=True)
    assert FeedbackBody.of(stamped.feedback()[0]).time == pytest.approx(stamped.time)


@pytest.mark.parametrize("period", [0.004, 0.008])
def test_the_axes_follow_the_command_after_the_delay(period: float) -> None:
    assert VirtualControllerSettings().delay == 0.15
    controller = make(period=period)
    stream(controller, 11)
    run(controller, 0.3)
    commanded = [q for _, q, _ in controller.trace]
    count = round(0.15 / period)
    assert np.array_equal(controller.axis_positions, commanded[-1 - count])
    assert not np.array_equal(controller.axis_positions, commanded[-2])
    told = FeedbackBody.of(controller.feedback()[0]).positions
    assert told is not None
    np.testing.assert_allclose(told[:6], controller.axis_positions[1:7], atol=1e-6)


def test_it_is_in_motion_while_increments_wait_or_the_axes_lag() -> None:
    controller = make()
    assert controller.status.in_motion == 0
    stream(controller, 11)
    while any(controller.queued):
        assert controller.status.in_motion == 1
        controller.advance()
    assert controller.status.in_motion == 1
    controller.stop()
    run(controller, 0.5)
    assert controller.status.in_motion == 0
    # 30 pulses of each axis are near enough.
    for axis, tolerance in ((0, 0.31e-3), (1, 0.365e-3), (12, 1.49e-3)):
        for share, moving in ((0.9, 0), (1.1, 1)):
            measured = controller.positions.copy()
            measured[axis] += share * tolerance
            status = RobotStatusBody.of(controller.feedback(measured)[-1])
            assert status.in_motion == moving, axis


def test_groups_that_the_firmware_does_not_move_are_answered_and_stand_still() -> None:
    controller = make(moved=("r1", "r2"))
    for sequence in range(10):
        assert give(controller, MultiPoint(sequence, groups(sequence, 0, 1, 2))) == SUCCESS
        run(controller, 0.02)
    assert (controller.positions[1:] > START[1:] + 0.01).all()
    assert controller.positions[0] == START[0] and controller.velocities[0] == 0.0
