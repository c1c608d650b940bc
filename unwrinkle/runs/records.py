"""Records in a run's folder: its settings, each action, each measured motion; plain values."""

import dataclasses as dc
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import InputError
from unwrinkle.models.io.archive import load_archive, save_archive
from unwrinkle.planning.trajectory import AXES

#: Stages of an action whose wall-clock time is recorded, in their order.
STAGES = ("render", "stereo", "analysis", "planning", "verification", "motion")
_MOTION_FORMAT = "unwrinkle.motion"
_VERSION = 1


def _checked(kind: str, data: Any, schema: type) -> dict[str, Any]:
    """Return the entries that are fields of a dataclass.

    Refuse a mapping that lacks a required field.
    """
    if not isinstance(data, Mapping):
        raise InputError(f"{kind}: is {type(data).__name__}; a JSON object is required")
    fields = dc.fields(schema)
    missing = [
        f.name
        for f in fields
        if f.name not in data and f.default is dc.MISSING and f.default_factory is dc.MISSING
    ]
    if missing:
        raise InputError(f"{kind}: {', '.join(missing)} missing")
    return {f.name: data[f.name] for f in fields if f.name in data}


def _figures(kind: str, values: Mapping[str, Any] | None) -> dict[str, float] | None:
    """Copy named figures; refuse a value that is no finite number."""
    if values is None:
        return None
    for name, value in values.items():
        if not isinstance(value, int | float) or not math.isfinite(value):
            raise InputError(f"{kind}.{name} is {value!r}; a finite number is required")
    return {str(name): float(value) for name, value in values.items()}


@dataclass(frozen=True)
class RunSettings:
    """Settings of a run.

    Attributes:
        garment: name of the outline.
        texture: texture of the garment.
        start: initial state of the garment.
        seed: seed of all random numbers.
        sensor: "stereo", "truth", or the name of a depth camera.
        scale: scale of the head's pictures, 1 for 16 megapixels.
        arms: any, dual or single.
        mode: reading of Eq. 5: foot, paper or between.
        actions: maximum number of actions.
        scenario: whole scenario as YAML text.
        command: command line that started the run.
    """

    garment: str
    texture: str
    start: str
    seed: int
    sensor: str
    scale: float
    arms: str
    mode: str
    actions: int
    scenario: str = ""
    command: str = ""

    @property
    def station(self) -> str:
        """Return the form of the station from the scenario: sim, loopback or hardware."""
        try:
            named = yaml.safe_load(self.scenario)
        except yaml.YAMLError:
            return "sim"
        for scenario in named.values() if isinstance(named, dict) else ():
            if isinstance(scenario, dict) and isinstance(scenario.get("station"), dict):
                return str(scenario["station"].get("form", "sim"))
        return "sim"

    def to_json(self) -> dict[str, Any]:
        """Return plain numbers and strings."""
        return dc.asdict(self)

    @classmethod
    def from_json(cls, data: Any) -> "RunSettings":
        """Read the result of `to_json`; unknown keys are ignored.

        Raises:
            InputError: the data is no object, or a key is missing.
        """
        return cls(**_checked("run settings", data, cls))


@dataclass(frozen=True)
class SegmentMark:
    """Named part of a motion, from begin to end on the station's clock, s."""

    name: str
    begin: float
    end: float


