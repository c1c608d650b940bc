"""Faults while the driver runs a trajectory.

What stops, how, what the user reads, and that it latches.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from unwrinkle.hardware.controller_state import JointFeedback
from unwrinkle.hardware.motoros.messages import Command
from unwrinkle.hardware.run_log.protocol import NoLog
from unwrinkle.planning.trajectory import Trajectory
from unwrinkle.simulation.controllers.controller import VirtualControllerSettings
from unwrinkle.simulation.controllers.server import ServerFault

pytestmark = pytest.mark.alone

TrajectoryMaker = Callable[..., Trajectory]
RigMaker = Callable[..., Any]

_POINTS = 60


def run_into(rig: Any, trajectory: Trajectory) -> None:
    """Run until a fault is latched, and on until nothing moves."""
    rig.connect()
    rig.run(trajectory)
    rig.until(lambda: rig.state == "fault")
    rig.wait(1.5)
    assert rig.state == "fault" and not rig.driver.braking
    assert not (rig.controller.velocities.any() or rig.controller.axis_velocities.any())


def distance(rig: Any, trajectory: Trajectory) -> float:
    """Of where the controller ended from the trajectory's path, rad."""
    path = trajectory.interpolant()(np.linspace(0.0, trajectory.duration, 50_000))
    return float(np.abs(path - rig.controller.positions).max(axis=1).min())


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("close_state", "state connection has ended"),
        ("silent_state", "feedback is 0.25 s old"),
        ("garbage", "garbage on the state connection"),
        ("huge_length", "garbage on the state connection (length"),
        ("wrong_type", "unknown type"),
        ("groups", "feedback of the groups [0, 1]"),
    ],
)
def test_what_blinds_the_driver_brakes_along_the_path(
    make_rig: RigMaker, make_trajectory: TrajectoryMaker, kind: str, words: str
) -> None:
    trajectory = make_trajectory(2)
    rig = make_rig(faults=(ServerFault(kind, points=_POINTS),), lag=0.02)
    run_into(rig, trajectory)
    assert words in rig.reason
    assert distance(rig, trajectory) < 2e-4
    assert rig.controller.underruns == 0
    assert Command.STOP_MOTION not in rig.sent_commands()
    assert rig.driver.status.completed == 0


@pytest.mark.parametrize(
    ("kind", "value", "words"),
    [
        ("freeze", 0.0, "off its path"),
        ("offset", 0.05, "r1_r is 0.02"),
        ("jump", 0.4, "of r1_r jumped by"),
        ("wrap", 0.0, "r1_r stands at"),
        ("nan", 0.0, "r1_r is not a finite number"),
        ("degrees", 0.0, "are these degrees?"),
        ("delay", 0.16, "off its path"),
        ("wrong_sequence", 0.0, "where point"),
        ("garbage", 1.0, "garbage on the motion connection"),
        ("busy", 0.0, "it has been busy"),
        ("not_ready", 5007, "hold is pressed"),
        ("e_stop", 0.0, "emergency stop is pressed"),
        ("e_stop_released", 0.1, "emergency stop is pressed"),
        ("teach", 0.0, "play"),
        ("remote_off", 0.0, "remote"),
        ("servo_off", 0.0, "servos are off"),
        ("alarm", 4100, "alarm"),
        ("hold", 0.0, "hold"),
    ],
)
def test_what_else_goes_wrong_stops_all_groups_at_once(
    make_rig: RigMaker, make_trajectory: TrajectoryMaker, kind: str, value: float, words: str
) -> None:
    trajectory = make_trajectory(2)
    fault = ServerFault(kind, points=_POINTS, value=value, axis=4)
    rig = make_rig(faults=(fault,), lag=0.02)
    run_into(rig, trajectory)
    assert words in rig.reason
    # The last that the controller received, and only once.
    assert rig.sent_commands().count(Command.STOP_MOTION) == 1
    assert rig.sent_commands()[-1] == Command.STOP_MOTION
    number = rig.next_number()
    rig.driver.run(number, trajectory)
    assert rig.state == "fault" and rig.driver.status.command == number
    rig.driver.resume(rig.next_number())
    rig.driver.hold(rig.next_number())
    rig.wait(0.5)
    assert rig.state == "fault" and words in rig.reason and not rig.controller.moving
    assert not rig.controller.audit.findings


