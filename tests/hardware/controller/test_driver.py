"""The driver against the virtual controller, over TCP on loopback, on one clock."""

import threading
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import ArrayLike

from unwrinkle.hardware.motoros.messages import Command
from unwrinkle.hardware.motoros.tcp_link import TcpLink
from unwrinkle.hardware.run_log.protocol import NoLog
from unwrinkle.hardware.streaming.sent_cubics import StreamLimits
from unwrinkle.planning.trajectory import Trajectory, rate_extremes
from unwrinkle.simulation.controllers.server import ServerFault

pytestmark = pytest.mark.alone

TrajectoryMaker = Callable[..., Trajectory]


@pytest.mark.parametrize("profile", ["groups", "ex"])
def test_a_trajectory_runs_to_its_end(
    make_rig, make_trajectory: TrajectoryMaker, profile: str
) -> None:
    rig = make_rig(profile=profile)
    rig.connect()
    assert rig.state == "ready", rig.reason
    assert rig.sent_commands() == []
    trajectory = make_trajectory(1)
    number = rig.run(trajectory, "approach")
    assert rig.state == "running", rig.reason
    rig.until(lambda: rig.state != "running")
    assert rig.state == "ready", rig.reason
    assert rig.driver.status.completed == number
    assert rig.controller.underruns == 0
    assert np.abs(rig.controller.positions - trajectory.positions[-1]).max() < 1e-6
    received = rig.received()
    # The first point, a point of rest, then the plan's own samples.
    assert np.array_equal(received.positions[1:], np.float32(trajectory.positions))
    assert np.array_equal(received.velocities[1:], np.float32(trajectory.velocities))
    assert np.allclose(np.diff(received.times[1:]), np.diff(trajectory.times), atol=1e-6)
    assert rig.sent_commands() == [Command.START_TRAJ_MODE, Command.CHECK_MOTION_READY]
    assert rig.driver.status.following_error < 1e-3


def test_hold_resume_and_speed(make_rig, make_trajectory: TrajectoryMaker) -> None:
    rig = make_rig(lag=0.03)
    rig.connect()
    trajectory = make_trajectory(2)
    rig.driver.set_override(0.5)
    run = rig.run(trajectory)
    rig.wait(0.4 * trajectory.duration)
    hold = rig.next_number()
    rig.driver.hold(hold)
    assert rig.state == "holding"
    took = rig.until(lambda: rig.state != "holding")
    assert rig.state == "held" and took < 1.0
    assert rig.driver.status.completed == hold
    rig.wait(0.5)
    path = trajectory.interpolant()
    place = rig.driver.status.progress
    assert 0.0 < place < trajectory.duration
    assert np.abs(path(place) - rig.controller.positions).max() < 1e-6
    resume = rig.next_number()
    rig.driver.resume(resume)
    rig.wait(0.1)
    rig.driver.set_override(1.0)
    rig.until(lambda: rig.state == "ready")
    assert rig.driver.status.completed == resume > run
    assert rig.controller.underruns == 0
    assert np.abs(rig.controller.positions - trajectory.positions[-1]).max() < 1e-6
    # Wherever it was in between, it was on the path.
    fine = path(np.linspace(0.0, trajectory.duration, 20_000))
    for _, positions, _ in list(rig.controller.trace)[::20]:
        assert np.abs(fine - positions).max(axis=1).min() < 1e-3


@pytest.mark.parametrize("turns", [0, 1, 3, 6, 9, 12, 20, 40])
def test_a_hold_at_the_very_begin(make_rig, make_trajectory: TrajectoryMaker, turns: int) -> None:
    rig = make_rig()
    rig.connect()
    trajectory = make_trajectory(2)
    rig.run(trajectory)
    for _ in range(turns):
        rig.turn()
    rig.driver.hold(rig.next_number())
    rig.until(lambda: rig.state != "holding", 2.0)
    assert rig.state == "held", rig.reason
    for _ in range(2):  # a change of mind at rest
        rig.driver.resume(rig.next_number())
        rig.turn()
        rig.driver.hold(rig.next_number())
        rig.until(lambda: rig.state != "holding", 2.0)
        assert rig.state == "held", rig.reason
    rig.driver.resume(rig.next_number())
    rig.until(lambda: rig.state != "running")
    assert rig.state == "ready" and rig.controller.underruns == 0, rig.reason
    assert np.abs(rig.controller.positions - trajectory.positions[-1]).max() < 1e-6


