"""The scenario: robot, cell, limits and policy numbers, read from one typed YAML file."""

import dataclasses as dc
from collections.abc import Sequence
from enum import StrEnum
from math import isfinite
from pathlib import Path

import yaml

from unwrinkle.models.choices import PulledSlack, PullReading, SectionPlace
from unwrinkle.models.errors import InputError
from unwrinkle.models.io.loader_yaml import load_yaml, models_dir
from unwrinkle.models.io.settings import check_finite, with_settings

SENSOR_KINDS = ("stereo", "depth", "truth")
OUTLINES = ("towel", "dishcloth", "tshirt", "trousers")
#: Starts of a simulated garment: wrinkled, crumpled or flat, and folded.
FOLDED_STARTS = ("corner", "edge", "pressed", "pushed", "twice")
STARTS = ("bunched", "ridge", "pinched", "dropped", "flat", *FOLDED_STARTS)
ORDERS = ("volume", "pull", "height", "length", "together")
TURNTABLES = ("free", "fixed")


class StationForm(StrEnum):
    """What is behind the station's ports."""

    SIM = "sim"  # everything is simulated
    LOOPBACK = "loopback"  # the drivers, over real connections, against virtual devices
    HARDWARE = "hardware"  # the devices of a site


class Smoothing(StrEnum):
    """How the timing of curved paths bounds jerk."""

    OPTIMAL = "optimal"
    RUCKIG = "ruckig"


@dc.dataclass
class TableSettings:
    """The working table, on which garments lie."""

    # Scoped name of the frame at the centre of its top surface, z up.
    frame: str = "t2::desk"
    # Extent along world x and y, in m.
    size: list[float] = dc.field(default_factory=lambda: [0.8, 0.8])


@dc.dataclass
class GripperSettings:
    """Opening of the gripper and range of its tilt."""

    # Window of the tool's tilt below the horizontal, in rad.
    tilt_lower: float = 0.5235987755982988
    tilt_upper: float = 1.3089969389957472
    # Distance between the open blades, in m.
    opening: float = 0.030


@dc.dataclass
class Clearances:
    """Least distances between bodies, in m.

    Which links are palm and fingers is stated in robot.yaml.
    """

    arm_arm: float = 0.030
    arm_table: float = 0.020
    palm_table: float = 0.010
    # Fingers to table, except in the contact windows of a plan (there 0).
    finger_table: float = 0.010
    surroundings: float = 0.010


@dc.dataclass
class ToolSettings:
    """Limits of the tools at the working table, checked by the verification for every plan."""

    # Greatest height of a tool centre point above the table while it holds cloth, in m: cloth is
    # dragged, not lifted off.
    holding_height: float = 0.030
    # Height below which open fingers keep the two speeds below, in m.
    near_table: float = 0.010
    # Greatest speed of open fingers along the table, in m/s: cloth is pushed, not thrown.
    sliding_speed: float = 0.70
    # Greatest speed of open fingers towards the table, in m/s: they stop a few millimetres above
    # it.
    sinking_speed: float = 0.50


@dc.dataclass
class PlannerOptions:
    """Axes that the planner may move."""

    # free, or fixed: plans do not move the turn-table (for controllers that move two groups only).
    turntable: str = "free"


@dc.dataclass
class TimingSettings:
    """How motions are timed."""

    # How jerk is bounded along curved paths, from toppra's profile on: optimal (an interior-point
    # programme), or ruckig (one-axis ruckig along the path, slower motions). Straight joint lines
    # are ruckig's.
    smoothing: str = "optimal"


@dc.dataclass
class SensorSettings:
    """Sensor of the closed loop."""

    # stereo (the head), depth (the depth camera), or truth: the simulated cloth itself with the
    # noise of the head.
    kind: str = "stereo"
    # Size of the head's pictures: 1 (16 megapixels), 0.5, 0.25 or 0.125.
    scale: float = 0.5
    # Factor on the noise of the head's cameras: 1 is the sensors' noise, 0 none.
    noise: float = 1.0
    # The depth camera: model (see simulation), and its pose in the world: place in m, the image's
    # top away from the robot.
    depth_camera: str = "xtion"
    depth_camera_place: list[float] = dc.field(default_factory=lambda: [0.0, -1.10, 1.80])


