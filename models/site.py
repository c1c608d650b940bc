"""A site: addresses and parameters of one laboratory's devices, read from one typed YAML file."""

import dataclasses as dc
from collections.abc import Sequence
from dataclasses import field
from math import isfinite
from pathlib import Path

from unwrinkle.models.errors import InputError
from unwrinkle.models.io.loader_yaml import load_yaml, models_dir
from unwrinkle.models.io.settings import check_finite, with_settings

PROFILES = ("groups", "ex")
SYNCHRO = ("off", "start", "each")
VELOCITIES = ("differences", "reported")
GROUPS = ("r1", "r2", "ext_axis")
#: Kind of a device that a site does not have.
NO_DEVICE = "none"
#: Greatest latency that a site may state, s.
LONGEST_LATENCY = 1.0
#: Encoder pulses of the turn-table and of an arm's S, L, U, R, B, T, 1/rad: what 30 pulses are on
#: the real controller (0.31; 0.365, 0.40, 0.38, 0.53, 0.64, 1.49 mrad). ASSUMED for the turn-table.
PULSES_PER_RADIAN = (96774.0, 82192.0, 75000.0, 78947.0, 56604.0, 46875.0, 20134.0)


@dc.dataclass
class ControllerSite:
    """Addresses and parameters of the robot's controller and its driver.

    Times in s, angles in rad.
    """

    host: str = "127.0.0.1"
    motion_port: int = 50240
    state_port: int = 50241
    # Asked only where the grippers are the controller's outputs; no firmware before MotoROS 1.6.0
    # has it.
    io_port: int = 50242
    # groups: one JOINT_TRAJ_PT_FULL per group (the CloPeMa controller of 2013). ex: one
    # JOINT_TRAJ_PT_FULL_EX for all.
    profile: str = "groups"
    # Command 200103 of the CloPeMa controller: off, start (before a trajectory's first point) or
    # each (before every point). ASSUMED off: stock controllers do not know it.
    synchro: str = "off"
    # What the controller's groups 0, 1, 2 are. From the CloPeMa client.
    groups: list[str] = field(default_factory=lambda: ["r1", "r2", "ext_axis"])
    # Groups that the firmware moves. It takes points of the others and drops them: MotoROS as
    # published moves r1 and r2 alone on a DX100. ASSUMED: all three, as CloPeMa's.
    groups_moved: list[str] = field(default_factory=lambda: ["r1", "r2", "ext_axis"])
    # Share of an axis' speed above which the controller refuses a point (its speed governor,
    # parameter RCnG147). ASSUMED: 0.4, of CloPeMa's own parameter file.
    speed_cap: float = 0.4
    # differences of positions, or as reported: feedback of controllers before MotoROS 1.8.0 is
    # scaled wrongly.
    velocities: str = "differences"
    connect_timeout: float = 3.0
    reply_timeout: float = 0.5
    # A point is sent again after busy_retry, for at most busy_limit. The controller is busy for up
    # to one interpolation period after every point.
    busy_retry: float = 0.002
    busy_limit: float = 2.0
    # Servo on, and the INFORM job ready.
    start_timeout: float = 8.0
    # The controller's; 25 ms by its source.
    feedback_period: float = 0.025
    # Feedback older than this: hold; older than that: fault.
    hold_after: float = 0.10
    fault_after: float = 0.25
    # Greatest permitted delay between a point's time and its appearance in the feedback. ASSUMED:
    # 0.15 s were measured on a DX100, 0.25 s on a DX200 (ros-industrial/motoman issues 219, 252).
    latency: float = 0.25
    # Largest distance of an axis from its path, the lag taken out. ASSUMED.
    following: float = 0.02
    # Largest distance of an axis from a trajectory's first sample: start_tolerance, and the
    # controller's own, in pulses (30; 10 before MotoROS 1.8.2). Pulses of a radian: turn-table,
    # then S, L, U, R, B, T of both arms.
    start_tolerance: float = 3e-4
    start_pulses: float = 30.0
    pulses_per_radian: list[float] = field(default_factory=lambda: list(PULSES_PER_RADIAN))
    # Streaming horizon: points are sent this far ahead. Also the longest host delay tolerated, and
    # the motion that a hold cannot cancel.
    lead: float = 0.12
    # A poll of the driver that comes later than this is late; so many late ones are a fault.
    late: float = 0.05
    late_budget: int = 20
    # Rest between two trajectories; multi-group controllers need 0.3 s (ros-industrial/motoman
    # issue 185).
    pause: float = 0.3

    @property
    def start_tolerances(self) -> list[float]:
        """Largest distance of each axis from a trajectory's first sample, (13,) rad.

        Turn-table, right arm, left arm.
        """
        each = [
            min(self.start_tolerance, self.start_pulses / pulses)
            for pulses in self.pulses_per_radian
        ]
        return [*each, *each[1:]]


