"""Resets after a fault, starts that the controller refuses, synchrony and the heartbeat.

What every fault of the catalogue leaves behind is tested in tests/robustness.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from unwrinkle.hardware.motoros.messages import Command
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


@pytest.mark.parametrize("kind", ["close_motion", "silent_motion"])
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