@dc.dataclass
class LoopSettings:
    """Policy of the closed loop: which wrinkle, how far to pull, when to stop."""

    # Limit of actions.
    actions: int = 10
    # any (two arms if possible), dual or single.
    arms: str = "any"
    # Reading of Eq. 5: foot, paper, or between (their mean).
    mode: str = "foot"
    # Which wrinkle comes first: the one with the largest volume, pull, height or length, or the one
    # whose section crosses most of all wrinkles together.
    order: str = "volume"
    # Where the section goes through the wrinkle: its centre, or its highest part.
    section: str = "centre"
    # What is pulled out: the slack of the wrinkle (Eq. 5), or all that the section crosses.
    pull: str = "wrinkle"
    # Each hand pulls the wrinkle's distance of Eq. 5 times the gain, plus the extra, in m: cloth
    # slides and stretches.
    pull_gain: float = 1.2
    pull_extra: float = 0.004
    # A wrinkle higher than this is pulled even if its pull is below the sensor's halting pull; m.
    # The sensor's own noise bounds it from below.
    halting_height: float = 0.004
    # An action that reduces the largest wrinkle's score by less than this share counts as without
    # effect.
    least_gain: float = 0.10
    # Attempts at a grasp that misses, before the next wrinkle.
    grasp_attempts: int = 2
    # Actions in a row without effect, after which the wrinkle is abandoned; only one arm pulls; the
    # loop stops.
    idle_next_wrinkle: int = 2
    idle_one_arm: int = 3
    idle_stop: int = 4
    # Looks in a row without a usable observation, after which the loop stops.
    blind_looks: int = 2
    # Greatest thickness of one layer of a garment, m: a sensor that resolves no less sees nothing
    # of a flat garment.
    thickest_layer: float = 0.003
    # A garment with more than this share of its visible area beyond the table's edges is not
    # pulled.
    most_beyond_table: float = 0.5
    # A garment with more than this share of its outline along the table's edges hangs over them and
    # is not flat.
    most_along_edge: float = 0.22
    # Heights within this multiple of the sensor's standard deviation are no reason to pull.
    noise_multiple: float = 2.0
    # Two looks show the same wrinkle if its centre moved less than this, m, and it turned less than
    # this, rad.
    same_wrinkle_distance: float = 0.05
    same_wrinkle_angle: float = 0.6

    def validate_thresholds(self) -> None:
        """Refuse thresholds of the policy that no run can have.

        Raises:
            InputError: naming the setting and its range.
        """
        counts = ("idle_next_wrinkle", "idle_one_arm", "idle_stop", "blind_looks")
        for key in counts:
            if not 1 <= getattr(self, key) <= 100:
                raise InputError(f"scenario: loop {key} is {getattr(self, key)}; give 1 to 100")
        ranges = {
            "thickest_layer": 0.05,
            "most_beyond_table": 1.0,
            "most_along_edge": 1.0,
            "noise_multiple": 100.0,
            "same_wrinkle_distance": 1.0,
            "same_wrinkle_angle": 1.6,
        }
        for key, most in ranges.items():
            if not 0.0 <= getattr(self, key) <= most:
                raise InputError(
                    f"scenario: loop {key} is {getattr(self, key):g}; give 0 to {most:g}"
                )


@dc.dataclass
class SimulatedGarment:
    """Garment on the simulated table."""

    # towel, dishcloth, tshirt or trousers.
    outline: str = "towel"
    # Name of a file in models/data/cloths.
    material: str = "terry"
    # terry, print or plain.
    texture: str = "terry"
    # bunched, ridge, pinched, dropped or flat; or folded: corner, edge, pressed (an edge or corner
    # without a bulge), pushed (a border pushed in) or twice.
    start: str = "bunched"
    # Number of nodes along the longer side.
    nodes: int = 80