@pytest.mark.parametrize("kind", ["close_motion", "close_all", "silent", "silent_motion", "slow"])
def test_without_a_motion_connection_nothing_moves_for_long(
    make_rig: RigMaker, make_trajectory: TrajectoryMaker, kind: str
) -> None:
    trajectory = make_trajectory(2)
    rig = make_rig(faults=(ServerFault(kind, points=_POINTS),), lag=0.02)
    run_into(rig, trajectory)
    assert any(
        words in rig.reason for words in ("connection has ended", "silent about", "too slow")
    )
    left = sum(rig.controller.queued)
    if kind.startswith("close"):
        assert left > 0 and "press HOLD on the pendant before anything connects" in rig.reason
    else:
        assert left == 0
    rig.driver.reset()
    if kind.startswith("close"):
        assert rig.state == "fault" and "connect again" in rig.reason


@pytest.mark.parametrize("kind", ["duplicate", "reorder", "tiny_buffers", "lost_outputs"])
@pytest.mark.parametrize("profile", ["groups", "ex"])
def test_what_is_harmless_changes_nothing(
    make_rig: RigMaker, make_trajectory: TrajectoryMaker, kind: str, profile: str
) -> None:
    trajectory = make_trajectory(2)
    rig = make_rig(faults=(ServerFault(kind, at=0.2),), lag=0.02, profile=profile)
    rig.connect()
    number = rig.run(trajectory)
    rig.until(lambda: rig.state != "running")
    assert rig.state == "ready" and rig.driver.status.completed == number
    received = rig.received().positions
    assert np.array_equal(received[1:], np.float32(trajectory.positions))


def test_latency_below_the_declared_one_is_no_fault(
    make_rig: RigMaker, make_trajectory: TrajectoryMaker
) -> None:
    rig = make_rig(faults=(ServerFault("delay", points=_POINTS, value=0.07),), lag=0.02)
    rig.connect()
    rig.run(make_trajectory(2))
    rig.until(lambda: rig.state != "running")
    assert rig.state == "ready", rig.reason
    assert rig.driver.status.lag > 0.05


def test_single_bytes_are_put_together(
    make_rig: RigMaker, make_trajectory: TrajectoryMaker
) -> None:
    rig = make_rig(faults=(ServerFault("split"),))
    rig.connect()
    rig.driver.set_override(0.2)
    number = rig.run(make_trajectory(2, reach=0.1))
    rig.until(lambda: rig.state != "running", 60.0)
    assert rig.state == "ready" and rig.driver.status.completed == number, rig.reason


def test_a_fault_latches_until_a_reset_and_a_new_plan(
    make_rig: RigMaker, make_trajectory: TrajectoryMaker
) -> None:
    trajectory = make_trajectory(2)
    rig = make_rig(lag=0.02)
    rig.connect()
    rig.run(trajectory)
    rig.wait(0.5)
    rig.controller.pendant.raise_alarm(4100)
    rig.until(lambda: rig.state == "fault")
    rig.driver.reset()
    assert "not reset: the robot moves" in rig.reason
    rig.wait(1.0)
    rig.driver.reset()
    rig.until(lambda: rig.state == "ready", 8.0)
    assert rig.reason == "" and Command.RESET_ALARM in rig.sent_commands()
    rig.run(trajectory, "old")
    assert "(old) refused" in rig.reason and "plan from where it stands" in rig.reason
    here = rig.driver.feedback.positions
    number = rig.run(make_trajectory(3, reach=0.1, start=here))
    rig.until(lambda: rig.state == "ready")
    assert rig.driver.status.completed == number
    assert rig.sent_commands().count(Command.START_TRAJ_MODE) == 2