@dataclass(frozen=True, eq=False)
class MotionRecord:
    """Measured motion of one action. All times are of the station's clock, s.

    Record the cloth at about 10 frames per second, and only while it moves: one frame of 80 x 80
    nodes is 77 kB.

    Attributes:
        times: (N,) times of the samples, never decreasing.
        measured: (N, 13) axis positions, rad.
        velocities: (N, 13) axis velocities, rad/s.
        reference: (N, 13) reference positions of the controller, rad.
        openings: (N, 2) openings of the right and the left gripper, m.
        segments: named parts of the motion, in order.
        frame_times: (F,) times of the cloth's frames, never decreasing.
        cloth_frames: (F, n, 3) float32, the cloth's vertices in the world frame, m.

    Raises:
        InputError: shapes disagree, a number is not finite, or a time decreases.
    """

    times: Array
    measured: Array
    velocities: Array
    reference: Array
    openings: Array
    segments: tuple[SegmentMark, ...] = ()
    frame_times: Array = field(default_factory=lambda: np.zeros(0))
    cloth_frames: NDArray[np.float32] = field(
        default_factory=lambda: np.zeros((0, 0, 3), dtype=np.float32)
    )

    def __post_init__(self) -> None:
        """Check, copy and freeze the arrays."""
        count, frames = np.shape(self.times)[:1], np.shape(self.frame_times)[:1]
        vertices = np.shape(self.cloth_frames)[1:2]
        required = {
            "times": count,
            "measured": (*count, AXES),
            "velocities": (*count, AXES),
            "reference": (*count, AXES),
            "openings": (*count, 2),
            "frame_times": frames,
            "cloth_frames": (*frames, *vertices, 3),
        }
        for name, shape in required.items():
            kind = np.float32 if name == "cloth_frames" else np.float64
            value = np.array(getattr(self, name), dtype=kind)
            if value.shape != shape:
                raise InputError(f"motion: {name} has shape {value.shape}; {shape} is required")
            if not np.isfinite(value).all():
                where = np.argwhere(~np.isfinite(value))[0].tolist()
                raise InputError(f"motion: {name}{where} is not a finite number")
            value.setflags(write=False)
            object.__setattr__(self, name, value)
        for name in ("times", "frame_times"):
            if np.any(np.diff(getattr(self, name)) < 0.0):
                raise InputError(f"motion: {name} decrease; they must be in order")

    @property
    def begin(self) -> float:
        """Return the first time, s; 0 for an empty record."""
        return float(self.times[0]) if len(self.times) else 0.0

    @property
    def end(self) -> float:
        """Return the last time, s; 0 for an empty record."""
        return float(self.times[-1]) if len(self.times) else 0.0

    def save(self, path: str | Path) -> None:
        """Write one `.npz` file atomically.

        Raises:
            InputError: the file cannot be written.
        """
        header = {
            "format": _MOTION_FORMAT,
            "version": _VERSION,
            "segments": [dc.asdict(mark) for mark in self.segments],
        }
        names = [f.name for f in dc.fields(self) if f.name != "segments"]
        save_archive(path, header, {name: getattr(self, name) for name in names})

    @classmethod
    def load(cls, path: str | Path) -> "MotionRecord":
        """Read the result of `save`.

        Raises:
            InputError: the file is missing or damaged, or no motion record; the message names the
                file.
        """
        names = "|".join(f.name for f in dc.fields(cls) if f.name != "segments")
        header, arrays = load_archive(path, names)
        if header.get("format") != _MOTION_FORMAT or header.get("version") != _VERSION:
            raise InputError(f"{path}: is no motion record of version {_VERSION}")
        try:
            marks = tuple(SegmentMark(**mark) for mark in header["segments"])
            return cls(segments=marks, **arrays)
        except (KeyError, TypeError, ValueError, InputError) as error:
            raise InputError(f"{path}: is damaged ({error})") from None


@dataclass(frozen=True)
class ActionRecord:
    """Result of one action, and the time of its stages.

    Attributes:
        index: index of the look before it.
        outcome: one word: done, missed, nothing, refused, flat, fault, ...
        reason: one sentence; may be empty.
        wrinkle: index of the pulled wrinkle, largest first; None if none was pulled.
        arms: participating arms, "right" and "left".
        pulls: distance that each of them pulled, m.
        seconds: wall-clock time of each stage, s; see `STAGES`.
        truth_before: true values of the simulated cloth before: coverage (share), height (m),
            overstretch (ratio); None if the station is not simulated.
        truth_after: the same after the action.
        clearance: smallest clearance of the verdict, m.
        clearance_measured: smallest clearance along the measured motion, m.
        following_error: largest distance of an axis from its plan after the lag is removed, rad.
        grip_distance_error: largest error of the grippers' distance while both held cloth, m.
        violations: limits and clearances that the measured motion violated, one sentence each.
        memory: state of the policy after the action, as JSON, from which the run is resumed.

    Raises:
        InputError: a figure is not a finite number.
    """

    index: int
    outcome: str
    reason: str = ""
    wrinkle: int | None = None
    arms: tuple[str, ...] = ()
    pulls: Mapping[str, float] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)
    truth_before: Mapping[str, float] | None = None
    truth_after: Mapping[str, float] | None = None
    clearance: float | None = None
    clearance_measured: float | None = None
    following_error: float | None = None
    grip_distance_error: float | None = None
    violations: tuple[str, ...] = ()
    memory: Any = None

    def __post_init__(self) -> None:
        """Check and copy the figures."""
        for name in ("arms", "violations"):
            object.__setattr__(self, name, tuple(str(text) for text in getattr(self, name)))
        for name in ("pulls", "seconds", "truth_before", "truth_after"):
            object.__setattr__(self, name, _figures(f"action {name}", getattr(self, name)))
        singles = ("clearance", "clearance_measured", "following_error", "grip_distance_error")
        _figures("action", {n: getattr(self, n) for n in singles if getattr(self, n) is not None})

    @property
    def total(self) -> float:
        """Return the total time of all stages, s."""
        return float(sum(self.seconds.values()))

    def to_json(self) -> dict[str, Any]:
        """Return plain lists, numbers and strings."""
        return {**dc.asdict(self), "arms": list(self.arms), "violations": list(self.violations)}

    @classmethod
    def from_json(cls, data: Any) -> "ActionRecord":
        """Read the result of `to_json`; unknown keys are ignored.

        Raises:
            InputError: the data is no object, a key is missing, or a figure is not a finite number.
        """
        return cls(**_checked("action", data, cls))
