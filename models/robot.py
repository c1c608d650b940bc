"""Numeric description of the robot, and its cell as a Drake plant."""

import dataclasses as dc
import hashlib
import math
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import cast

import numpy as np
from numpy.typing import NDArray
from pydrake.multibody.parsing import (
    LoadModelDirectives,
    ModelDirective,
    ModelDirectives,
    PackageMap,
    Parser,
    ProcessModelDirectives,
)
from pydrake.multibody.plant import MultibodyPlant
from pydrake.planning import RobotDiagram, RobotDiagramBuilder

from unwrinkle.models.errors import InputError
from unwrinkle.models.garment import KnownGarment, load_garment
from unwrinkle.models.io.loader_yaml import load_yaml, models_dir
from unwrinkle.models.io.model_files import files_named_by
from unwrinkle.models.limits import Limits, load_limits
from unwrinkle.models.scenario import Scenario, load_scenario, resolve
from unwrinkle.models.table import Table

#: Greatest difference of a direction cosine from 1 at which the table counts as aligned with the
#: world's axes: 1.4 mrad.
_ALONG_AXES = 1e-6


@dataclass
class DenavitHartenberg:
    """One row of the standard (distal) convention: rad and m."""

    alpha: float = math.nan
    a: float = math.nan
    offset: float = math.nan
    d: float = math.nan


@dataclass
class ArmDescription:
    """One arm with its gripper."""

    # As plans, messages and files call it.
    name: str = ""
    # Model instances of the arm and of its gripper.
    model: str = ""
    gripper: str = ""
    # Indices of its axes in `RobotDescription.axes`, from the base to the flange.
    axes: list[int] = field(default_factory=list)


@dataclass
class RobotDescription:
    """Schema of robot.yaml; lengths in m, angles in rad."""

    name: str = ""
    axes: list[str] = field(default_factory=list)
    grippers: list[str] = field(default_factory=list)
    head: list[str] = field(default_factory=list)
    denavit_hartenberg: list[DenavitHartenberg] = field(default_factory=list)
    turntable_height: float = math.nan
    turntable_yaw: float = math.nan
    arm_offset: float = math.nan
    arm_height: float = math.nan
    arm_cant: float = math.nan
    tool_offset: float = math.nan
    tool_yaw: float = math.nan
    tcp_offset: float = math.nan
    turntable_axis: int = -1
    arms: list[ArmDescription] = field(default_factory=list)
    # Links with a clearance of their own from the working table, by name within a gripper's model
    # instance.
    palm: str = ""
    fingers: list[str] = field(default_factory=list)
    # Pairs of links (scoped names) that are near in every posture and need no clearance.
    adjacent: list[list[str]] = field(default_factory=list)
    named_states: dict[str, list[float]] = field(default_factory=dict)

    @property
    def instances(self) -> list[str]:
        """Model instances that the robot consists of."""
        joints = [*self.axes, *self.grippers, *self.head]
        return list(dict.fromkeys(scoped(name)[0] for name in joints))

    def arm_of(self, instance: str) -> int | None:
        """Index of the arm that a model instance belongs to.

        None if it belongs to no arm or gripper.
        """
        for i, arm in enumerate(self.arms):
            if instance in (arm.model, arm.gripper):
                return i
        return None


