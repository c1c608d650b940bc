"""The flattening plan as a value.

Three segments and two gripper events on one clock, with a content hash.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.errors import InputError
from unwrinkle.models.io.archive import load_archive, save_archive
from unwrinkle.models.io.json_fields import (
    as_number,
    field,
    flags,
    integer,
    items,
    number,
    only,
    text,
)
from unwrinkle.models.robot import Cell
from unwrinkle.perception.target import FlatteningTarget
from unwrinkle.planning.trajectory import Trajectory

FORMAT = "unwrinkle-plan"
VERSION = 1
#: Size limit of all arrays of a plan file, bytes; a plan of 20 000 samples has 5 MB, a garment's
#: surface some more.
MOST_BYTES = 64 << 20
_SAMPLES = ("times", "positions", "velocities")
_MEMBERS = (
    r"segment[0-9]\.(times|positions|velocities)|garment\.(p_WV|triangles|colours|ridge|outline)"
)


@dataclass(frozen=True)
class PoseMark:
    """One of the seven poses, and the time at which a segment passes it, s from its start."""

    name: str
    time: float


@dataclass(frozen=True, eq=False)
class Segment:
    """Motion from rest to rest between two gripper events.

    Attributes:
        name: approach, pull or release.
        start: s on the plan's clock.
        trajectory: samples on the segment's own clock.
        closed: state of the right and the left gripper during the segment.
        poses: named poses that it passes.
        contact: interval on the segment's clock, s, in which fingers may touch the working table.
    """

    name: str
    start: float
    trajectory: Trajectory
    closed: tuple[bool, bool]
    poses: tuple[PoseMark, ...]
    contact: tuple[float, float]

    @property
    def end(self) -> float:
        """End on the plan's clock, s."""
        return self.start + self.trajectory.duration


@dataclass(frozen=True)
class GripperEvent:
    """A change of the grippers' state while both arms rest.

    Attributes:
        time: start on the plan's clock, s.
        closed: commanded state of the right and the left gripper.
        dwell: time until the next segment may start, s.
    """

    time: float
    closed: tuple[bool, bool]
    dwell: float


@dataclass(frozen=True)
class ArmChoice:
    """Hand and freedoms of one arm. Angles in rad.

    Attributes:
        side: index of the target's hand that the arm serves.
        offset: turn of the grasp direction about the vertical.
        tilt: of the tool below the horizontal.
        share: pull distance over the target's.
    """

    side: int
    offset: float
    tilt: float
    share: float