def test_a_reset_ends_with_its_connection(make_rig: RigMaker) -> None:
    rig = make_rig()
    rig.connect()
    rig.driver.fail("the first")
    rig.driver.reset()
    rig.driver.close()
    rig.turn()
    rig.connect()
    assert rig.state == "ready"
    rig.driver.fail("the second")
    rig.wait(0.5)
    assert rig.state == "fault" and rig.reason == "the second"


def test_a_reset_waits_for_the_emergency_stop_to_be_released(
    make_rig: RigMaker, make_trajectory: TrajectoryMaker
) -> None:
    rig = make_rig(lag=0.02)
    rig.connect()
    rig.run(make_trajectory(2))
    rig.wait(0.5)
    rig.controller.pendant.press_e_stop()
    rig.wait(1.0)
    assert rig.state == "fault"
    rig.driver.reset()
    rig.wait(0.5)
    assert rig.state == "fault" and "not reset: an emergency stop is pressed" in rig.reason
    rig.controller.pendant.release_e_stop()
    rig.wait(0.5)
    assert rig.state == "fault"
    stood = rig.controller.positions
    rig.driver.reset()
    rig.wait(0.5)
    assert rig.state == "ready"
    assert np.array_equal(rig.controller.positions, stood)


@pytest.mark.parametrize("setting", ["e_stop", "teach", "alarm"])
def test_a_robot_that_may_not_move_is_shown_and_refused(
    make_rig: RigMaker, make_trajectory: TrajectoryMaker, setting: str
) -> None:
    rig = make_rig(faults=(ServerFault(setting, value=4100),))
    rig.connect()
    assert rig.state == "ready"
    assert rig.driver.status.robot is not None and rig.driver.status.robot.problem
    rig.run(make_trajectory(2))
    assert rig.state == "ready" and "refused" in rig.reason
    assert rig.driver.status.robot.problem in rig.reason
    assert rig.sent_commands() == []


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (ServerFault("remote_off"), "remote"),
        (ServerFault("not_ready", value=5008), "job is not started"),
        (ServerFault("hold"), "is hold pressed"),  # the firmware names the servos first
    ],
)
def test_a_start_that_the_controller_refuses(
    make_rig: RigMaker, make_trajectory: TrajectoryMaker, fault: ServerFault, words: str
) -> None:
    rig = make_rig(faults=(fault,))
    rig.connect()
    rig.run(make_trajectory(2))
    assert rig.state == "ready" and "refused" in rig.reason and words in rig.reason
    assert not rig.controller.received[0]


def test_servos_that_never_come_on_are_a_fault(
    make_rig: RigMaker, make_trajectory: TrajectoryMaker
) -> None:
    settings = VirtualControllerSettings(servo_time=100.0)
    rig = make_rig(settings=settings, start_timeout=3.0)
    rig.connect()
    rig.run(make_trajectory(2))
    assert rig.state == "fault" and "has not answered command 200121" in rig.reason


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (ServerFault("degrees"), "degrees"),
        (ServerFault("nan"), "not a finite number"),
        (ServerFault("groups"), "compare the site's groups"),
        (ServerFault("groups", value=0.3, axis=7), "more than 6 axes"),
        (ServerFault("silent"), "no feedback has come"),
    ],
)
def test_the_handshake_refuses_what_does_not_fit(
    make_rig: RigMaker, make_trajectory: TrajectoryMaker, fault: ServerFault, words: str
) -> None:
    rig = make_rig(faults=(fault,))
    start = np.full(13, 0.4)
    for group, axes in zip(rig.controller._groups, rig_groups(), strict=True):
        group.positions = start[list(axes)]
    rig.measured = start.copy()
    rig.connect()
    assert rig.state == "fault" and words in rig.reason
    rig.driver.run(1, make_trajectory(2))
    rig.wait(0.2)
    assert rig.sent_commands() == [] and rig.state == "fault"


def rig_groups() -> tuple[tuple[int, ...], ...]:
    from unwrinkle.simulation.controllers.controller import GROUP_AXES

    return GROUP_AXES