def test_speed_zero_stands_still_and_goes_on(make_rig, make_trajectory: TrajectoryMaker) -> None:
    rig = make_rig()
    rig.connect()
    trajectory = make_trajectory(3)
    number = rig.run(trajectory)
    rig.wait(0.3)
    rig.driver.set_override(0.0)
    rig.wait(1.5)
    assert rig.state == "running" and not rig.controller.moving
    for bad in (float("nan"), 1.5, -1.0):
        rig.driver.set_override(bad)
        assert "refused" in rig.reason and rig.driver.status.override == 0.0
    rig.driver.set_override(0.2)
    rig.wait(0.5)
    rig.driver.set_override(1.0)
    rig.until(lambda: rig.state != "running")
    assert rig.driver.status.completed == number
    assert rig.controller.underruns == 0


def test_two_trajectories_keep_their_pause(make_rig, make_trajectory: TrajectoryMaker) -> None:
    rig = make_rig()
    rig.connect()
    first = make_trajectory(4)
    rig.run(first)
    rig.until(lambda: rig.state == "ready")
    done = rig.time
    rig.run(make_trajectory(5, reach=0.1, start=first.positions[-1]))
    assert rig.state == "running", rig.reason
    assert rig.time - done >= rig.site.pause
    rig.until(lambda: rig.state == "ready")
    assert rig.driver.status.completed == 2
    # Servos and trajectory mode are kept.
    assert rig.sent_commands().count(Command.START_TRAJ_MODE) == 1


def test_what_cannot_run_is_refused(make_rig, make_trajectory: TrajectoryMaker) -> None:
    rig = make_rig()
    rig.connect()
    good = make_trajectory(6)
    fast = Trajectory(0.5 * good.times, good.positions, 2.0 * good.velocities)
    away = Trajectory(good.times, good.positions + 0.0012, good.velocities)
    moving = Trajectory(good.times[:40], good.positions[:40], good.velocities[40:80])
    beyond = Trajectory(good.times, good.positions + 4.0, good.velocities)
    for trajectory, words in (
        (fast, "beyond its limit"),
        (away, "1.20 mrad off on"),
        (moving, "start and end at rest"),
        (beyond, "position of"),
    ):
        rig.run(trajectory, "bad")
        assert rig.state == "ready"
        assert words in rig.reason and f"trajectory {rig.number} (bad) refused" in rig.reason
    assert rig.sent_commands() == []
    rig.run(good)
    rig.driver.run(rig.next_number(), good)
    assert "refused: the driver is running" in rig.reason and rig.state == "running"
    rig.driver.run(1, good)  # a number that was seen
    assert rig.driver.status.command == rig.number
    rig.until(lambda: rig.state == "ready")
    assert rig.controller.underruns == 0


def test_stop_leaves_trajectory_mode(make_rig, make_trajectory: TrajectoryMaker) -> None:
    rig = make_rig()
    rig.connect()
    rig.run(make_trajectory(7))
    rig.wait(0.4)
    rig.driver.stop("the page was closed")
    assert rig.state == "stopping"
    rig.until(lambda: rig.state == "ready")
    assert not rig.controller.pendant.trajectory_mode and rig.controller.underruns == 0
    assert rig.reason == "the page was closed"
    rig.driver.resume(rig.next_number())
    assert "nothing to resume" in rig.reason


