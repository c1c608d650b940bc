"""Files of the stereo head: its calibration, and the head angles of an image pair.

A calibration holds everything that `StereoHead` needs, with the residuals of its estimation. The
head angles, `head.yaml`, are stored beside a pair of images and name the calibration.
"""

import dataclasses
import datetime
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path

import yaml

from unwrinkle.models.errors import InputError
from unwrinkle.models.io.files import write_text
from unwrinkle.models.io.loader_yaml import load_yaml, models_dir
from unwrinkle.models.limits import HeadLimits, load_limits
from unwrinkle.models.scenario import resolve
from unwrinkle.models.transforms import PoseRecord
from unwrinkle.perception.camera import Camera
from unwrinkle.perception.stereo.head import Eye, Gaze, PanTiltUnit, StereoHead

#: Name of the shipped calibration.
NOMINAL_HEAD = "clopema"

#: Default validity of a calibration, days.
VALID_DAYS = 180


@dataclass(frozen=True)
class UnitRecord:
    """Kinematics of the pan-tilt units in a calibration file; see `PanTiltUnit`."""

    pan_origin: list[float] = field(default_factory=list)
    mount_origin: list[float] = field(default_factory=list)
    step: float = 0.0


@dataclass(frozen=True)
class EyeRecord:
    """One eye in a calibration file.

    Attributes:
        camera: intrinsics.
        base: X_RB, pose of the unit's base in the turn-table's frame.
        mount: X_MC, pose of the camera in the mount's frame.
        residual: RMS reprojection error, pixels; 0 if not measured.
        views: number of board views used.
    """

    camera: Camera = field(default_factory=Camera)
    base: PoseRecord = field(default_factory=PoseRecord)
    mount: PoseRecord = field(default_factory=PoseRecord)
    residual: float = 0.0
    views: int = 0


@dataclass(frozen=True)
class HeadCalibration:
    """Calibration of a head, as stored in its file.

    Attributes:
        head: name of the head.
        date: of the calibration, YYYY-MM-DD.
        valid_days: validity, days.
        source: description of the measurements.
        turntable_height, turntable_yaw: height and yaw of the turn-table's frame at angle 0, metres
            and radians.
        unit: kinematics of both units.
        left, right: the eyes.
        row_residual: RMS row error of matching corners after rectification, pixels.

    Raises:
        InputError: a name, a date or a number is missing or implausible.
    """

    head: str = ""
    date: str = ""
    valid_days: int = VALID_DAYS
    source: str = ""
    turntable_height: float = 0.0
    turntable_yaw: float = 0.0
    unit: UnitRecord = field(default_factory=UnitRecord)
    left: EyeRecord = field(default_factory=EyeRecord)
    right: EyeRecord = field(default_factory=EyeRecord)
    row_residual: float = 0.0

    def __post_init__(self) -> None:
        """Check the fields that `stereo_head` needs."""
        if not self.head:
            raise InputError("head calibration: 'head' is missing; it names the head")
        _day(self.date, "head calibration: date")
        numbers = (
            self.turntable_height,
            self.turntable_yaw,
            self.row_residual,
            self.unit.step,
            self.left.residual,
            self.right.residual,
        )
        if not all(isfinite(number) for number in numbers) or self.unit.step <= 0.0:
            raise InputError("head calibration: its numbers must be finite and unit.step positive")
        if len(self.unit.pan_origin) != 3 or len(self.unit.mount_origin) != 3:
            raise InputError(
                "head calibration: unit.pan_origin and mount_origin need three numbers"
            )

    def stereo_head(self, limits: HeadLimits | None = None) -> StereoHead:
        """Build the head of this calibration.

        Args:
            limits: of the units' axes; None for those of the package's limits.yaml.

        Raises:
            InputError: a pose is not a rigid transform.
        """
        limits = limits or load_limits(models_dir() / "limits.yaml").head
        x, y, z = self.unit.pan_origin
        u, v, w = self.unit.mount_origin
        unit = PanTiltUnit(
            pan_origin=(x, y, z),
            mount_origin=(u, v, w),
            step=self.unit.step,
            pan=(limits.pan.lower, limits.pan.upper),
            tilt=(limits.tilt.lower, limits.tilt.upper),
        )
        left, right = (
            Eye(
                name,
                record.camera,
                unit,
                record.base.matrix(f"{name} eye's base"),
                record.mount.matrix(f"{name} eye's mount"),
            )
            for name, record in (("left", self.left), ("right", self.right))
        )
        return StereoHead(self.head, left, right, self.turntable_height, self.turntable_yaw)

    def with_head(self, head: StereoHead) -> "HeadCalibration":
        """Return the calibration with the cameras and poses of a head."""

        def eye(record: EyeRecord, eye: Eye) -> EyeRecord:
            base, mount = PoseRecord.of(eye.X_RB), PoseRecord.of(eye.X_MC)
            return dataclasses.replace(record, camera=eye.camera, base=base, mount=mount)

        return dataclasses.replace(
            self, left=eye(self.left, head.left), right=eye(self.right, head.right)
        )

    def save(self, path: str | Path) -> None:
        """Write the YAML file atomically."""
        write_text(path, yaml.safe_dump(dataclasses.asdict(self), sort_keys=False))