@dc.dataclass
class StationSettings:
    """Form of the station and, for a simulated one, its time steps in s and its garment."""

    # sim, loopback (the drivers, against virtual devices) or hardware.
    form: str = "sim"
    plant_step: float = 0.004
    cloth_step: float = 0.020
    feedback_period: float = 0.025
    garment: SimulatedGarment = dc.field(default_factory=SimulatedGarment)


@dc.dataclass
class Scenario:
    """One robot in one cell; see clopema.scenario.yaml for the meaning of every key."""

    directives: list[str] = dc.field(
        default_factory=lambda: ["package://unwrinkle_models/cell.dmd.yaml"]
    )
    robot: str = "package://unwrinkle_models/robot.yaml"
    limits: str = "package://unwrinkle_models/limits.yaml"
    speed: float = 1.0
    table: TableSettings = dc.field(default_factory=TableSettings)
    garment_centre: list[float] = dc.field(default_factory=lambda: [0.0, -1.10])
    # What is known of the garment: a *.garment.yaml, as `unwrinkle garment learn` writes it; empty
    # for nothing.
    known_garment: str = ""
    gaze: list[float] = dc.field(default_factory=lambda: [0.0, -0.19])
    gripper: GripperSettings = dc.field(default_factory=GripperSettings)
    clearance: Clearances = dc.field(default_factory=Clearances)
    tools: ToolSettings = dc.field(default_factory=ToolSettings)
    planner: PlannerOptions = dc.field(default_factory=PlannerOptions)
    timing: TimingSettings = dc.field(default_factory=TimingSettings)
    station: StationSettings = dc.field(default_factory=StationSettings)
    sensor: SensorSettings = dc.field(default_factory=SensorSettings)
    loop: LoopSettings = dc.field(default_factory=LoopSettings)

    def validate(self) -> None:
        """Refuse values out of range.

        Raises:
            InputError: naming the key and what to give.
        """
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
        for key, number in dc.asdict(self.tools).items():
            if not (isfinite(number) and number > 0.0):
                raise InputError(f"scenario: tools {key} is {number:g}; give a positive number")
        self._validate_loop()
        check_finite(self, "scenario")

    def _validate_loop(self) -> None:
        choices = (
            ("planner turntable", self.planner.turntable, TURNTABLES),
            ("timing smoothing", self.timing.smoothing, tuple(Smoothing)),
            ("station form", self.station.form, tuple(StationForm)),
            ("sensor kind", self.sensor.kind, SENSOR_KINDS),
            ("loop arms", self.loop.arms, ("any", "dual", "single")),
            ("loop mode", self.loop.mode, tuple(PullReading)),
            ("loop order", self.loop.order, ORDERS),
            ("loop section", self.loop.section, tuple(SectionPlace)),
            ("loop pull", self.loop.pull, tuple(PulledSlack)),
            ("garment outline", self.station.garment.outline, OUTLINES),
            ("garment start", self.station.garment.start, STARTS),
        )
        for what, value, known in choices:
            if value not in known:
                raise InputError(
                    f"scenario: {what} '{value}' is unknown; known: {', '.join(known)}"
                )
        positive = (
            ("station plant_step", self.station.plant_step, 0.01),
            ("station cloth_step", self.station.cloth_step, 0.1),
            ("station feedback_period", self.station.feedback_period, 1.0),
            ("loop halting_height", self.loop.halting_height, 1.0),
        )
        for what, number, most in positive:
            if not 0.0 < number <= most:
                raise InputError(
                    f"scenario: {what} is {number:g}; give more than 0, up to {most:g}"
                )
        if self.sensor.kind == "truth" and self.station.form == "hardware":
            raise InputError(
                "scenario: sensor kind 'truth' is the simulated cloth itself; on hardware choose "
                "stereo or depth"
            )
        if self.sensor.scale not in (1.0, 0.5, 0.25, 0.125):
            raise InputError(
                f"scenario: sensor scale is {self.sensor.scale:g}; give 1, 0.5, 0.25 or 0.125"
            )
        if not 0.0 <= self.sensor.noise <= 10.0:
            raise InputError(f"scenario: sensor noise is {self.sensor.noise:g}; give 0 to 10")
        if not 0 <= self.loop.actions <= 1000 or self.loop.grasp_attempts < 1:
            raise InputError(
                "scenario: loop actions must be 0 to 1000 and grasp_attempts at least 1, got "
                f"{self.loop.actions} and {self.loop.grasp_attempts}"
            )
        if not (1.0 <= self.loop.pull_gain <= 3.0 and 0.0 <= self.loop.pull_extra <= 0.05):
            raise InputError(
                "scenario: loop pull_gain must be 1 to 3 and pull_extra 0 to 0.05 m, got "
                f"{self.loop.pull_gain:g} and {self.loop.pull_extra:g}"
            )
        if not 0.0 <= self.loop.least_gain < 1.0:
            raise InputError(f"scenario: loop least_gain is {self.loop.least_gain:g}; give 0 to 1")
        self.loop.validate_thresholds()
        if not 20 <= self.station.garment.nodes <= 200:
            raise InputError(
                f"scenario: garment nodes is {self.station.garment.nodes}; give 20 to 200"
            )
        place = self.sensor.depth_camera_place
        if len(place) != 3 or not all(isfinite(value) for value in place):
            raise InputError("scenario: depth_camera_place needs x, y, z in m")


