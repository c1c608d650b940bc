"""Export of a plan as ROS `trajectory_msgs/JointTrajectory`.

The points are the samples that `unwrinkle execute` sends at the plan's own speed: positions in rad
and velocities in rad/s of every axis, at whole milliseconds. Between two points the motion is the
cubic through both, which is also what ROS's `joint_trajectory_controller` makes of positions and
velocities. No accelerations are given: a controller that is sent accelerations interpolates with
quintics, another motion than the one that was verified.

A plan has one trajectory per segment (approach, pull, release), each from rest to rest with its own
clock from 0. The grippers act between the segments; a JointTrajectory has no place for them, so
they are listed apart, each with the segment that must have ended.
"""

from pathlib import Path
from typing import Any

from unwrinkle.models.errors import InputError
from unwrinkle.models.io.files import atomic_path, write_json
from unwrinkle.models.robot import Cell
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.sent_samples import as_sent

JOINT_TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
#: Frame of the message's header: joint angles have none, tools expect a name.
_FRAME = "world"
_NANOSECONDS = 1_000_000_000


def joint_trajectory(plan: FlatteningPlan, cell: Cell) -> dict[str, Any]:
    """Return a plan as plain values.

    Args:
        plan: made for the cell.
        cell: for the names of the axes.

    Returns:
        `segments`: each with `name` and `trajectory`, in the fields of JointTrajectory; `grippers`:
        each with `after_segment`, `closed` (right, left) and `dwell` in s; the plan's hash and
        speed.

    Raises:
        InputError: the plan was made for another cell.
    """
    plan.check_made_for(cell)
    segments = []
    for segment in plan.segments:
        sent = as_sent(segment.trajectory)
        points = [
            {
                "positions": position.tolist(),
                "velocities": velocity.tolist(),
                "accelerations": [],
                "effort": [],
                "time_from_start": _duration(float(time)),
            }
            for time, position, velocity in zip(
                sent.times, sent.positions, sent.velocities, strict=True
            )
        ]
        trajectory = {
            "header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": _FRAME},
            "joint_names": list(cell.robot.axes),
            "points": points,
        }
        segments.append({"name": segment.name, "trajectory": trajectory})
    return {
        "format": "unwrinkle joint trajectories",
        "plan_hash": plan.content_hash,
        "robot": plan.robot,
        "speed": plan.speed,
        "units": {"positions": "rad", "velocities": "rad/s", "time_from_start": "s and ns"},
        "segments": segments,
        "grippers": _grippers(plan),
    }


def export_trajectory(plan: FlatteningPlan, cell: Cell, path: str | Path) -> int:
    """Write a plan as JointTrajectory: JSON (`.json`) or MCAP (`.mcap`).

    The MCAP file has one topic per segment, `/NAME/joint_trajectory`, in ROS 2's encoding (CDR),
    and `/grippers` in JSON. A message's stamp is the segment's begin on the plan's clock.

    Args:
        plan: made for the cell.
        cell: for the names of the axes.
        path: file to write, atomically.

    Returns:
        The number of points.

    Raises:
        InputError: the plan was made for another cell, the suffix is another, the packages of the
            extra `mcap` are not installed, or the file cannot be written.
    """
    path = Path(path)
    values = joint_trajectory(plan, cell)
    if path.suffix == ".json":
        write_json(path, values)
    elif path.suffix == ".mcap":
        _write_mcap(path, values, [segment.start for segment in plan.segments])
    else:
        raise InputError(f"{path}: give a file *.json or *.mcap for a plan")
    return sum(len(segment["trajectory"]["points"]) for segment in values["segments"])


def _grippers(plan: FlatteningPlan) -> list[dict[str, Any]]:
    """List the gripper events, each after the segment that ends when it begins."""
    found = []
    for event in plan.events:
        before = max((s for s in plan.segments if s.end <= event.time + 1e-6), key=lambda s: s.end)
        found.append(
            {"after_segment": before.name, "closed": list(event.closed), "dwell": event.dwell}
        )
    return found


def _duration(seconds: float) -> dict[str, int]:
    sec, nanosec = divmod(round(seconds * _NANOSECONDS), _NANOSECONDS)
    return {"sec": sec, "nanosec": nanosec}


def _write_mcap(path: Path, values: dict[str, Any], starts: list[float]) -> None:
    import json

    try:
        from mcap.writer import Writer
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise InputError(
            "MCAP export needs further packages; install them with: pip install 'unwrinkle[mcap]'"
        ) from None
    store = get_typestore(Stores.ROS2_HUMBLE)
    definition, _ = store.generate_msgdef(JOINT_TRAJECTORY, ros_version=2)
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2", library="unwrinkle")
        schema = writer.register_schema(JOINT_TRAJECTORY, "ros2msg", definition.encode())
        for number, (segment, start) in enumerate(zip(values["segments"], starts, strict=True)):
            topic = f"/{segment['name']}/joint_trajectory"
            channel = writer.register_channel(topic, "cdr", schema)
            message = _message(store, segment["trajectory"])
            data = bytes(store.serialize_cdr(message, JOINT_TRAJECTORY))
            stamp = round(start * _NANOSECONDS)
            writer.add_message(channel, stamp, data, stamp, number)
        text = json.dumps({"type": "object", "title": "grippers"}).encode()
        channel = writer.register_channel(
            "/grippers", "json", writer.register_schema("grippers", "jsonschema", text)
        )
        grippers = json.dumps({"grippers": values["grippers"]}).encode()
        writer.add_message(channel, 0, grippers, 0, len(values["segments"]))
        facts = {key: str(values[key]) for key in ("plan_hash", "robot", "speed")}
        writer.add_metadata("plan", facts)
        writer.finish()  # type: ignore[no-untyped-call,unused-ignore]


def _message(store: Any, trajectory: dict[str, Any]) -> Any:
    """Return a trajectory as rosbags' message."""
    import numpy as np

    types = store.types
    time = types["builtin_interfaces/msg/Time"](**trajectory["header"]["stamp"])
    header = types["std_msgs/msg/Header"](stamp=time, frame_id=trajectory["header"]["frame_id"])
    points = [
        types["trajectory_msgs/msg/JointTrajectoryPoint"](
            **{
                name: np.array(point[name], dtype=np.float64)
                for name in ("positions", "velocities", "accelerations", "effort")
            },
            time_from_start=types["builtin_interfaces/msg/Duration"](**point["time_from_start"]),
        )
        for point in trajectory["points"]
    ]
    return types[JOINT_TRAJECTORY](
        header=header, joint_names=trajectory["joint_names"], points=points
    )