@dataclass(frozen=True)
class EyeAngles:
    """Pan and tilt of one unit, radians."""

    pan: float = float("nan")
    tilt: float = float("nan")


@dataclass(frozen=True)
class HeadAngles:
    """Angles of the head when an image pair was taken; the schema of head.yaml.

    Attributes:
        head: name of the head.
        calibration: calibration file: absolute, relative to head.yaml, or
            `package://unwrinkle_models/...`.
        date: of the pair, YYYY-MM-DD.
        ext_axis: angle of the turn-table, radians.
        left, right: angles of the units.

    Raises:
        InputError: a field is missing or an angle is not finite.
    """

    head: str = ""
    calibration: str = ""
    date: str = ""
    ext_axis: float = 0.0
    left: EyeAngles = field(default_factory=EyeAngles)
    right: EyeAngles = field(default_factory=EyeAngles)

    def __post_init__(self) -> None:
        """Check that names, date and angles are present."""
        for name in ("head", "calibration", "date"):
            if not getattr(self, name):
                raise InputError(
                    f"head angles: {name!r} is missing; state head, calibration and date"
                )
        _day(self.date, "head angles: date")
        angles = (self.ext_axis, *dataclasses.astuple(self.left), *dataclasses.astuple(self.right))
        if not all(isfinite(angle) for angle in angles):
            raise InputError("head angles: left and right need pan and tilt, finite, in radians")

    @property
    def gaze(self) -> Gaze:
        """The angles as a `Gaze`."""
        return Gaze(self.left.pan, self.left.tilt, self.right.pan, self.right.tilt, self.ext_axis)

    @staticmethod
    def of(gaze: Gaze, calibration: HeadCalibration, file: str, day: datetime.date) -> "HeadAngles":
        """Return the record of a gaze; `file` is the calibration's path to store."""
        return HeadAngles(
            head=calibration.head,
            calibration=file,
            date=day.isoformat(),
            ext_axis=gaze.ext_axis,
            left=EyeAngles(*gaze.left),
            right=EyeAngles(*gaze.right),
        )

    def save(self, path: str | Path) -> None:
        """Write the YAML file atomically."""
        write_text(path, yaml.safe_dump(dataclasses.asdict(self), sort_keys=False))


def load_calibration(path: str | Path) -> HeadCalibration:
    """Load a head's calibration.

    Raises:
        InputError: missing file, unknown key or implausible value; the message names the file.
    """
    if not Path(path).is_file():
        raise InputError(f"{path}: no such calibration; make one with `unwrinkle calibrate`")
    return load_yaml(path, HeadCalibration)


def nominal_calibration() -> HeadCalibration:
    """Return the shipped calibration of the Glasgow cell's head."""
    return load_calibration(models_dir() / "heads" / f"{NOMINAL_HEAD}.yaml")


def nominal_head() -> StereoHead:
    """Return the head of the Glasgow cell."""
    return nominal_calibration().stereo_head()


def load_head_angles(path: str | Path) -> tuple[HeadAngles, HeadCalibration]:
    """Load head.yaml and the calibration that it names.

    Raises:
        InputError: a file is missing or unusable, the calibration is of another head, or it had
            expired when the pair was taken.
    """
    path = Path(path)
    angles = load_yaml(path, HeadAngles)
    calibration = load_calibration(_beside(path, angles.calibration))
    if calibration.head != angles.head:
        raise InputError(
            f"{path}: the pair is of head {angles.head!r}, {angles.calibration} calibrates "
            f"{calibration.head!r}; name the right calibration"
        )
    age = (_day(angles.date, "date") - _day(calibration.date, "date")).days
    if age > calibration.valid_days:
        raise InputError(
            f"{path}: {angles.calibration} of {calibration.date} was {age} days old when the pair "
            f"was taken, at most {calibration.valid_days}; calibrate again"
        )
    return angles, calibration


def _beside(path: Path, name: str) -> Path:
    return resolve(name) if name.startswith("package://") else path.parent / name


def _day(text: str, label: str) -> datetime.date:
    try:
        return datetime.date.fromisoformat(text)
    except ValueError:
        raise InputError(f"{label} {text!r} is no date YYYY-MM-DD") from None
