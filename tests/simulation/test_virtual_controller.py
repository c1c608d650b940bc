"""The virtual controller: start of trajectory mode, checks of points, interpolation, stops, modes, I/O."""

import dataclasses as dc
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from unwrinkle.hardware.wire import (
    Command,
    FeedbackBody,
    Message,
    MotionControl,
    MotionReply,
    MultiFeedback,
    MultiPoint,
    Result,
    RobotStatusBody,
    Subcode,
    TrajectoryPoint,
)
from unwrinkle.simulation.virtual_controller import (
    GROUP_AXES,
    VirtualController,
    VirtualControllerSettings,
)

LOWER, UPPER = np.full(13, -2.0), np.full(13, 2.5)
VELOCITY = np.linspace(3.0, 4.0, 13)
START = np.linspace(-0.3, 0.3, 13)
STEP = 0.02
SIZES = (6, 6, 1)


def make(started: bool = True, **changes: object) -> VirtualController:
    settings = dc.replace(VirtualControllerSettings(), **changes)
    controller = VirtualController(settings, START, (LOWER, UPPER, VELOCITY))
    if started:
        controller.handle_motion(MotionControl(-1, 0, Command.START_TRAJ_MODE).to_message())
        while controller.starting:
            controller.advance()
        assert [MotionReply.of(m).result for m in controller.late_replies()] == [Result.SUCCESS]
    return controller


def ask(controller: VirtualController, command: int, group: int = -1) -> tuple[int, int]:
    (reply,) = controller.handle_motion(MotionControl(group, 4, command).to_message())
    told = MotionReply.of(reply)
    assert (told.group, told.sequence, told.command) == (group, 4, command)
    return told.result, told.subcode