@pytest.mark.parametrize("gap", [0.06, 0.30, 5.0])
def test_a_late_poll_sends_no_burst(
    make_rig: RigMaker, make_trajectory: TrajectoryMaker, gap: float
) -> None:
    trajectory = make_trajectory(2)
    rig = make_rig(lag=0.02)
    rig.connect()
    rig.run(trajectory)
    rig.wait(0.5)
    for _ in range(round(gap / 0.004)):  # the controller goes on, the driver sleeps
        rig.time += 0.004
        rig.server.poll(rig.time, rig.controller.axis_positions)
    rig.measured = rig.controller.axis_positions
    before = len(rig.controller.received[0])
    rig.turn()
    rig.turn()
    assert rig.driver.status.late == 1
    if gap < rig.site.lead:
        assert len(rig.controller.received[0]) - before <= 2
        rig.until(lambda: rig.state != "running")
        assert rig.state == "ready" and rig.controller.underruns == 0
    else:
        assert rig.state == "fault" and "nothing is sent late" in rig.reason
        assert len(rig.controller.received[0]) == before
        assert rig.sent_commands()[-1] == Command.STOP_MOTION


def test_too_many_late_polls_are_a_fault(
    make_rig: RigMaker, make_trajectory: TrajectoryMaker
) -> None:
    trajectory = make_trajectory(2)
    rig = make_rig(late_budget=3)
    rig.connect()
    rig.run(trajectory)
    for _ in range(6):
        rig.wait(0.1)
        rig.turn(0.06)
    assert rig.state == "fault" and "polled late 4 times" in rig.reason
    rig.wait(1.0)
    assert distance(rig, trajectory) < 2e-4 and rig.controller.underruns == 0


class FullDisk(NoLog):
    """A log that cannot be written after so many sets of feedback."""

    def __init__(self, most: int) -> None:
        self.left = most

    def measured(self, now: float, feedback: JointFeedback) -> None:
        self.left -= 1
        if self.left < 0:
            raise OSError(28, "No space left on device")


def test_a_log_that_cannot_be_written(make_rig: RigMaker, make_trajectory: TrajectoryMaker) -> None:
    trajectory = make_trajectory(2)
    rig = make_rig(log=FullDisk(40))
    run_into(rig, trajectory)
    assert "the log cannot be written: No space left on device" in rig.reason
    assert distance(rig, trajectory) < 2e-4 and rig.controller.underruns == 0
    rig.driver.reset()
    assert "not reset: the log" in rig.reason
    early = make_rig(log=FullDisk(0))
    early.connect()
    early.wait(0.1)
    early.driver.run(1, trajectory)
    early.wait(0.5)
    assert early.state == "fault" and early.sent_commands() == []


def test_a_controller_that_knows_no_synchrony_is_named(
    make_rig: RigMaker, make_trajectory: TrajectoryMaker
) -> None:
    rig = make_rig(synchro="start")
    rig.connect()
    rig.run(make_trajectory(2))
    assert rig.state == "ready" and "synchro: off" in rig.reason


@pytest.mark.parametrize("synchro", ["start", "each"])
def test_synchrony_is_asked_for(
    make_rig: RigMaker, make_trajectory: TrajectoryMaker, synchro: str
) -> None:
    settings = VirtualControllerSettings(synchro=True)
    rig = make_rig(settings=settings, synchro=synchro)
    rig.connect()
    rig.driver.set_override(0.2)
    number = rig.run(make_trajectory(2))
    rig.until(lambda: rig.state != "running", 60.0)
    assert rig.state == "ready" and rig.driver.status.completed == number, rig.reason
    asked = rig.sent_commands().count(Command.CHECK_SYNCHRO)
    assert asked == 1 if synchro == "start" else asked > 100


def test_the_heartbeat_finds_a_silent_motion_connection(
    make_rig: RigMaker, make_trajectory: TrajectoryMaker
) -> None:
    rig = make_rig(faults=(ServerFault("silent_motion", at=8.0),))
    rig.connect()
    rig.run(make_trajectory(2))
    rig.until(lambda: rig.state == "ready")
    rig.until(lambda: rig.state == "fault", 12.0)
    assert "has not answered command 200101" in rig.reason