@dataclass(frozen=True, eq=False)
class GarmentSurface:
    """Surface of the observed garment, for display beside the motion.

    Attributes:
        p_WV: (V, 3) vertices, m.
        triangles: (F, 3) vertex indices.
        colours: (V, 3) uint8 RGB.
        ridge: (R, 3) line of the wrinkle that is pulled, m.
        outline: (C, 3) the garment's contour, m.
    """

    p_WV: NDArray[np.float32]
    triangles: NDArray[np.int32]
    colours: NDArray[np.uint8]
    ridge: NDArray[np.float32]
    outline: NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class FlatteningPlan:
    """A dual-arm (or single-arm) flattening motion, ready to be verified, shown and executed.

    Attributes:
        robot: name of the robot.
        robot_hash: of the model files and cell settings (see `Cell.robot_hash`).
        limits_hash: of the limits used.
        speed: fraction of the catalogue velocity, acceleration and jerk used.
        target: grasp points, directions and pull distances.
        arms: choice for the right and the left arm; None for an arm that takes no part.
        turntable: angle during the grasp, rad.
        segments: approach, pull, release, in order.
        events: close after the first, open after the second segment.
        note: reason for a single-arm plan; empty for a dual-arm plan.
        garment: observed surface; None if unknown.
    """

    robot: str
    robot_hash: str
    limits_hash: str
    speed: float
    target: FlatteningTarget
    arms: tuple[ArmChoice | None, ArmChoice | None]
    turntable: float
    segments: tuple[Segment, ...]
    events: tuple[GripperEvent, ...]
    note: str = ""
    garment: GarmentSurface | None = None

    @property
    def dual(self) -> bool:
        """Whether both arms take part."""
        return all(arm is not None for arm in self.arms)

    @property
    def motion_time(self) -> float:
        """Duration of all segments, without the grippers' dwell, s."""
        return sum(segment.trajectory.duration for segment in self.segments)

    @cached_property
    def content_hash(self) -> str:
        """SHA-256 (hex) over the whole plan, hashes of robot and limits included."""
        header, arrays = self._parts()
        digest = hashlib.sha256(json.dumps(header, sort_keys=True).encode())
        for name in sorted(arrays):
            value = np.ascontiguousarray(arrays[name])
            digest.update(f"{name}{value.dtype.str}{value.shape}".encode())
            digest.update(value.tobytes())
        return digest.hexdigest()

    def check_made_for(self, cell: Cell) -> None:
        """Refuse a plan for another robot, cell or set of limits.

        Raises:
            InputError: naming what differs.
        """
        if self.robot != cell.robot.name:
            raise InputError(
                f"the plan is for robot '{self.robot}', this cell has '{cell.robot.name}'"
            )
        if self.robot_hash != cell.robot_hash:
            raise InputError(
                f"the plan was made for another model of the cell ({self.robot_hash[:12]}, here "
                f"{cell.robot_hash[:12]}): name the scenario that it was made in (--scenario, or "
                "the site's key `scenario`), or plan again where the robot, a table or a clearance "
                "has changed"
            )
        limits_hash = cell.with_speed(self.speed).limits_hash
        if self.limits_hash != limits_hash:
            raise InputError(
                f"the plan was made with other limits ({self.limits_hash[:12]}, here "
                f"{limits_hash[:12]}); plan again"
            )

    def save(self, path: str | Path) -> None:
        """Write the plan to a file, atomically.

        Raises:
            InputError: the file cannot be written there.
        """
        header, arrays = self._parts()
        save_archive(path, {**header, "content_hash": self.content_hash}, arrays)

    @classmethod
    def load(cls, path: str | Path) -> "FlatteningPlan":
        """Read a plan and check its hash.

        Raises:
            InputError: the file is missing, damaged, no plan, of another version, or its content
                does not match its hash.
        """
        header, arrays = load_archive(path, _MEMBERS, MOST_BYTES)
        if header.get("format") != FORMAT:
            raise InputError(f"{path}: is not a flattening plan; make one with `unwrinkle plan`")
        if header.get("version") != VERSION:
            raise InputError(
                f"{path}: plan version {header.get('version')}, this program reads version "
                f"{VERSION}; plan again"
            )
        try:
            plan = _from_parts(header, arrays)
        except InputError as error:
            raise InputError(f"{path}: is damaged: {error}; plan again") from None
        if plan.content_hash != header.get("content_hash"):
            raise InputError(
                f"{path}: the content does not match its hash "
                f"{str(header.get('content_hash'))[:12]}: it was changed after planning; plan again"
            )
        return plan

    def _parts(self) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
        arrays: dict[str, NDArray[Any]] = {}
        segments = []
        for i, segment in enumerate(self.segments):
            for name in _SAMPLES:
                arrays[f"segment{i}.{name}"] = getattr(segment.trajectory, name)
            segments.append(
                {
                    "name": segment.name,
                    "start": _plain(segment.start),
                    "closed": list(segment.closed),
                    "poses": [_plain(asdict(mark)) for mark in segment.poses],
                    "contact": [_plain(time) for time in segment.contact],
                }
            )
        if self.garment is not None:
            for name in GarmentSurface.__dataclass_fields__:
                arrays[f"garment.{name}"] = getattr(self.garment, name)
        header = {
            "format": FORMAT,
            "version": VERSION,
            "robot": self.robot,
            "robot_hash": self.robot_hash,
            "limits_hash": self.limits_hash,
            "speed": _plain(self.speed),
            "target": self.target.to_json(),
            "arms": [
                None if arm is None else {**_plain(asdict(arm)), "side": arm.side}
                for arm in self.arms
            ],
            "turntable": _plain(self.turntable),
            "segments": segments,
            "events": [
                {**_plain(asdict(event)), "closed": list(event.closed)} for event in self.events
            ],
            "note": self.note,
        }
        return header, arrays


def _plain(value: Any) -> Any:
    """Convert numbers, also those in a dictionary, to the floats that reading a file gives.

    Keep other values.
    """
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    number_ = isinstance(value, int | float | np.number) and not isinstance(value, bool)
    return float(value) if number_ else value