@dc.dataclass
class GripperSite:
    """Addresses and parameters of the grippers; lists are right, left."""

    # none, digital (outputs of the controller), can, or module:function of another driver; see
    # `hardware.grippers`.
    kind: str = NO_DEVICE
    # digital: address of the output that closes, of the inputs that say closed and holding cloth
    # (0: there is none), and whether the output is inverted. ASSUMED: the addresses of the CloPeMa
    # cell are not public.
    close_output: list[int] = field(default_factory=lambda: [10010, 10011])
    closed_input: list[int] = field(default_factory=lambda: [0, 0])
    holding_input: list[int] = field(default_factory=lambda: [0, 0])
    inverted: list[bool] = field(default_factory=lambda: [True, True])
    # can: python-can's interface and channel; limb codes from the CloPeMa gripper's protocol (1
    # right, 0 left).
    interface: str = "pcan"
    channel: str = "PCAN_USBBUS1"
    bitrate: int = 1000000
    limbs: list[int] = field(default_factory=lambda: [1, 0])
    # Duration of a stroke, s: without a sensor it counts as done then, with a sensor not before.
    stroke_time: float = 0.75
    # Answer timeout of a gripper, s; beyond it the gripper counts as lost.
    timeout: float = 3.0
    # Settings of a kind that has others than these, by name.
    options: dict[str, str] = field(default_factory=dict)


@dc.dataclass
class PanTiltSite:
    """The head's two pan-tilt units."""

    # Serial ports; empty: no such unit.
    left: str = ""
    right: str = ""
    baud: int = 9600
    # Timeouts of an answer and of a motion, s.
    reply_timeout: float = 1.0
    motion_timeout: float = 6.0
    # Delay of pictures after a motion, in which the mount stops swinging, s. ASSUMED.
    settle: float = 0.3


@dc.dataclass
class CameraSite:
    """The cameras of the stereo head."""

    # none, folder (pairs in order), watch (the newest pair), opencv, gphoto2, openni2, or
    # module:class of another driver; see `hardware.cameras`.
    kind: str = NO_DEVICE
    # folder, watch: where left*.png and right*.png appear. opencv: device numbers or addresses.
    # gphoto2: USB ports.
    left: str = ""
    right: str = ""
    folder: str = ""
    # Timeout of one exposure of the pair, s; attempts at it; greatest time between the two eyes'
    # exposures, s.
    timeout: float = 20.0
    attempts: int = 2
    skew: float = 1.0
    # Settings of a kind that has others than these, by name.
    options: dict[str, str] = field(default_factory=dict)


