"""The simulated station behind its ports.

Arms, grippers and cloth, and the plan as the plant runs it.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from unwrinkle.flattening.station_messages import (
    ControllerStatus,
    GripperStatus,
)
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell
from unwrinkle.planning.motion_mode import MotionMode
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.robot.kinematics import Kinematics
from unwrinkle.planning.search.planner import FlatteningPlanner
from unwrinkle.planning.trajectory import Trajectory
from unwrinkle.systems.station.world import StationFaults

Swing = Callable[..., Trajectory]

INPUTS = ("trajectory", "gripper.command", "head.command", "speed_override")
OUTPUTS = (
    "joints.position_measured",
    "joints.velocity_measured",
    "controller.status",
    "gripper.status",
    "head.position_measured",
    "head.left_image",
    "head.right_image",
    "depth_camera.image",
)
TRUTH = ("truth.cloth", "truth.coverage", "truth.height", "truth.tips")


@pytest.fixture(scope="module")
def plan(station_cell: Cell) -> FlatteningPlan:
    from unwrinkle.testing.targets import flattening_task

    made = FlatteningPlanner(station_cell).plan(
        flattening_task((0.0, -1.1), 0.3, half=0.235, pull=0.02)
    )
    assert made.plan is not None and made.plan.dual
    return made.plan


def test_its_ports_are_the_contracts(bench: Any) -> None:
    station = bench.station
    assert station.get_name() == "station"
    inputs = [station.get_input_port(i).get_name() for i in range(station.num_input_ports())]
    outputs = [station.get_output_port(i).get_name() for i in range(station.num_output_ports())]
    assert sorted(inputs) == sorted(INPUTS)
    assert sorted(outputs) == sorted(OUTPUTS + TRUTH)
    sizes = [station.GetOutputPort(name).size() for name in (OUTPUTS[0], OUTPUTS[4], TRUTH[1])]
    assert sizes == [13, 4, 1]
    assert bench.read("truth.coverage")[0] == pytest.approx(1.0, abs=0.01)
    assert bench.read("truth.height")[0] == pytest.approx(0.0, abs=1e-6)
    assert bench.read("controller.status") == ControllerStatus()
    assert "no exposure was taken" in bench.read("head.left_image").reason


@pytest.mark.slow
def test_the_arms_follow_a_plan_and_keep_their_hands_apart(
    bench: Any, station_cell: Cell, plan: FlatteningPlan
) -> None:
    kinematics = Kinematics(station_cell)
    distance = {}
    for segment, event in zip(plan.segments, [*plan.events, None], strict=True):
        status = bench.run(segment.trajectory)
        assert (status.state, status.completed, status.reason) == (
            MotionMode.IDLE,
            bench.number,
            "",
        )
        motion = bench.station.motion_log.last(bench.context)
        assert motion.number == bench.number
        assert motion.following_error < 1e-3  # asked and measured at the same instant
        wanted = segment.trajectory.interpolant()
        clock = motion.times - motion.times[0]
        lags = np.arange(-0.012, 0.0121, 0.001)
        ends = (0.0, segment.trajectory.duration)
        errors = [
            np.abs(motion.measured - wanted(np.clip(clock - lag, *ends))).max() for lag in lags
        ]
        assert min(errors) < 1e-3
        lag = lags[int(np.argmin(errors))]
        if event is not None:
            status_now = bench.grip(*event.closed)
            assert status_now.command == bench.number
            assert status_now.holding == event.closed
        planned = kinematics.tcp_positions(wanted(np.clip(clock - lag, *ends)))
        apart = [
            np.linalg.norm(np.diff(p_WT, axis=-2), axis=-1)
            for p_WT in (kinematics.tcp_positions(motion.measured), planned)
        ]
        distance[segment.name] = np.abs(apart[0] - apart[1]).max()
    assert max(distance.values()) < 3e-3
    limits = station_cell.limits
    whole = bench.station.motion_log.between(bench.context, 0.0)
    assert (whole.measured >= limits.lower - 1e-3).all()
    assert (whole.measured <= limits.upper + 1e-3).all()
    assert (np.abs(whole.velocities) <= 1.02 * limits.velocity).all()


def test_a_trajectory_from_elsewhere_is_refused(bench: Any, swing: Swing) -> None:
    there = bench.read("joints.position_measured")
    status = bench.run(swing(there + 2e-3), 0.1)
    assert status.state == MotionMode.IDLE and status.command == 1 and status.completed == 0
    assert "mrad off its start" in status.reason
    np.testing.assert_allclose(bench.read("joints.position_measured"), there, atol=1e-6)
    assert bench.run(swing(there)).completed == 2  # the next one is taken


def test_a_hold_brakes_on_the_path(bench: Any, swing: Swing) -> None:
    start = bench.read("joints.position_measured")
    assert bench.run(swing(start), 0.45).state == MotionMode.RUNNING
    assert bench.run(None, 0.05).state == MotionMode.HOLDING
    bench.go(1.5)
    status = bench.read("controller.status")
    assert (status.state, status.completed) == (
        MotionMode.IDLE,
        2,
    ) and "hold commanded" in status.reason
    moved = bench.read("joints.position_measured") - start
    assert 0.1 < moved[1] < 0.4
    np.testing.assert_allclose(np.delete(moved, 1), 0.0, atol=1e-4)
    np.testing.assert_allclose(bench.read("joints.velocity_measured"), 0.0, atol=1e-6)


def test_the_override_slows_and_pauses(bench: Any, swing: Swing) -> None:
    port = bench.station.GetInputPort("speed_override")
    port.FixValue(bench.context, [0.5])
    start = bench.read("joints.position_measured")
    assert bench.run(swing(start), 1.5).state == MotionMode.RUNNING  # planned for one second
    fastest = np.abs(bench.station.motion_log.last(bench.context).velocities).max()
    assert fastest == pytest.approx(0.5 * 1.875 * 0.4, rel=0.02)
    port.FixValue(bench.context, [0.0])
    bench.go(1.0)
    before = bench.read("controller.status").progress
    bench.go(0.2)
    assert bench.read("controller.status").progress == before < 1.0
    port.FixValue(bench.context, [1.0])
    bench.go(1.0)
    assert bench.read("controller.status").completed == 1


def test_a_dead_axis_is_a_fault(bench: Any, swing: Swing) -> None:
    start = bench.read("joints.position_measured")
    plant = bench.station.plant
    joint = plant.GetJointByName("joint_l", plant.GetModelInstanceByName("r1"))
    bench.run(swing(start, axis=2), 0.3)
    joint.Lock(plant.GetMyMutableContextFromRoot(bench.context))
    bench.go(1.5)
    status = bench.read("controller.status")
    assert status.state == MotionMode.FAULT and "following error" in status.reason
    assert "in fault" in bench.run(swing(start), 0.1).reason


def test_the_cloth_goes_with_the_gripper_that_holds_it(bench: Any, plan: FlatteningPlan) -> None:
    approach, pull, _ = (segment.trajectory for segment in plan.segments)
    assert bench.run(approach).completed == bench.number
    before = bench.read("truth.cloth")
    assert before.asleep
    status = bench.grip(True, True)
    assert status.closed == status.holding == (True, True)
    thickness = bench.station.cloth.material.thickness
    assert status.opening == pytest.approx((thickness, thickness), abs=1e-4)
    assert bench.run(pull).completed == bench.number
    after = bench.read("truth.cloth")
    tips = bench.read("truth.tips").reshape(2, 4, 4)
    for hand, grip in enumerate(after.grips):
        p_TN = (after.positions[:, grip.nodes].T - tips[hand, :3, 3]) @ tips[hand, :3, :3]
        np.testing.assert_allclose(p_TN, grip.p_TN, atol=2e-4)
        moved = after.positions[:, grip.nodes] - before.positions[:, grip.nodes]
        assert np.linalg.norm(moved, axis=0).max() > 0.01
    status = bench.grip(False, False)
    assert status.holding == status.closed == (False, False)
    assert status.opening == pytest.approx((0.030, 0.030), abs=1e-3)
    assert bench.read("truth.cloth").grips == (None, None)
    bench.go(3.0)
    assert bench.read("truth.cloth").asleep


def test_a_gripper_without_cloth_closes_and_says_so(bench: Any) -> None:
    assert bench.grip(True, True, 0.2).command == 0  # it takes half a second
    assert bench.read("gripper.status").opening == pytest.approx((0.019, 0.019), abs=0.002)
    bench.go(0.7)
    status: GripperStatus = bench.read("gripper.status")
    assert status.command == 1 and status.closed == (True, True)
    assert status.holding == (False, False)
    assert status.opening == pytest.approx((0.0, 0.0), abs=1e-4)
    assert bench.grip(False, False).closed == (False, False)


def test_one_gripper_alone(bench: Any) -> None:
    status = bench.grip(True, False)
    assert status.command == 1 and status.closed == (True, False)
    assert status.opening == pytest.approx((0.0, 0.030), abs=1e-3)


def test_a_scripted_miss_misses_once(make_bench: Callable[..., Any], plan: FlatteningPlan) -> None:
    bench = make_bench(faults=StationFaults(misses=frozenset({1})))
    assert bench.run(plan.segments[0].trajectory).completed == 1
    missed = bench.grip(True, True)
    assert missed.closed == (True, True) and missed.holding == (False, False)
    bench.grip(False, False)
    assert bench.grip(True, True).holding == (True, True)


def test_asleep_nothing_is_computed(bench: Any) -> None:
    first = bench.read("truth.cloth")
    bench.go(1.0)
    last = bench.read("truth.cloth")
    assert last is first and last.asleep
    motion = bench.station.motion_log.between(bench.context, 0.5)
    assert len(motion.times) == pytest.approx(125, abs=2) and motion.number == 0
    assert len(bench.station.motion_log.last(bench.context).times) == 0


def test_two_stations_move_alike(make_bench: Callable[..., Any], plan: FlatteningPlan) -> None:
    ends = []
    for _ in range(2):
        bench = make_bench()
        bench.run(plan.segments[0].trajectory)
        bench.grip(True, True)
        bench.run(plan.segments[1].trajectory)
        ends.append((bench.read("joints.position_measured"), bench.read("truth.cloth")))
    assert (ends[0][0] == ends[1][0]).all()
    assert (ends[0][1].positions == ends[1][1].positions).all()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"start": np.zeros(12)}, "13 finite angles"),
        ({"start": np.full(13, 3.4)}, "beyond the limit"),
        ({"faults": StationFaults(cameras={1: "upside down"})}, "unknown"),
    ],
)
def test_absurd_stations_are_refused(
    make_bench: Callable[..., Any], options: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        make_bench(**options)