@dataclass(frozen=True, eq=False)
class Cell:
    """A scenario with the robot's description and limits that it names, and the hash of the model
    files.

    Attributes:
        scenario: settings of the scenario.
        robot: description of the robot.
        limits: of the robot's axes, at the scenario's speed fraction.
    """

    scenario: Scenario
    robot: RobotDescription
    limits: Limits

    @cached_property
    def garment(self) -> KnownGarment | None:
        """The garment as it is when flat, of the scenario's `known_garment`; None without one.

        Raises:
            InputError: the file is missing or wrong.
        """
        path = self.scenario.known_garment
        return load_garment(path) if path else None

    @cached_property
    def robot_hash(self) -> str:
        """SHA-256 (hex) over every file and setting that determines the bodies and clearances of
        the cell, meshes included.

        Raises:
            InputError: a file that another one names is missing.
        """
        digest = hashlib.sha256()
        digest.update(resolve(self.scenario.robot).read_bytes())
        packages = PackageMap()
        packages.AddPackageXml(str(models_dir() / "package.xml"))
        waiting = [resolve(uri) for uri in self.scenario.directives]
        for path in waiting:  # the loop appends the files that directives and models name
            digest.update(path.read_bytes())
            if path.suffix != ".yaml":
                waiting += files_named_by(path, packages.ResolveUrl)
                continue
            for directive in _directives(path):
                for item in (directive.add_model, directive.add_directives):
                    if item is not None:
                        waiting.append(Path(packages.ResolveUrl(item.file)))
        settings = dc.asdict(self.scenario)
        for key in ("gaze", "gripper", "clearance", "table"):
            digest.update(repr(settings[key]).encode())
        return digest.hexdigest()

    @cached_property
    def limits_hash(self) -> str:
        """SHA-256 (hex) over the limits as used."""
        digest = hashlib.sha256()
        for item in dc.fields(self.limits):
            value = getattr(self.limits, item.name)
            digest.update(
                value.tobytes() if isinstance(value, np.ndarray) else repr(value).encode()
            )
        return digest.hexdigest()

    @cached_property
    def diagram(self) -> RobotDiagram:
        """The cell's plant and scene graph, built once, for questions that change neither."""
        return build_robot_diagram(self)

    @cached_property
    def table_pose(self) -> NDArray[np.float64]:
        """Pose (4, 4) in the world of the working table's top surface.

        Origin at its centre, z up, m.
        """
        plant = self.diagram.plant()
        instance, name = scoped(self.scenario.table.frame)
        frame = plant.GetFrameByName(name, plant.GetModelInstanceByName(instance))
        X_WS = frame.CalcPoseInWorld(plant.CreateDefaultContext()).GetAsMatrix4()
        return np.asarray(X_WS)

    @cached_property
    def table(self) -> Table:
        """The working table's top, with its size along world x and y.

        Raises:
            InputError: the table is not level, or its sides are not along the world's axes.
        """
        R_WS = self.table_pose[:3, :3]
        if min(abs(R_WS[0, 0]), R_WS[2, 2]) < 1.0 - _ALONG_AXES:
            raise InputError(
                f"scenario: the table frame {self.scenario.table.frame} is turned; perception and "
                "simulation need a level table with its sides along the world's x and y"
            )
        x, y, height = (float(value) for value in self.table_pose[:3, 3])
        across, along = self.scenario.table.size
        return Table((x, y), (across, along), height)

    def beyond_table(self, places: NDArray[np.float64]) -> NDArray[np.float64]:
        """Compute how far places lie beyond the nearest edge of the working table, m; negative on
        it.

        Args:
            places: (..., 2) in the world, m.

        Returns:
            (...,)
        """
        X_WS = self.table_pose
        local = (np.asarray(places) - X_WS[:2, 3]) @ X_WS[:2, :2]
        beyond = np.abs(local) - 0.5 * np.asarray(self.scenario.table.size)
        return np.asarray(beyond.max(axis=-1))

    def with_speed(self, fraction: float) -> "Cell":
        """Load the same cell with another fraction of the catalogue velocity, acceleration and
        jerk.
        """
        if fraction == self.scenario.speed:
            return self
        return load_cell(dc.replace(self.scenario, speed=fraction))


def load_cell(scenario: Scenario | str | Path | None = None) -> Cell:
    """Load the cell of a scenario.

    Args:
        scenario: its settings, or its file; None for the shipped one.

    Raises:
        InputError: a file is missing, has an unknown key, or lacks a number or a role; or a value
            of the scenario is out of range.
    """
    if isinstance(scenario, Scenario):
        scenario.validate()
    else:
        scenario = load_scenario(scenario)
    robot = load_yaml(resolve(scenario.robot), RobotDescription)
    _check_robot(robot, scenario.robot)
    numbers = [getattr(robot, f.name) for f in dc.fields(robot) if f.type is float]
    numbers += [value for row in robot.denavit_hartenberg for value in dc.astuple(row)]
    if not np.all(np.isfinite(numbers)):
        raise InputError(f"{scenario.robot}: a kinematic length or angle is missing")
    cell = Cell(scenario, robot, load_limits(resolve(scenario.limits)).scaled(scenario.speed))
    _ = cell.garment  # a wrong file is told now
    return cell


def _check_robot(robot: RobotDescription, where: str) -> None:
    """Refuse a description whose axes and links have no complete set of roles.

    Raises:
        InputError: which role is missing or given twice.
    """
    if len(robot.axes) != 13 or len(robot.denavit_hartenberg) != 6:
        raise InputError(f"{where}: needs 13 axes and 6 Denavit-Hartenberg rows")
    used = [robot.turntable_axis, *(i for arm in robot.arms for i in arm.axes)]
    if len(robot.arms) != 2 or any(len(arm.axes) != 6 for arm in robot.arms):
        raise InputError(f"{where}: needs two arms, right and left, with 6 axes each")
    if sorted(used) != list(range(len(robot.axes))):
        raise InputError(
            f"{where}: turntable_axis and the arms' axes must name every index of `axes` once, got "
            f"{used}"
        )
    for arm in robot.arms:
        if not (arm.name and arm.model and arm.gripper):
            raise InputError(f"{where}: an arm needs name, model and gripper, got {arm}")
    if not robot.palm or not robot.fingers or robot.palm in robot.fingers:
        raise InputError(
            f"{where}: needs the links `palm` and `fingers` of a gripper, none of them twice"
        )
    if any(len(set(pair)) != 2 for pair in robot.adjacent):
        raise InputError(f"{where}: an entry of `adjacent` needs the names of two links")