@dc.dataclass
class Site:
    """One laboratory's equipment.

    See models/data/sites/example.site.yaml for the meaning of every key.
    """

    name: str = "unnamed"
    # The cell's scenario (robot, tables, clearances); empty: the shipped one.
    scenario: str = ""
    # Speed fraction of what is executed, of the limits; the first run of a plan is slower under
    # commissioning.
    speed: float = 0.2
    # Commissioning: tips at most 0.25 m/s, doubled clearances, the first run of a plan at 10 %, a
    # dead-man key.
    commissioning: bool = True
    # The head's calibration, its greatest age in days, and the greatest residual in pixels.
    calibration: str = ""
    calibration_days: int = 180
    calibration_residual: float = 0.5
    # True for virtual equipment alone: allows the nominal calibration.
    virtual: bool = False
    controller: ControllerSite = field(default_factory=ControllerSite)
    grippers: GripperSite = field(default_factory=GripperSite)
    pan_tilt: PanTiltSite = field(default_factory=PanTiltSite)
    cameras: CameraSite = field(default_factory=CameraSite)

    def validate(self) -> None:
        """Refuse values out of range.

        Raises:
            InputError: naming the key and what to give.
        """
        self._validate_choices()
        self._validate_groups()
        self._validate_numbers()
        self._validate_controller()
        g = self.grippers
        if not 0.0 < self.speed <= 1.0:
            raise InputError(f"site: speed is {self.speed:g}; give a fraction above 0, up to 1")
        for name in ("close_output", "closed_input", "holding_input", "inverted", "limbs"):
            if len(getattr(g, name)) != 2:
                raise InputError(f"site: grippers.{name} needs two values, right and left")
        if self.calibration_days < 1 or not self.calibration_residual > 0.0:
            raise InputError("site: calibration_days and calibration_residual must be positive")
        check_finite(self, "site")

    def _validate_choices(self) -> None:
        c = self.controller
        if c.profile == "clopema13":
            raise InputError(
                "site: controller.profile 'clopema13' (one message of 13 joints, CloPeMa's public "
                "firmware of 2014) is not supported: that firmware answers success although a "
                "group was still busy and its point was lost, so that the arms may part; install "
                "a MotoROS with control groups, and use 'ex' or 'groups'"
            )
        for what, value, known in (
            ("controller.profile", c.profile, PROFILES),
            ("controller.synchro", c.synchro, SYNCHRO),
            ("controller.velocities", c.velocities, VELOCITIES),
        ):
            if value not in known:
                raise InputError(f"site: {what} '{value}' is unknown; known: {', '.join(known)}")

    def _validate_groups(self) -> None:
        c = self.controller
        if sorted(c.groups) != sorted(GROUPS):
            raise InputError(
                f"site: controller.groups must name {', '.join(GROUPS)} once each, got {c.groups}"
            )
        moved = c.groups_moved
        if not moved or not set(moved) <= set(GROUPS) or len(set(moved)) != len(moved):
            raise InputError(
                f"site: controller.groups_moved must name some of {', '.join(GROUPS)}, each once, "
                f"got {moved}"
            )

    def _validate_numbers(self) -> None:
        c, g = self.controller, self.grippers
        for part, label in (
            (c, "controller"),
            (g, "grippers"),
            (self.pan_tilt, "pan_tilt"),
            (self.cameras, "cameras"),
        ):
            for item in dc.fields(part):
                value = getattr(part, item.name)
                if isinstance(value, float) and not (isfinite(value) and value >= 0.0):
                    raise InputError(
                        f"site: {label}.{item.name} is {value}; give a number of 0 or more"
                    )

    def _validate_controller(self) -> None:
        c = self.controller
        if not c.latency <= LONGEST_LATENCY:
            raise InputError(
                f"site: controller.latency is {c.latency:g} s; give at most {LONGEST_LATENCY:g} s, "
                "a longer one would hide an axis that stands still"
            )
        if not 0.0 < c.speed_cap <= 1.0:
            raise InputError(
                f"site: controller.speed_cap is {c.speed_cap:g}; give a share of the axes' speed, "
                "above 0, up to 1"
            )
        pulses = c.pulses_per_radian
        if len(pulses) != 7 or not all(isfinite(value) and value > 0.0 for value in pulses):
            raise InputError(
                "site: controller.pulses_per_radian needs 7 positive numbers: turn-table, S, L, U, "
                "R, B, T"
            )
        if not (c.start_tolerance > 0.0 and c.start_pulses > 0.0):
            raise InputError(
                "site: controller.start_tolerance and start_pulses must be positive, got "
                f"{c.start_tolerance:g} rad and {c.start_pulses:g} pulses"
            )
        if not c.host:
            raise InputError("site: controller.host is empty; give the controller's address")
        for name in ("motion_port", "state_port", "io_port"):
            if not 0 < getattr(c, name) < 65536:
                raise InputError(f"site: controller.{name} is {getattr(c, name)}; give 1 to 65535")
        if not 2.0 * c.feedback_period <= c.hold_after < c.fault_after:
            raise InputError(
                "site: controller.hold_after must be at least two feedback periods and below "
                f"fault_after, got {c.hold_after:g} and {c.fault_after:g} s"
            )
        if not 0.04 <= c.lead <= 0.5:
            raise InputError(f"site: controller.lead is {c.lead:g} s; give 0.04 to 0.5")


def load_site(path: str | Path, *, settings: Sequence[str] = ()) -> Site:
    """Read a site file.

    Args:
        path: a `*.site.yaml`.
        settings: changes of the file's values, e.g. `("controller.lead=0.1",)`.

    Raises:
        InputError: missing file, unknown key, a value out of range.
    """
    site = with_settings(load_yaml(path, Site), settings)
    try:
        site.validate()
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    return site


def loopback_site() -> Site:
    """Load the shipped site of virtual equipment on this machine."""
    return load_site(models_dir() / "sites" / "loopback.site.yaml")
