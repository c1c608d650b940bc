"""Export a run log to MCAP, for tools that plot and replay recordings."""

import datetime
import json
import math
from pathlib import Path
from typing import Any

from unwrinkle.hardware.run_log.reader import RunLogRecords
from unwrinkle.models.errors import InputError
from unwrinkle.models.io.files import atomic_path

_NUMBERS = {"type": "array", "items": {"type": "number"}}
_TIME = {
    "type": "object",
    "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}},
}
#: Schema like sensor_msgs/JointState; commanded points also carry their place in the trajectory.
JOINT_STATE = {
    "type": "object",
    "title": "JointState",
    "properties": {
        "stamp": _TIME,
        "name": {"type": "array", "items": {"type": "string"}},
        "position": _NUMBERS,
        "velocity": _NUMBERS,
        "command": {"type": "integer"},
        "sequence": {"type": "integer"},
        "trajectory_time": {"type": "number"},
    },
}
ANYTHING = {"type": "object", "title": "Record", "properties": {"stamp": _TIME}}


def export_mcap(records: RunLogRecords, path: str | Path) -> int:
    """Write an MCAP file with the channels /commanded, /measured, /status and /events.

    Args:
        records: records of the log.
        path: file to write, atomically.

    Returns:
        The number of messages.

    Raises:
        InputError: the package `mcap` is not installed, or the file cannot be written.
    """
    try:
        from mcap.writer import Writer
    except ImportError:
        raise InputError(
            "MCAP export needs the package mcap; install it with: pip install 'unwrinkle[mcap]'"
        ) from None
    zero = _wall_clock(records)
    names = [str(name) for name in records.header.get("axes", [])]
    messages = sorted(_messages(records, names), key=lambda message: message[0])
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="", library="unwrinkle")
        schemas = {
            "JointState": writer.register_schema(
                "JointState", "jsonschema", json.dumps(JOINT_STATE).encode()
            ),
            "Record": writer.register_schema("Record", "jsonschema", json.dumps(ANYTHING).encode()),
        }
        channels: dict[str, int] = {}
        for number, (time, topic, schema, value) in enumerate(messages):
            if topic not in channels:
                channels[topic] = writer.register_channel(topic, "json", schemas[schema])
            stamp = max(round(1e9 * (zero + time)), 0)
            value["stamp"] = {"sec": stamp // 10**9, "nsec": stamp % 10**9}
            data = json.dumps(_finite(value)).encode()
            writer.add_message(channels[topic], stamp, data, stamp, number)
        writer.add_metadata("run", {key: str(value) for key, value in records.header.items()})
        writer.finish()  # type: ignore[no-untyped-call,unused-ignore]
    return len(messages)


def _wall_clock(records: RunLogRecords) -> float:
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


def _messages(
    records: RunLogRecords, names: list[str]
) -> list[tuple[float, str, str, dict[str, Any]]]:
    """Return time on the log's clock (s), topic, schema and content of every record."""
    found: list[tuple[float, str, str, dict[str, Any]]] = []
    sent, seen = records.commanded, records.measured
    for i, time in enumerate(sent.times.tolist()):
        value = {
            "name": names,
            "position": sent.positions[i].tolist(),
            "velocity": sent.velocities[i].tolist(),
            "command": int(sent.numbers[i]),
            "sequence": int(sent.sequences[i]),
            "trajectory_time": float(sent.point_times[i]),
        }
        found.append((time, "/commanded", "JointState", value))
    for i, time in enumerate(seen.times.tolist()):
        value = {
            "name": names,
            "position": seen.positions[i].tolist(),
            "velocity": seen.velocities[i].tolist(),
        }
        found.append((time, "/measured", "JointState", value))
    for status in records.statuses:
        found.append((status.time, "/status", "Record", dict(status.fields)))
    for event in records.events:
        value = {"kind": event.kind, "text": event.text, "data": event.data}
        found.append((event.time, "/events", "Record", value))
    return found


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_finite(item) for item in value]
    return value