def test_stop_while_starting_and_while_held(make_rig, make_trajectory: TrajectoryMaker) -> None:
    rig = make_rig()
    rig.connect()
    rig.driver.run(1, make_trajectory(7))
    rig.wait(0.05)
    assert rig.state == "starting"
    rig.driver.stop("no more")
    rig.until(lambda: rig.state == "ready")
    assert not rig.controller.pendant.trajectory_mode and not rig.controller.received[0]
    rig.driver.run(2, make_trajectory(7))
    rig.until(lambda: rig.state == "running")
    rig.wait(0.3)
    rig.driver.hold(3)
    rig.until(lambda: rig.state == "held")
    rig.driver.stop("no more")
    rig.until(lambda: rig.state == "ready")
    assert not rig.controller.pendant.trajectory_mode
    rig.driver.stop("again")
    rig.until(lambda: rig.state == "ready")
    assert rig.sent_commands().count(Command.STOP_TRAJ_MODE) == 2


def test_closing_in_motion_stops_all_groups(make_rig, make_trajectory: TrajectoryMaker) -> None:
    rig = make_rig()
    rig.connect()
    rig.run(make_trajectory(7))
    rig.wait(0.6)
    over = threading.Event()

    def serve() -> None:
        while not over.wait(0.001):
            rig.time += 0.004
            rig.server.poll(rig.time)

    server = threading.Thread(target=serve, daemon=True)
    server.start()
    rig.driver.close()
    assert rig.state == "offline" and not rig.driver.links
    over.set()
    server.join(5.0)
    assert Command.STOP_MOTION in rig.sent_commands()
    assert not rig.server.motion and not rig.controller.queued[0]
    rig.driver.poll(rig.time)
    rig.driver.hold(99)
    rig.driver.run(100, make_trajectory(7))
    assert "refused: the driver is offline" in rig.reason


@pytest.mark.parametrize("profile", ["groups", "ex"])
def test_what_a_dead_connection_left_in_the_queues_is_never_run(
    make_rig, make_trajectory: TrajectoryMaker, profile: str
) -> None:
    rig = make_rig(faults=(ServerFault("close_all", points=60),), profile=profile)
    rig.connect()
    rig.run(make_trajectory(2))
    rig.until(lambda: rig.state == "fault")
    rig.wait(1.0)
    assert min(rig.controller.queued) > 0 and rig.server.motion == []
    stood = rig.controller.positions
    for _ in range(3):  # however often somebody tries
        rig.driver.close()
        rig.connect()
        assert rig.state == "fault" and "motion" not in rig.driver.links
        assert "motion left in its queues" in rig.reason and "HOLD" in rig.reason
        rig.run(make_trajectory(3, reach=0.1, start=stood))
        rig.wait(0.5)
    assert np.array_equal(rig.controller.positions, stood)
    # The firmware itself runs what is left as soon as anybody connects.
    link = TcpLink.connect("127.0.0.1", rig.server.ports[0], 1.0, "a stranger")
    rig.wait(0.02)
    assert np.abs(rig.controller.positions - stood).max() > 0.01
    link.close()


def test_a_driver_connects_again_once_the_queues_are_empty(
    make_rig, make_trajectory: TrajectoryMaker
) -> None:
    rig = make_rig(faults=(ServerFault("close_all", points=60),))
    rig.connect()
    rig.run(make_trajectory(2))
    rig.until(lambda: rig.state == "fault")
    rig.wait(1.0)
    rig.controller.pendant.press_hold()  # the firmware empties its queues
    rig.wait(0.1)
    rig.controller.pendant.release_hold()
    rig.driver.close()
    rig.connect()
    assert rig.state == "ready" and rig.reason == ""
    here = rig.driver.feedback.positions
    number = rig.run(make_trajectory(3, reach=0.1, start=here))
    rig.until(lambda: rig.state != "running")
    assert rig.driver.status.completed == number, rig.reason


