"""A plan as JointTrajectory: read back with an independent decoder of ROS 2's encoding."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from unwrinkle.exports.joint_trajectory import export_trajectory, joint_trajectory
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell, load_cell
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.sent_samples import as_sent

Main = Callable[..., int]


def test_json_holds_the_samples_that_are_sent(
    plan: FlatteningPlan, cell: Cell, tmp_path: Path
) -> None:
    path = tmp_path / "plan.json"
    count = export_trajectory(plan, cell, path)
    values = json.loads(path.read_text())
    assert values == joint_trajectory(plan, cell)
    assert [item["name"] for item in values["segments"]] == ["approach", "pull", "release"]
    assert values["plan_hash"] == plan.content_hash
    points = [item["trajectory"]["points"] for item in values["segments"]]
    assert sum(map(len, points)) == count
    for segment, item in zip(plan.segments, values["segments"], strict=True):
        sent = as_sent(segment.trajectory)
        assert item["trajectory"]["joint_names"] == cell.robot.axes
        found = item["trajectory"]["points"]
        np.testing.assert_array_equal([p["positions"] for p in found], sent.positions)
        np.testing.assert_array_equal([p["velocities"] for p in found], sent.velocities)
        times = [p["time_from_start"] for p in found]
        np.testing.assert_allclose([t["sec"] + 1e-9 * t["nanosec"] for t in times], sent.times)
        assert all(p["accelerations"] == [] for p in found)


def test_grippers_are_listed_apart(plan: FlatteningPlan, cell: Cell) -> None:
    assert joint_trajectory(plan, cell)["grippers"] == [
        {"after_segment": "approach", "closed": [True, True], "dwell": 0.75},
        {"after_segment": "pull", "closed": [False, False], "dwell": 0.75},
    ]


def test_mcap_is_read_by_another_decoder(plan: FlatteningPlan, cell: Cell, tmp_path: Path) -> None:
    reader = pytest.importorskip("mcap_ros2.reader")
    pytest.importorskip("rosbags")
    path = tmp_path / "plan.mcap"
    export_trajectory(plan, cell, path)
    topics = [f"/{segment.name}/joint_trajectory" for segment in plan.segments]
    found = {m.channel.topic: m for m in reader.read_ros2_messages(path, topics=topics)}
    for topic, segment in zip(topics, plan.segments, strict=True):
        message, sent = found[topic].ros_msg, as_sent(segment.trajectory)
        assert found[topic].schema.name == "trajectory_msgs/msg/JointTrajectory"
        assert found[topic].log_time_ns == round(1e9 * segment.start)
        assert list(message.joint_names) == cell.robot.axes
        np.testing.assert_array_equal([p.positions for p in message.points], sent.positions)
        np.testing.assert_array_equal([p.velocities for p in message.points], sent.velocities)
        stamps = [p.time_from_start for p in message.points]
        np.testing.assert_allclose([t.sec + 1e-9 * t.nanosec for t in stamps], sent.times)


def test_a_plan_of_another_cell_is_refused(plan: FlatteningPlan, tmp_path: Path) -> None:
    from unwrinkle.models.scenario import load_scenario

    other = load_cell(load_scenario(settings=("clearance.arm_arm=0.05",)))
    with pytest.raises(InputError):
        export_trajectory(plan, other, tmp_path / "plan.json")
    assert not list(tmp_path.iterdir())


def test_another_suffix_is_refused(plan: FlatteningPlan, cell: Cell, tmp_path: Path) -> None:
    with pytest.raises(InputError):
        export_trajectory(plan, cell, tmp_path / "plan.bag")
    assert not list(tmp_path.iterdir())


def test_the_command_refuses_a_plan_that_is_not_verified(
    plan: FlatteningPlan, main: Main, tmp_path: Path
) -> None:
    plan.save(tmp_path / "plan.npz")  # a wave, not a flattening motion
    assert main("export", "plan", tmp_path / "plan.npz", "--out", tmp_path / "plan.json") == 3
    assert not (tmp_path / "plan.json").exists()
