"""Export of a run log to a rerun recording (`.rrd`), with the optional package rerun-sdk.

The robot moves as measured, its grippers as commanded, in the frame `world` (m, z up). Angles (rad)
and speeds (rad/s) of the axes are plots under `measured/` and `commanded/`. The timeline `log` is
the time since the log's begin, s.
"""

from pathlib import Path
from typing import Any

import numpy as np

from unwrinkle.hardware.run_log.reader import RunLogRecords
from unwrinkle.logs.replay import measured_track
from unwrinkle.models.errors import InputError
from unwrinkle.models.io.files import atomic_path
from unwrinkle.models.robot import Cell
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.viewer.cell_bodies import BodyShape, CellBodies

_TIMELINE = "log"


def export_rerun(
    records: RunLogRecords, path: str | Path, cell: Cell, plan: FlatteningPlan | None = None
) -> None:
    """Write a rerun recording of a run log.

    Args:
        records: records of the log.
        path: file to write, atomically.
        cell: cell of the log, for the robot's shape.
        plan: executed plan, for the garment; None if it is unavailable.

    Raises:
        InputError: rerun-sdk is not installed, or the file cannot be written.
    """
    try:
        import rerun as rr
    except ImportError:
        raise InputError(
            "export to *.rrd needs the package rerun-sdk; install it with: pip install "
            "'unwrinkle[rerun]'"
        ) from None
    with atomic_path(path) as temporary:
        recording = rr.RecordingStream("unwrinkle")
        recording.save(temporary)
        recording.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        _log_joints(rr, recording, records, cell)
        _log_events(rr, recording, records)
        _log_robot(rr, recording, records, cell)
        if plan is not None and plan.garment is not None:
            garment = plan.garment
            mesh = rr.Mesh3D(
                vertex_positions=garment.p_WV,
                triangle_indices=garment.triangles,
                vertex_colors=garment.colours,
            )
            recording.log("world/garment", mesh, static=True)
        recording.flush()
        recording.disconnect()


def _log_joints(rr: Any, recording: Any, records: RunLogRecords, cell: Cell) -> None:
    names = [str(name) for name in records.header.get("axes", cell.robot.axes)]
    for topic, part in (("commanded", records.commanded), ("measured", records.measured)):
        if not len(part.times):
            continue
        column = rr.TimeColumn(_TIMELINE, duration=part.times - records.begin)
        for what, values in (("angle", part.positions), ("speed", part.velocities)):
            for name, row in zip(names, values.T, strict=True):
                entity = f"{topic}/{what}/{name.replace('::', '/')}"
                recording.send_columns(entity, [column], rr.Scalars.columns(scalars=row))


def _log_events(rr: Any, recording: Any, records: RunLogRecords) -> None:
    for event in records.events:
        recording.set_time(_TIMELINE, duration=event.time - records.begin)
        recording.log("events", rr.TextLog(f"{event.kind}: {event.text}"))


def _log_robot(rr: Any, recording: Any, records: RunLogRecords, cell: Cell) -> None:
    try:
        track = measured_track(records, cell)
    except InputError:  # no motion to show
        return
    bodies = CellBodies(cell)
    entities = [f"world/{name.replace('::', '/')}" for name in bodies.names]
    for entity, shapes in zip(entities, bodies.shapes, strict=True):
        for number, shape in enumerate(shapes):
            recording.log(f"{entity}/shape_{number}", _shape(rr, shape), static=True)
    poses = np.array(
        [bodies.poses(q, d) for q, d in zip(track.positions, track.openings, strict=True)]
    )
    column = rr.TimeColumn(_TIMELINE, duration=track.begin - records.begin + track.times)
    for number, entity in enumerate(entities):
        places = rr.Transform3D.columns(
            translation=poses[:, number, :3], quaternion=poses[:, number, 3:]
        )
        if bodies.moving[number]:
            recording.send_columns(entity, [column], places)
        else:
            row = poses[0, number]
            transform = rr.Transform3D(translation=row[:3], quaternion=row[3:])
            recording.log(entity, transform, static=True)


def _shape(rr: Any, shape: BodyShape) -> Any:
    pose = {
        "centers": [shape.X_BG[:3, 3]],
        "quaternions": [shape.quaternion],
        "colors": [[round(255.0 * part) for part in shape.colour]],
    }
    half = [0.5 * extent for extent in shape.size]
    if shape.kind == "box":
        return rr.Boxes3D(half_sizes=[half], fill_mode="solid", **pose)
    if shape.kind == "cylinder":
        return rr.Cylinders3D(lengths=[shape.size[2]], radii=[half[0]], fill_mode="solid", **pose)
    return rr.Ellipsoids3D(half_sizes=[half], fill_mode="solid", **pose)
