"""The scenario: which robot, which cell, which limits; read from one typed YAML file."""

import dataclasses as dc
from pathlib import Path

import yaml

from unwrinkle.models.errors import InputError
from unwrinkle.models.loader_yaml import load_yaml, models_dir


@dc.dataclass
class WorkingTable:
    """The table that garments lie on."""

    # Scoped name of the frame at the centre of its top surface, z up.
    frame: str = "t2::desk"
    # Extent along world x and y, in m.
    size: list[float] = dc.field(default_factory=lambda: [0.8, 0.8])


@dc.dataclass
class GripperSettings:
    """What the gripper allows."""

    # Window of the tool's tilt below the horizontal, in rad.
    tilt_lower: float = 0.5235987755982988
    tilt_upper: float = 1.3089969389957472
    # Distance between the open blades, in m.
    opening: float = 0.030


@dc.dataclass
class Clearances:
    """Least distances between bodies, in m."""

    arm_arm: float = 0.030
    arm_table: float = 0.020
    palm_table: float = 0.010
    # Fingers to table, except in the phases that need the contact (there 0).
    finger_table: float = 0.010
    surroundings: float = 0.010


@dc.dataclass
class Scenario:
    """One robot in one cell; see clopema.scenario.yaml for the meaning of every key."""

    directives: list[str] = dc.field(
        default_factory=lambda: ["package://unwrinkle_models/cell.dmd.yaml"]
    )
    robot: str = "package://unwrinkle_models/robot.yaml"
    limits: str = "package://unwrinkle_models/limits.yaml"
    speed: float = 1.0
    table: WorkingTable = dc.field(default_factory=WorkingTable)
    garment_centre: list[float] = dc.field(default_factory=lambda: [0.0, -1.10])
    gaze: list[float] = dc.field(default_factory=lambda: [0.0, -0.19])
    gripper: GripperSettings = dc.field(default_factory=GripperSettings)
    clearance: Clearances = dc.field(default_factory=Clearances)

    def validate(self) -> None:
        """Refuse values that no cell can have."""
        if not 0.0 < self.speed <= 1.0:
            raise InputError(f"scenario: speed is {self.speed:g}; give a fraction above 0, up to 1")
        if not 0.0 < self.gripper.tilt_lower <= self.gripper.tilt_upper <= 1.5707963267948966:
            raise InputError(
                "scenario: gripper tilts must satisfy 0 < tilt_lower <= tilt_upper <= pi/2, "
                f"got {self.gripper.tilt_lower:g} and {self.gripper.tilt_upper:g}"
            )
        if min(dc.astuple(self.clearance)) < 0.0:
            raise InputError("scenario: clearances must not be negative")
        if len(self.table.size) != 2 or min(self.table.size) <= 0.0:
            raise InputError("scenario: table size needs two positive lengths (x, y)")


def load_scenario(path: str | Path | None = None, name: str | None = None) -> Scenario:
    """Read a scenario file (the shipped Glasgow cell if no path is given).

    Args:
        path: a `*.scenario.yaml`, one or more named scenarios in it.
        name: which of them; may be left out where there is only one.

    Raises:
        InputError: missing file, unknown key, unknown name, a value out of range.
    """
    path = models_dir() / "clopema.scenario.yaml" if path is None else Path(path)
    names = scenario_names(path)
    if name is None:
        if len(names) != 1:
            raise InputError(f"{path}: name one of its scenarios: {', '.join(names)}")
        name = names[0]
    if name not in names:
        raise InputError(f"{path}: no scenario '{name}'; it has {', '.join(names)}")
    scenario = load_yaml(path, Scenario, child=name)
    scenario.validate()
    return scenario


def scenario_names(path: str | Path) -> list[str]:
    """Names of the scenarios in a file, in its order.

    Raises:
        InputError: the file is missing, or is no YAML mapping.
    """
    try:
        document = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; give a *.scenario.yaml") from None
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"{path}: cannot be read as YAML: {reason}") from None
    if not isinstance(document, dict) or not document:
        raise InputError(f"{path}: needs at least one named scenario, see clopema.scenario.yaml")
    return [str(key) for key in document]


def resolve(uri: str) -> Path:
    """Path of a `package://unwrinkle_models/...` address or of a plain file.

    Raises:
        InputError: the file does not exist.
    """
    prefix = "package://unwrinkle_models/"
    path = models_dir() / uri[len(prefix) :] if uri.startswith(prefix) else Path(uri)
    if not path.is_file():
        raise InputError(f"{uri}: no such file; give a path or {prefix}FILE")
    return path
