"""Settings of a virtual controller, and the record of a point that it accepted."""

from dataclasses import dataclass
from enum import StrEnum
from math import isfinite

from unwrinkle.models.errors import InputError
from unwrinkle.models.site import GROUPS, PULSES_PER_RADIAN, ControllerSite


class Firmware(StrEnum):
    """Versions of MotoROS that the virtual controller imitates."""

    MOTOROS_1_9_12 = "1.9.12"
    OF_2013 = "2013"


@dataclass(frozen=True)
class VirtualControllerSettings:
    """Properties in which controllers differ. Times in s, angles in rad.

    Attributes:
        firmware: see `Firmware`. That of 2013 accepts one message per read, replies to DISCONNECT,
            keeps the older of two clients, sends no reason why it is not ready, and hold does not
            empty the queues.
        period: of interpolation, whole ms. ASSUMED 4 ms, common on a DX100, which reads it at run
            time; CloPeMa's own file states 8 ms.
        delay: from an increment to the axes' motion and its feedback; at least 0.15 s was measured
            on a DX100 (ros-industrial/motoman issue 219).
        depth: increments that a group's queue holds.
        start_pulses: largest distance of a first point, pulses.
        pulses_per_radian: of the turn-table and of S, L, U, R, B, T of both arms, (7,).
        speed_cap: share of the axes' speed above which a point, its speed cut to whole rad/s, is
            refused (parameters RCnG147).
        moved: groups whose increments are sent to the servos, of "r1", "r2", "ext_axis"; the queue
            of another group is not read any more after its first motion.
        braking: deceleration of servos without commands, rad/s^2. ASSUMED, for every axis.
        servo_time: until the servos are on. ASSUMED.
        job_time: until the job waits for points. ASSUMED.
        leaving: time for which the queues are still run after the motion connection has ended.
        accepts: points as "groups" (one message each), "ex" (one for all) or "both".
        synchro: whether `CHECK_SYNCHRO` is known, as on the CloPeMa controller.
        stamps: whether feedback carries the controller's time; MotoROS never sends it.
        feedback_period: between two sets of feedback.
        keep: limit of stored messages, points and periods, each.
    """

    firmware: str = Firmware.MOTOROS_1_9_12
    period: float = 0.004
    delay: float = 0.15
    depth: int = 200
    start_pulses: float = 30.0
    pulses_per_radian: tuple[float, ...] = PULSES_PER_RADIAN
    speed_cap: float = 1.0
    moved: tuple[str, ...] = GROUPS
    braking: float = 10.0
    servo_time: float = 0.3
    job_time: float = 0.1
    leaving: float = 0.05
    accepts: str = "both"
    synchro: bool = False
    stamps: bool = False
    feedback_period: float = 0.025
    keep: int = 20000

    def __post_init__(self) -> None:
        """Check the settings."""
        if self.firmware not in set(Firmware):
            raise InputError(
                f"virtual controller: firmware '{self.firmware}'; {' or '.join(Firmware)}"
            )
        if self.accepts not in ("groups", "ex", "both"):
            raise InputError(f"virtual controller: accepts '{self.accepts}'; groups, ex or both")
        for name in ("period", "braking", "feedback_period", "speed_cap"):
            if not getattr(self, name) > 0.0:
                raise InputError(f"virtual controller: {name} must be positive")
        if len(self.pulses_per_radian) != 7 or not min(self.pulses_per_radian) > 0.0:
            raise InputError("virtual controller: pulses_per_radian needs 7 positive numbers")
        if abs(1e3 * self.period - round(1e3 * self.period)) > 1e-9:
            raise InputError("virtual controller: period must be whole milliseconds")
        if not (isfinite(self.delay) and self.delay >= 0.0):
            raise InputError(f"virtual controller: delay is {self.delay}; give 0 or more")
        if unknown := set(self.moved) - set(GROUPS):
            raise InputError(f"virtual controller: moved has unknown groups: {', '.join(unknown)}")
        if self.depth < 1 or self.keep < 1:
            raise InputError("virtual controller: depth and keep must be at least 1")

    @classmethod
    def of_site(cls, site: ControllerSite) -> "VirtualControllerSettings":
        """Return the settings of the controller that a site describes."""
        return cls(
            accepts=site.profile,
            synchro=site.synchro != "off",
            start_pulses=site.start_pulses,
            pulses_per_radian=tuple(site.pulses_per_radian),
            speed_cap=site.speed_cap,
            moved=tuple(site.groups_moved),
        )


@dataclass(frozen=True)
class AcceptedPoint:
    """An accepted trajectory point.

    Attributes:
        clock: of the controller, s.
        sequence: of the point.
        time: from the trajectory's begin, as sent, s.
        positions, velocities: of the group's axes, rad and rad/s.
    """

    clock: float
    sequence: int
    time: float
    positions: tuple[float, ...]
    velocities: tuple[float, ...]

    @property
    def milliseconds(self) -> int:
        """Time that the controller uses, cut to whole ms."""
        return int(1000.0 * self.time)