def _from_parts(header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> FlatteningPlan:
    """Build the plan from a file's header and arrays, checking the type of every field.

    Raises:
        InputError: a field or an array is missing or of the wrong type.
    """
    segments = tuple(_segment(i, item, arrays) for i, item in enumerate(items(header, "segments")))
    events = []
    for i, item in enumerate(items(header, "events")):
        where = f"events[{i}]"
        only(item, ("time", "closed", "dwell"), where)
        right, left = flags(item, "closed", where, count=2)
        time, dwell = number(item, "time", where), number(item, "dwell", where)
        events.append(GripperEvent(time, (right, left), dwell))
    right_arm, left_arm = (
        None if item is None else _arm(f"arms[{i}]", item)
        for i, item in enumerate(items(header, "arms", count=2))
    )
    return FlatteningPlan(
        robot=text(header, "robot"),
        robot_hash=text(header, "robot_hash"),
        limits_hash=text(header, "limits_hash"),
        speed=number(header, "speed"),
        target=_target(field(header, "target")),
        arms=(right_arm, left_arm),
        turntable=number(header, "turntable"),
        segments=segments,
        events=tuple(events),
        note=text(header, "note"),
        garment=_garment(arrays),
    )


def _segment(i: int, item: Any, arrays: Mapping[str, NDArray[Any]]) -> Segment:
    where = f"segments[{i}]"
    only(item, ("name", "start", "closed", "poses", "contact"), where)
    samples = [_numbers(arrays, f"segment{i}.{name}") for name in _SAMPLES]
    if samples[0].ndim != 1:
        raise InputError(f"segment{i}.times has {samples[0].ndim} dimensions, expected 1")
    poses = []
    for k, mark in enumerate(items(item, "poses", where)):
        only(mark, ("name", "time"), f"{where}.poses[{k}]")
        name = text(mark, "name", f"{where}.poses[{k}]")
        poses.append(PoseMark(name, number(mark, "time", f"{where}.poses[{k}]")))
    right, left = flags(item, "closed", where, count=2)
    begin, end = (
        as_number(value, f"{where}.contact") for value in items(item, "contact", where, 2)
    )
    return Segment(
        text(item, "name", where),
        number(item, "start", where),
        Trajectory(*samples),
        (right, left),
        tuple(poses),
        (begin, end),
    )


def _arm(where: str, item: Any) -> ArmChoice:
    only(item, ("side", "offset", "tilt", "share"), where)
    offset, tilt, share = (number(item, key, where) for key in ("offset", "tilt", "share"))
    return ArmChoice(integer(item, "side", where), offset, tilt, share)


def _target(data: Any) -> FlatteningTarget:
    try:
        return FlatteningTarget.from_json(data)
    except InputError as error:
        raise InputError(f"target: {error}") from None
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise InputError(f"target: {error!r}") from None


def _garment(arrays: Mapping[str, NDArray[Any]]) -> GarmentSurface | None:
    names = tuple(GarmentSurface.__dataclass_fields__)
    present = [name for name in names if f"garment.{name}" in arrays]
    if not present:
        return None
    surface = {}
    for name in names:
        value = _numbers(arrays, f"garment.{name}")
        if value.ndim != 2 or value.shape[1] != 3:
            raise InputError(f"garment.{name} has shape {value.shape}, expected rows of 3")
        if not np.isfinite(value).all():
            raise InputError(f"garment.{name} holds a number that is not finite")
        surface[name] = value
    triangles = surface["triangles"]
    if triangles.dtype.kind not in "iu" or (
        triangles.size and not 0 <= triangles.min() <= triangles.max() < len(surface["p_WV"])
    ):
        raise InputError("garment.triangles has indices of vertices that do not exist")
    return GarmentSurface(**surface)


def _numbers(arrays: Mapping[str, NDArray[Any]], name: str) -> NDArray[Any]:
    """Return an array of real numbers.

    Raises:
        InputError: the array is missing, or of another type.
    """
    if name not in arrays:
        raise InputError(f"the array {name} is missing")
    if arrays[name].dtype.kind not in "fiu":
        raise InputError(f"the array {name} holds {arrays[name].dtype}, expected real numbers")
    return arrays[name]