def configure_parser(parser: Parser) -> None:
    """Register `package://unwrinkle_models/...` with a Drake parser."""
    parser.package_map().AddPackageXml(str(models_dir() / "package.xml"))


def add_cell(cell: Cell, plant: MultibodyPlant, parser: Parser) -> None:
    """Add the cell's models to a plant and set the axes' limits and default positions; before
    Finalize.

    Raises:
        InputError: a directives file cannot be parsed, or lacks an axis of the robot.
    """
    configure_parser(parser)
    for uri in cell.scenario.directives:
        path = resolve(uri)
        directives = _directives(path)
        try:
            ProcessModelDirectives(ModelDirectives(directives=directives), parser)
        except RuntimeError as error:
            raise InputError(f"{path}: not usable as model directives: {error}") from error
    limits = cell.limits
    for i, name in enumerate(cell.robot.axes):
        joint = _joint(plant, name)
        joint.set_position_limits([limits.lower[i]], [limits.upper[i]])
        joint.set_velocity_limits([-limits.velocity[i]], [limits.velocity[i]])
        joint.set_acceleration_limits([-limits.acceleration[i]], [limits.acceleration[i]])
    for name in cell.robot.grippers:
        joint = _joint(plant, name)
        joint.set_position_limits([0.0], [limits.gripper.stroke])
        joint.set_default_positions([cell.scenario.gripper.opening])
    for i, name in enumerate(cell.robot.head):
        joint = _joint(plant, name)
        row = limits.head.pan if i % 2 == 0 else limits.head.tilt
        joint.set_position_limits([row.lower], [row.upper])
        joint.set_default_positions([cell.scenario.gaze[i % 2]])


def _directives(path: Path) -> list[ModelDirective]:
    """Load the model directives of a file; relative paths in it are relative to its folder.

    Raises:
        InputError: the file is no model directives file.
    """
    try:
        directives = list(LoadModelDirectives(str(path)).directives)
    except RuntimeError as error:
        raise InputError(f"{path}: not usable as model directives: {error}") from error
    for directive in directives:
        for item in (directive.add_model, directive.add_directives):
            if item is not None and "://" not in item.file:
                item.file = (path.resolve().parent / item.file).as_uri()
    return directives


def build_robot_diagram(cell: Cell) -> RobotDiagram:
    """Build the cell as a diagram of plant and scene graph, for collision checking or display."""
    builder = RobotDiagramBuilder(time_step=0.0)
    add_cell(cell, builder.plant(), builder.parser())
    return cast(RobotDiagram, builder.Build())  # a mere object in Drake's stubs


def scoped(name: str) -> tuple[str, str]:
    """Split a scoped name into model instance and element, `r1::joint_s` -> ('r1', 'joint_s')."""
    instance, _, element = name.rpartition("::")
    return instance, element


def _joint(plant: MultibodyPlant, name: str):  # type: ignore[no-untyped-def]
    instance, element = scoped(name)
    try:
        return plant.GetJointByName(element, plant.GetModelInstanceByName(instance))
    except RuntimeError as error:
        raise InputError(f"the cell's models have no joint '{name}': {error}") from error


@dataclass(frozen=True, eq=False)
class PositionIndices:
    """Indices of the robot's joints in a plant's position vector.

    Attributes:
        axes: (axes,) in the order of `RobotDescription.axes`.
        grippers: (2,) right, left.
        head: (4,) left pan, left tilt, right pan, right tilt.
    """

    axes: NDArray[np.intp]
    grippers: NDArray[np.intp]
    head: NDArray[np.intp]


def position_indices(cell: Cell, plant: MultibodyPlant) -> PositionIndices:
    """Look up the indices of the robot's joints in a finalized plant of the cell."""

    def indices(names: list[str]) -> NDArray[np.intp]:
        return np.array([_joint(plant, name).position_start() for name in names], dtype=np.intp)

    robot = cell.robot
    return PositionIndices(indices(robot.axes), indices(robot.grippers), indices(robot.head))


def model_file(name: str) -> Path:
    """Return the path of a model file that the package ships."""
    return resolve(f"package://unwrinkle_models/{name}")
