"""Export of a run log to MCAP with Foxglove's own schemas, so that it opens without a converter.

| topic | schema | content |
|---|---|---|
| `/measured`, `/commanded` | `foxglove.JointStates` | positions, rad, velocities, rad/s |
| `/tf` | `foxglove.FrameTransforms` | bodies in the frame `world`, as measured; m |
| `/scene` | `foxglove.SceneUpdate` | shapes of the cell; the garment and the target of the plan |
| `/log` | `foxglove.Log` | events |
| `/points`, `/status` | JSON | place of the sent points in their trajectory; states of the driver |

The grippers are shown as commanded. Stamps are the wall clock of the computer that wrote the log.
"""

import datetime
import json
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from unwrinkle.hardware.run_log.reader import RunLogRecords
from unwrinkle.logs.replay import measured_track
from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import InputError
from unwrinkle.models.io.files import atomic_path
from unwrinkle.models.robot import Cell
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.viewer.cell_bodies import BodyShape, CellBodies, quaternion
from unwrinkle.viewer.plan_shapes import target_shapes, wrinkle_shapes

#: Frame of the world.
WORLD = "world"
#: Events that are problems; the others are information.
_PROBLEMS = ("fault", "hold", "refused", "late", "lost", "stop")

#: Time on the log's clock, s, topic and message.
_Message = tuple[float, str, Any]


def export_foxglove(
    records: RunLogRecords, path: str | Path, cell: Cell, plan: FlatteningPlan | None = None
) -> int:
    """Write an MCAP file of a run log with Foxglove's schemas.

    Args:
        records: records of the log.
        path: file to write, atomically.
        cell: cell of the log, for the robot's shape.
        plan: executed plan, for the garment and the target; None if it is unavailable.

    Returns:
        The number of messages.

    Raises:
        InputError: the packages of the extra `mcap` are not installed, or the file cannot be
            written.
    """
    try:
        import foxglove.messages  # noqa: F401
        from mcap.writer import Writer
    except ImportError:
        raise InputError(
            "MCAP export needs further packages; install them with: pip install 'unwrinkle[mcap]'"
        ) from None
    zero = wall_clock(records)
    messages = sorted(_messages(records, cell, plan, zero), key=lambda message: message[0])
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="", library="unwrinkle")
        channels: dict[str, int] = {}
        for number, (time, topic, message) in enumerate(messages):
            if topic not in channels:
                channels[topic] = _channel(writer, topic, message)
            stamp = stamp_of(zero + time)
            data = json.dumps(message).encode() if isinstance(message, dict) else message.encode()
            writer.add_message(channels[topic], stamp, data, stamp, number)
        writer.add_metadata("run", {key: str(value) for key, value in records.header.items()})
        writer.finish()  # type: ignore[no-untyped-call,unused-ignore]
    return len(messages)


def wall_clock(records: RunLogRecords) -> float:
    """Return the seconds from 1970 to time 0 of the log's monotonic clock.

    They are 0 if the header lacks them.
    """
    begun, clock = records.header.get("begun"), records.header.get("clock")
    if not isinstance(begun, str) or not isinstance(clock, int | float):
        return 0.0
    try:
        return datetime.datetime.fromisoformat(begun).timestamp() - float(clock)
    except ValueError:
        return 0.0


def stamp_of(seconds: float) -> int:
    """Return a time since 1970, s, in whole nanoseconds."""
    return max(round(1e9 * seconds), 0)


def _channel(writer: Any, topic: str, message: Any) -> int:
    """Register a channel with the schema of its first message."""
    if isinstance(message, dict):
        schema = json.dumps({"type": "object", "title": topic.strip("/")}).encode()
        number = writer.register_schema(topic.strip("/"), "jsonschema", schema)
        return int(writer.register_channel(topic, "json", number))
    found = type(message).get_schema()
    number = writer.register_schema(found.name, found.encoding, found.data)
    return int(writer.register_channel(topic, found.encoding, number))


def _messages(
    records: RunLogRecords, cell: Cell, plan: FlatteningPlan | None, zero: float
) -> Iterator[_Message]:
    names = [str(name) for name in records.header.get("axes", cell.robot.axes)]
    yield from _joints(records, names, zero)
    yield from _events(records, zero)
    yield from _robot(records, cell, zero)
    if plan is not None:
        yield records.begin, "/scene", _garment(plan, _clock(zero)(records.begin))


def _clock(zero: float) -> Callable[[float], Any]:
    """Return a function from a time on the log's clock, s, to Foxglove's time stamp."""
    from foxglove.messages import Timestamp

    def stamp(time: float) -> Any:
        return Timestamp(*divmod(stamp_of(zero + time), 10**9))

    return stamp


def _joints(records: RunLogRecords, names: list[str], zero: float) -> Iterator[_Message]:
    from foxglove.messages import JointState, JointStates

    stamp = _clock(zero)
    for topic, part in (("/commanded", records.commanded), ("/measured", records.measured)):
        for time, row, rate in zip(part.times, part.positions, part.velocities, strict=True):
            joints = [
                JointState(name=name, position=_or_none(angle), velocity=_or_none(speed))
                for name, angle, speed in zip(names, row, rate, strict=True)
            ]
            yield float(time), topic, JointStates(timestamp=stamp(float(time)), joints=joints)
    sent = records.commanded
    for i, time in enumerate(sent.times):
        point = {
            "command": int(sent.numbers[i]),
            "sequence": int(sent.sequences[i]),
            "trajectory_time": _or_none(sent.point_times[i]),
        }
        yield float(time), "/points", point