#: The depth camera as a body of the cell.
DEPTH_CAMERA = "package://unwrinkle_models/depth_camera.dmd.yaml"


def with_sensor(scenario: Scenario, kind: str) -> Scenario:
    """Return the scenario with another sensor; a depth camera becomes a body of the cell.

    Args:
        scenario: any.
        kind: stereo, depth or truth.

    Raises:
        InputError: the kind is unknown.
    """
    directives = [uri for uri in scenario.directives if uri != DEPTH_CAMERA]
    if kind == "depth":
        directives.append(DEPTH_CAMERA)
    sensor = dc.replace(scenario.sensor, kind=kind)
    changed = dc.replace(scenario, directives=directives, sensor=sensor)
    changed.validate()
    return changed


def shipped_scenario() -> Path:
    """Return the file of the scenario that is used where none is named: the Glasgow cell."""
    return models_dir() / "clopema.scenario.yaml"


def load_scenario(
    path: str | Path | None = None, name: str | None = None, *, settings: Sequence[str] = ()
) -> Scenario:
    """Read a scenario file (the shipped Glasgow cell if no path is given).

    Relative paths in it are relative to the folder of the file.

    Args:
        path: a `*.scenario.yaml`, one or more named scenarios in it.
        name: which of them; may be left out where there is only one.
        settings: changes of the file's values, e.g. `("loop.mode=paper",)`; see `with_settings`.

    Raises:
        InputError: missing file, unknown key, unknown name, a value out of range.
    """
    path = shipped_scenario() if path is None else Path(path)
    names = scenario_names(path)
    if path.name.endswith(".site.yaml"):
        raise InputError(f"{path}: is a site; a scenario's name ends in .scenario.yaml")
    if name is None:
        if len(names) != 1:
            raise InputError(f"{path}: name one of its scenarios: {', '.join(names)}")
        name = names[0]
    if name not in names:
        raise InputError(f"{path}: no scenario '{name}'; it has {', '.join(names)}")
    scenario = with_settings(load_yaml(path, Scenario, child=name), settings)
    scenario.validate()
    folder = path.resolve().parent
    return dc.replace(
        scenario,
        directives=[_beside(folder, uri) for uri in scenario.directives],
        robot=_beside(folder, scenario.robot),
        limits=_beside(folder, scenario.limits),
        known_garment=_beside(folder, scenario.known_garment) if scenario.known_garment else "",
    )


def _beside(folder: Path, uri: str) -> str:
    return uri if "://" in uri else str(folder / uri)


def scenario_names(path: str | Path) -> list[str]:
    """List the names of the scenarios in a file, in its order.

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
    """Return the path of a `package://unwrinkle_models/...` address or of a plain file.

    Raises:
        InputError: the file does not exist.
    """
    prefix = "package://unwrinkle_models/"
    path = models_dir() / uri[len(prefix) :] if uri.startswith(prefix) else Path(uri)
    if not path.is_file():
        raise InputError(f"{uri}: no such file; give a path or {prefix}FILE")
    return path