def test_a_hold_before_motion_ends_the_start(make_rig, make_trajectory: TrajectoryMaker) -> None:
    rig = make_rig()
    rig.connect()
    rig.driver.run(1, make_trajectory(8))
    rig.wait(0.05)
    assert rig.state == "starting"
    rig.driver.hold(2)
    rig.wait(1.0)
    assert rig.state == "ready" and rig.driver.status.completed == 2
    assert not rig.controller.received[0]
    rig.driver.run(3, make_trajectory(8))
    rig.until(lambda: rig.driver.status.completed == 3)
    assert rig.state == "ready"


def test_inputs_and_outputs(make_rig) -> None:
    rig = make_rig()
    rig.connect()
    rig.controller.inputs[25010] = 1
    rig.driver.write_output(10010, 1)
    rig.driver.read_input(25010)
    rig.driver.read_input(25010)
    rig.wait(0.1)
    assert rig.controller.outputs[10010] == 1
    assert rig.driver.outputs_written == {10010: 1}
    assert rig.driver.inputs == {25010: 1}
    rig.driver.write_output(20010, 1)
    rig.wait(0.1)
    assert rig.driver.outputs_written[20010] is None
    assert "20010 cannot be written" in rig.driver.io_problem


class Commanded(NoLog):
    """Keeps the points that were sent."""

    def __init__(self) -> None:
        self.points: list[tuple[float, np.ndarray, np.ndarray]] = []

    def commanded(
        self,
        now: float,
        number: int,
        sequence: int,
        time: float,
        positions: ArrayLike,
        velocities: ArrayLike,
    ) -> None:
        self.points.append((time, np.array(positions), np.array(velocities)))


@pytest.mark.parametrize("seed", range(8))
def test_limits_are_kept_through_random_commands(
    make_rig, make_trajectory: TrajectoryMaker, stream_limits: StreamLimits, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    log = Commanded()
    profile = ("groups", "ex")[seed % 2]
    rig = make_rig(log=log, profile=profile, lag=rng.uniform(0.002, 0.02))
    rig.connect()
    trajectory = make_trajectory(seed)
    rig.driver.set_override(float(rng.choice([1.0, 0.5, 0.2, 0.1])))
    rig.run(trajectory)
    for _ in range(rng.integers(1, 10)):
        rig.wait(rng.uniform(0.0, 0.5))
        choice = rng.integers(4)
        if choice == 0:
            rig.driver.hold(rig.next_number())
        elif choice == 1:
            rig.driver.resume(rig.next_number())
        else:
            rig.driver.set_override(float(rng.choice([1.0, 0.2, 0.05, 0.0, rng.uniform()])))
    rig.driver.set_override(1.0)

    def ended() -> bool:
        if rig.state == "held":
            rig.driver.resume(rig.next_number())
        return rig.state not in ("running", "holding", "held")

    rig.until(ended)
    assert rig.state == "ready", rig.reason
    assert rig.controller.underruns == 0
    assert np.abs(rig.controller.positions - trajectory.positions[-1]).max() < 1e-6
    times, positions, velocities = (np.array(values) for values in zip(*log.points, strict=True))
    own = rate_extremes(trajectory.times, trajectory.positions, trajectory.velocities)
    assert stream_limits.widened(own).keeps(rate_extremes(times, positions, velocities))


@pytest.mark.parametrize("before", [0.25, 0.12, 0.0, -0.1])
def test_a_gap_of_feedback_near_the_end_does_not_lose_the_end(
    make_rig, make_trajectory: TrajectoryMaker, before: float
) -> None:
    rig = make_rig()
    rig.connect()
    trajectory = make_trajectory(2)
    number = rig.run(trajectory)
    begin = rig.time
    rig.until(lambda: rig.time >= begin + trajectory.duration + 0.104 - before)
    now = rig.time - 100.0
    rig.server.commit(ServerFault("silent_state", at=now, until=now + 0.15))
    rig.wait(2.0)
    if rig.state == "held":
        number = rig.next_number()
        rig.driver.resume(number)
        rig.wait(2.0)
    assert rig.state == "ready" and rig.driver.status.completed == number, rig.driver.status
    assert rig.reason == ""