def _events(records: RunLogRecords, zero: float) -> Iterator[_Message]:
    from foxglove.messages import Log, LogLevel

    stamp = _clock(zero)
    for status in records.statuses:
        yield status.time, "/status", _finite(dict(status.fields))
    for event in records.events:
        problem = any(word in event.kind for word in _PROBLEMS)
        text = f"{event.kind}: {event.text}"
        if event.data:
            text += f" {json.dumps(_finite(event.data))}"
        yield (
            event.time,
            "/log",
            Log(
                timestamp=stamp(event.time),
                level=LogLevel.Warning if problem else LogLevel.Info,
                name="unwrinkle",
                message=text,
            ),
        )


def _robot(records: RunLogRecords, cell: Cell, zero: float) -> Iterator[_Message]:
    """Yield the cell's shapes, and its bodies' poses for every measured posture."""
    from foxglove.messages import (
        FrameTransform,
        FrameTransforms,
        Quaternion,
        SceneUpdate,
        Vector3,
    )

    try:
        track = measured_track(records, cell)
    except InputError:  # no motion to show
        return
    bodies, stamp = CellBodies(cell), _clock(zero)
    begin = records.begin
    entities = [
        _entity(name, shapes, stamp(begin))
        for name, shapes in zip(bodies.names, bodies.shapes, strict=True)
    ]
    yield begin, "/scene", SceneUpdate(entities=entities)
    for i, time in enumerate(track.times):
        at = track.begin + float(time)
        poses = bodies.poses(track.positions[i], track.openings[i])
        yield (
            at,
            "/tf",
            FrameTransforms(
                transforms=[
                    FrameTransform(
                        timestamp=stamp(at),
                        parent_frame_id=WORLD,
                        child_frame_id=name,
                        translation=Vector3(**dict(zip("xyz", map(float, row[:3]), strict=True))),
                        rotation=Quaternion(**dict(zip("xyzw", map(float, row[3:]), strict=True))),
                    )
                    for name, row, moves in zip(bodies.names, poses, bodies.moving, strict=True)
                    if moves or i == 0
                ]
            ),
        )


def _entity(name: str, shapes: list[BodyShape], stamp: Any) -> Any:
    from foxglove.messages import (
        Color,
        CubePrimitive,
        CylinderPrimitive,
        SceneEntity,
        SpherePrimitive,
        Vector3,
    )

    kinds: dict[str, list[Any]] = {"box": [], "cylinder": [], "ellipsoid": []}
    for shape in shapes:
        common = {
            "pose": _pose(shape.X_BG),
            "size": Vector3(x=shape.size[0], y=shape.size[1], z=shape.size[2]),
            "color": Color(**dict(zip("rgba", shape.colour, strict=True))),
        }
        if shape.kind == "cylinder":
            kinds["cylinder"].append(CylinderPrimitive(**common, bottom_scale=1.0, top_scale=1.0))
        else:
            made = CubePrimitive if shape.kind == "box" else SpherePrimitive
            kinds[shape.kind].append(made(**common))
    return SceneEntity(
        timestamp=stamp,
        frame_id=name,
        id=name,
        frame_locked=True,
        cubes=kinds["box"],
        cylinders=kinds["cylinder"],
        spheres=kinds["ellipsoid"],
    )


def _garment(plan: FlatteningPlan, stamp: Any) -> Any:
    """Return the observed garment, the wrinkle and the target as a scene in the world."""
    from foxglove.messages import SceneEntity, SceneUpdate

    meshes = [
        _triangles(vertices, faces, _rgba(colour))
        for _, (vertices, faces), colour in (*wrinkle_shapes(plan), *target_shapes(plan))
    ]
    garment = plan.garment
    if garment is not None:
        colours = np.column_stack([garment.colours / 255.0, np.ones(len(garment.colours))])
        meshes.append(_triangles(garment.p_WV, garment.triangles, colours))
    entity = SceneEntity(timestamp=stamp, frame_id=WORLD, id="plan", triangles=meshes)
    return SceneUpdate(entities=[entity])


def _triangles(vertices: Any, faces: Any, colours: Array) -> Any:
    """Return triangles of one colour (4,), or of one colour per vertex (V, 4)."""
    from foxglove.messages import Color, Point3, TriangleListPrimitive

    made = [Color(**dict(zip("rgba", map(float, c), strict=True))) for c in np.atleast_2d(colours)]
    return TriangleListPrimitive(
        pose=_pose(np.eye(4)),
        points=[Point3(x=float(x), y=float(y), z=float(z)) for x, y, z in vertices],
        indices=[int(i) for i in np.ravel(faces)],
        color=made[0],
        colors=made if len(made) > 1 else None,
    )


def _pose(X: Array) -> Any:
    from foxglove.messages import Pose, Quaternion, Vector3

    place, turn = map(float, X[:3, 3]), map(float, quaternion(X))
    return Pose(
        position=Vector3(**dict(zip("xyz", place, strict=True))),
        orientation=Quaternion(**dict(zip("xyzw", turn, strict=True))),
    )


def _rgba(colour: str) -> Array:
    return np.array([*(int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5)), 1.0])


def _or_none(value: Any) -> float | None:
    return float(value) if math.isfinite(value) else None


def _finite(value: Any) -> Any:
    """Replace numbers that JSON does not have by null."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_finite(item) for item in value]
    return value