def path(t: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Half a radian there and back within 2 s, at rest at both ends."""
    w = np.pi
    away = 0.25 * (1.0 - np.cos(w * t))
    return START + away, np.full(13, 0.25 * w * np.sin(w * t))


def point(group: int, sequence: int, **changes: object) -> TrajectoryPoint:
    """The path's point of one group."""
    q, v = path(sequence * STEP)
    axes = list(GROUP_AXES[group])
    whole = TrajectoryPoint(group, sequence, sequence * STEP, tuple(q[axes]), tuple(v[axes]))
    return dc.replace(whole, **changes)


def give(controller: VirtualController, body: TrajectoryPoint | MultiPoint) -> tuple[int, int]:
    (reply,) = controller.handle_motion(body.to_message())
    told = MotionReply.of(reply)
    return told.result, told.subcode


def stream(controller: VirtualController, count: int, wait: bool = True) -> int:
    """Send points of all groups, waiting where it is busy; how often it was."""
    busy = 0
    for sequence in range(count):
        for group in range(3):
            while (answer := give(controller, point(group, sequence))) == (Result.BUSY, 0) and wait:
                controller.advance()
                busy += 1
            assert answer == (Result.SUCCESS, 0), (sequence, group)
    return busy


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
    start = MotionControl(-1, 3, Command.START_TRAJ_MODE).to_message()
    assert controller.handle_motion(start) == []
    servo = ready = 0.0
    while controller.starting:
        controller.advance()
        servo = servo or (controller.time if controller.servo else 0.0)
    ready = controller.time
    (reply,) = controller.late_replies()
    assert MotionReply.of(reply).sequence == 3
    assert servo == pytest.approx(0.1, abs=0.005) and ready == pytest.approx(0.15, abs=0.005)
    assert ask(controller, Command.CHECK_MOTION_READY) == (Result.SUCCESS, 0)
    assert ask(controller, Command.START_TRAJ_MODE) == (Result.SUCCESS, 0)
    assert controller.late_replies() == []


@pytest.mark.parametrize(
    ("break_it", "code"),
    [
        (lambda c: c.press_e_stop(), Subcode.NOT_READY_E_STOP),
        (lambda c: c.set_mode("teach"), Subcode.NOT_READY_NOT_PLAY),
        (lambda c: c.set_remote(False), Subcode.NOT_READY_NOT_REMOTE),
        (lambda c: c.press_hold(), Subcode.NOT_READY_HOLD),
        (lambda c: c.raise_alarm(4107, lasting=True), Subcode.NOT_READY_ALARM),
    ],
)
def test_a_start_is_refused_and_motion_stopped(
    break_it: Callable[[VirtualController], None], code: int
) -> None:
    controller = make(started=False)
    break_it(controller)
    assert ask(controller, Command.START_TRAJ_MODE) == (Result.NOT_READY, code)
    assert controller.status.motion_possible == 0
    moving = make()
    stream(moving, 5)
    for _ in range(10):
        moving.advance()
    before = moving.positions
    break_it(moving)
    assert sum(moving.queued) == 0
    assert give(moving, point(0, 5)) == (Result.NOT_READY, code)
    rest(moving)
    # Braking: less than v^2 / 2a and a period.
    assert 0.0 < np.abs(moving.positions - before).max() < 0.8**2 / 20.0 + 0.8 * 0.004
    assert not moving.velocities.any()


def test_a_start_under_way_fails_with_the_reason() -> None:
    controller = make(started=False)
    controller.handle_motion(MotionControl(-1, 3, Command.START_TRAJ_MODE).to_message())
    controller.advance()
    controller.press_e_stop()
    controller.advance()
    (reply,) = controller.late_replies()
    told = MotionReply.of(reply)
    assert (told.result, told.subcode) == (Result.NOT_READY, Subcode.NOT_READY_E_STOP)
    assert not controller.servo


def test_a_start_resets_an_alarm_that_does_not_last() -> None:
    controller = make()
    controller.raise_alarm(4107)
    assert controller.status.error_code == 4107 and controller.status.drives_powered == 0
    controller.handle_motion(MotionControl(-1, 3, Command.START_TRAJ_MODE).to_message())
    assert controller.starting and controller.status.in_error == 0


# ---------------------------------------------------------------- points


def test_it_follows_the_cubics_between_the_points() -> None:
    controller = make()
    begin = controller.time
    busy = stream(controller, 101)
    rest(controller)
    assert busy > 0  # 0.8 s of increments fit into the queue
    assert controller.underruns == 0
    ran = [(t - begin, q) for t, q, _ in controller.trace if t > begin]
    assert len(ran) >= 500
    for t, q in ran:
        # A cubic between samples of a cosine, 20 ms apart.
        np.testing.assert_allclose(q, path(min(t, 2.0))[0], atol=1e-7)
    np.testing.assert_allclose(controller.positions, START, atol=1e-7)


def test_points_between_the_increments_are_reached_and_left_in_time() -> None:
    controller = make()
    q = [tuple(START[1:7] + 1e-3 * k) for k in range(3)]
    ran = []
    for sequence in range(3):
        ramp = TrajectoryPoint(0, sequence, 5.0 + 0.01 * sequence, q[sequence], (0.1,) * 6)
        assert give(controller, ramp) == (Result.SUCCESS, 0)
        for _ in range(3 if sequence else 0):
            controller.advance()
            ran.append(float(controller.positions[1] - START[1]))
    # 4, 8 and 10 ms; then 4 and 8 ms later, and the end.
    np.testing.assert_allclose(ran, [4e-4, 8e-4, 1e-3, 1.4e-3, 1.8e-3, 2e-3], atol=1e-7)
    assert controller.underruns == 0


def test_speeds_are_the_derivative_and_never_above_the_limit() -> None:
    controller = make()
    stream(controller, 101)
    rest(controller)
    q = np.array([q for _, q, _ in controller.trace])
    v = np.array([v for _, _, v in controller.trace])
    between = np.diff(q, axis=0) / controller.settings.period
    np.testing.assert_allclose(between, 0.5 * (v[1:] + v[:-1]), atol=2e-4)
    assert (np.abs(v) <= VELOCITY).all()


def test_a_queue_holds_two_hundred_increments() -> None:
    controller = make()
    for sequence in range(60):
        if give(controller, point(0, sequence)) == (Result.BUSY, 0):
            break
    assert controller.queued == (200, 0, 0)
    assert give(controller, point(0, sequence)) == (Result.BUSY, 0)
    assert ask(controller, Command.CHECK_QUEUE_COUNT, 0) == (Result.SUCCESS, 200)
    assert ask(controller, Command.CHECK_QUEUE_COUNT, 1) == (Result.SUCCESS, 0)


def test_all_groups_in_one_message_are_taken_together_or_not_at_all() -> None:
    controller = make()
    groups = tuple(point(g, 0).point for g in range(3))
    assert give(controller, MultiPoint(0, groups)) == (Result.SUCCESS, 0)
    late = tuple(point(g, 1).point for g in range(3))
    bad = (*late[:2], dc.replace(late[2], positions=(9.0,)))
    assert give(controller, MultiPoint(1, bad)) == (Result.INVALID, Subcode.INVALID_POSITION)
    assert [len(points) for points in controller.received] == [1, 1, 1]
    missing = MultiPoint(1, late[:2])
    assert give(controller, missing) == (Result.INVALID, Subcode.INVALID_GROUP)
    twice = MultiPoint(1, (late[0], late[0], late[2]))
    assert give(controller, twice) == (Result.INVALID, Subcode.INVALID_GROUP)
    assert give(controller, MultiPoint(1, late[::-1])) == (Result.SUCCESS, 0)
    assert controller.points == 2
    assert controller.received[1][-1].positions == pytest.approx(path(STEP)[0][7:13])


@pytest.mark.parametrize(
    ("sequence", "changes", "code"),
    [
        (1, {"time": None}, Subcode.INVALID_INSUFFICIENT),
        (1, {"positions": None}, Subcode.INVALID_INSUFFICIENT),
        (1, {"velocities": None}, Subcode.INVALID_INSUFFICIENT),
        (2, {}, Subcode.INVALID_SEQUENCE),
        (-1, {}, Subcode.INVALID_SEQUENCE),
        (1, {"time": 0.0}, Subcode.INVALID_TIME),
        (1, {"time": -1.0}, Subcode.INVALID_TIME),
        (1, {"time": 14400.0}, Subcode.INVALID_TIME),
        (1, {"positions": (2.6,) * 6}, Subcode.INVALID_POSITION),
        (1, {"velocities": (0.0,) * 5 + (3.7,)}, Subcode.INVALID_SPEED),
        (1, {"positions": tuple(START[1:7] + 0.2)}, Subcode.INVALID_SPEED),
        (1, {"positions": (0.0,) * 7 + (0.1,)}, Subcode.INVALID_DATA),
        (0, {"velocities": (0.0,) * 5 + (3.7,)}, Subcode.INVALID_SPEED),
        (1, {"group": 3}, Subcode.INVALID_GROUP),
        (1, {"group": -1}, Subcode.INVALID_GROUP),
    ],
)
def test_points_that_cannot_be_are_refused(
    sequence: int, changes: dict[str, object], code: int
) -> None:
    controller = make()
    give(controller, point(0, 0))
    wrong = dc.replace(point(0, abs(sequence)), sequence=sequence, **changes)
    assert give(controller, wrong) == (Result.INVALID, code)
    assert len(controller.received[0]) == 1
    assert give(controller, point(0, 1)) == (Result.SUCCESS, 0)


def test_a_cubic_that_leaves_the_limits_between_its_points_is_refused() -> None:
    controller = VirtualController(
        VirtualControllerSettings(), UPPER - 1e-3, (LOWER, UPPER, VELOCITY)
    )
    controller.servo = controller.trajectory_mode = True
    near = tuple((UPPER - 1e-3)[:6])
    first = TrajectoryPoint(0, 0, 0.0, near, (0.5,) * 6)
    assert give(controller, first) == (Result.SUCCESS, 0)
    second = TrajectoryPoint(0, 1, 0.1, near, (-0.5,) * 6)
    assert give(controller, second) == (Result.INVALID, Subcode.INVALID_POSITION)


def test_not_finite_numbers_are_refused() -> None:
    controller = make()
    good = point(0, 0).to_message()
    for offset in range(12, 136, 4):
        body = bytearray(good.body)
        body[offset : offset + 4] = b"\0\0\xc0\x7f"
        (reply,) = controller.handle_motion(Message(good.type, 2, 0, bytes(body)))
        told = MotionReply.of(reply)
        assert told.result == Result.INVALID or offset >= 96  # accelerations are not given
        if told.result == Result.INVALID:
            assert told.subcode in (Subcode.INVALID_DATA, Subcode.INVALID_TIME)
    assert np.array_equal(controller.positions, START)


def test_the_first_point_has_to_be_within_thirty_pulses() -> None:
    controller = make()
    tolerance = 30.0 / 30000.0
    for off, answer in (
        (1.01 * tolerance, (Result.INVALID, Subcode.INVALID_START)),
        (0.99 * tolerance, (Result.SUCCESS, 0)),
    ):
        away = START[1:7].copy()
        away[4] += off
        assert give(controller, point(0, 0, positions=tuple(away))) == answer


# ---------------------------------------------------------------- stops


def test_a_stop_empties_all_queues_and_the_next_point_is_a_first_one() -> None:
    controller = make()
    stream(controller, 10)
    for _ in range(20):
        controller.advance()
    assert ask(controller, Command.STOP_TRAJ_MODE) == (Result.FAILURE, 0)
    assert ask(controller, Command.STOP_MOTION) == (Result.SUCCESS, 0)
    assert controller.queued == (0, 0, 0) and controller.moving
    assert give(controller, point(0, 0)) == (Result.BUSY, 0)  # still braking
    rest(controller)
    assert give(controller, point(1, 10)) == (Result.INVALID, Subcode.INVALID_SEQUENCE)
    assert give(controller, point(1, 0)) == (Result.INVALID, Subcode.INVALID_START)
    here = TrajectoryPoint(1, 0, 0.0, tuple(controller.positions[7:13]), (0.0,) * 6)
    assert give(controller, here) == (Result.SUCCESS, 0)
    assert controller.underruns == 0
    assert ask(controller, Command.STOP_TRAJ_MODE) == (Result.SUCCESS, 0)
    assert give(controller, here) == (Result.NOT_READY, Subcode.NOT_READY_WAITING_ROS)


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
    assert give(controller, point(0, 26)) == (Result.SUCCESS, 0)
    controller.advance()
    assert np.abs(controller.positions - before).max() < 0.8 * 0.004 * 1.1


def test_synchrony_is_known_to_the_clopema_controller_alone() -> None:
    assert ask(make(), Command.CHECK_SYNCHRO) == (Result.INVALID, Subcode.INVALID_COMMAND)
    controller = make(synchro=True, depth=3)
    assert ask(controller, Command.CHECK_SYNCHRO) == (Result.SUCCESS, 0)
    for sequence in (0, 1):
        give(controller, point(0, sequence))
    assert ask(controller, Command.CHECK_SYNCHRO) == (Result.FAILURE, 1)
    for _ in range(5):
        controller.advance()
    assert ask(controller, Command.CHECK_SYNCHRO) == (Result.SUCCESS, 0)


# ---------------------------------------------------------------- profiles, feedback


def test_each_profile_knows_its_own_points_alone() -> None:
    both = MultiPoint(0, tuple(point(g, 0).point for g in range(3)))
    unknown = (Result.INVALID, Subcode.INVALID_TYPE)
    old, new = make(accepts="groups"), make(accepts="ex")
    assert give(old, both) == unknown and give(new, point(0, 0)) == unknown
    assert give(old, point(0, 0)) == (Result.SUCCESS, 0) == give(new, both)
    assert [m.type for m in old.feedback()] == [15, 15, 15, 13]
    assert [m.type for m in new.feedback()] == [15, 15, 15, 2017, 13]


def test_feedback_tells_what_was_measured() -> None:
    controller = make()
    q, v = np.arange(13) / 8.0, np.arange(13) / 16.0
    *groups, whole, status = controller.feedback(q, v)
    bodies = [FeedbackBody.of(message) for message in groups]
    assert MultiFeedback.of(whole).groups == tuple(bodies)
    for body, axes in zip(bodies, GROUP_AXES, strict=True):
        assert body.positions is not None and body.velocities is not None
        assert body.positions[: len(axes)] == tuple(q[list(axes)])
        assert body.velocities[: len(axes)] == tuple(v[list(axes)])
        assert body.time == pytest.approx(controller.time)
    assert RobotStatusBody.of(status) == RobotStatusBody(1, 0, 0, 0, 0, 2, 1)
    assert FeedbackBody.of(make(stamps=False).feedback()[0]).time is None


def test_motion_is_told_to_be_possible_early_or_when_it_is() -> None:
    told = []
    for early in (True, False):
        controller = make(started=False, possible_early=early)
        told.append(controller.status.motion_possible)
        assert make(possible_early=early).status.motion_possible == 1
    assert told == [1, 0]
