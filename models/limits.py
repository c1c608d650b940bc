"""Limits of the robot's axes, grippers and head, read from limits.yaml."""

import dataclasses as dc
import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.errors import InputError
from unwrinkle.models.io.loader_yaml import load_yaml

ARM_AXES = ("s", "l", "u", "r", "b", "t")


@dataclass
class AxisLimits:
    """Limits of one axis in rad, rad/s, rad/s^2, rad/s^3 and N m."""

    lower: float = math.nan
    upper: float = math.nan
    velocity: float = math.nan
    acceleration: float = math.nan
    jerk: float = math.nan
    effort: float = math.nan


@dataclass
class HeadAxisLimits:
    """Limits of a pan or tilt axis in rad and rad/s."""

    lower: float = math.nan
    upper: float = math.nan
    velocity: float = math.nan


@dataclass
class HeadLimits:
    """Limits of one pan-tilt unit."""

    pan: HeadAxisLimits = field(default_factory=HeadAxisLimits)
    tilt: HeadAxisLimits = field(default_factory=HeadAxisLimits)


@dataclass
class GripperLimits:
    """Stroke of the driven blade in m and its speed in m/s."""

    stroke: float = math.nan
    velocity: float = math.nan


@dataclass
class LimitsFile:
    """Schema of limits.yaml."""

    turntable: dict[str, AxisLimits] = field(default_factory=dict)
    arm: dict[str, AxisLimits] = field(default_factory=dict)
    planning_fraction: float = 1.0
    tip_speed_holding: float = math.nan
    head: HeadLimits = field(default_factory=HeadLimits)
    gripper: GripperLimits = field(default_factory=GripperLimits)


@dataclass(frozen=True, eq=False)
class Limits:
    """Limits of the robot's axes in the order turn-table, right arm, left arm; arrays (axes,),
    read-only.

    Attributes:
        lower: least position, rad.
        upper: greatest position, rad.
        velocity: rad/s.
        acceleration: rad/s^2 (assumed, see limits.yaml).
        jerk: rad/s^3 (assumed).
        effort: N m (assumed).
        tip_speed_holding: speed of the tool centre points while holding cloth, m/s.
        gripper: stroke and speed of the grippers.
        head: limits of a pan-tilt unit.
    """

    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    velocity: NDArray[np.float64]
    acceleration: NDArray[np.float64]
    jerk: NDArray[np.float64]
    effort: NDArray[np.float64]
    tip_speed_holding: float
    gripper: GripperLimits
    head: HeadLimits

    def scaled(self, fraction: float) -> "Limits":
        """Scale velocity, acceleration and jerk by a fraction.

        Raises:
            InputError: the fraction is not in (0, 1].
        """
        if not 0.0 < fraction <= 1.0:
            raise InputError(f"speed fraction is {fraction:g}; give one above 0, up to 1")
        return dc.replace(
            self,
            velocity=_frozen(self.velocity * fraction),
            acceleration=_frozen(self.acceleration * fraction),
            jerk=_frozen(self.jerk * fraction),
        )


def _frozen(values: NDArray[np.float64]) -> NDArray[np.float64]:
    values.setflags(write=False)
    return values


def load_limits(path: Path) -> Limits:
    """Read limits.yaml.

    Raises:
        InputError: missing file, unknown or missing key, an axis missing, a limit that is not
            finite or not positive.
    """
    file = load_yaml(path, LimitsFile)
    if sorted(file.arm) != sorted(ARM_AXES) or list(file.turntable) != ["ext_axis"]:
        raise InputError(f"{path}: needs turntable: ext_axis and arm: {', '.join(ARM_AXES)}")
    scalars = (file.tip_speed_holding, file.gripper.stroke, file.gripper.velocity)
    if not all(0.0 < value < math.inf for value in scalars):
        raise InputError(
            f"{path}: tip_speed_holding and gripper stroke, velocity must be finite and positive"
        )
    axes: dict[str, AxisLimits | HeadAxisLimits] = {**file.turntable, **file.arm}
    axes |= {"pan": file.head.pan, "tilt": file.head.tilt}
    for name, each in axes.items():
        _check_axis(path, name, each)
    rows = [file.turntable["ext_axis"]] + 2 * [file.arm[name] for name in ARM_AXES]

    def column(name: str) -> NDArray[np.float64]:
        return _frozen(np.array([getattr(row, name) for row in rows], dtype=float))

    limits = Limits(
        lower=column("lower"),
        upper=column("upper"),
        velocity=column("velocity"),
        acceleration=column("acceleration"),
        jerk=column("jerk"),
        effort=column("effort"),
        tip_speed_holding=file.tip_speed_holding,
        gripper=file.gripper,
        head=file.head,
    )
    return limits.scaled(file.planning_fraction)


def _check_axis(path: Path, name: str, row: AxisLimits | HeadAxisLimits) -> None:
    """Refuse limits of an axis that are missing, not finite, or not positive.

    Raises:
        InputError: naming the axis and the key.
    """
    values = dc.asdict(row)
    for key, value in values.items():
        if not math.isfinite(value):
            raise InputError(f"{path}: {name} {key} is missing or not finite; give a number")
        if key not in ("lower", "upper") and value <= 0.0:
            raise InputError(f"{path}: {name} {key} is {value:g}, which is not positive")
    if not row.lower < row.upper:
        raise InputError(f"{path}: {name} lower is {row.lower:g}, not below upper {row.upper:g}")
