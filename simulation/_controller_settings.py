"""What differs between virtual controllers, and what one remembers."""

from dataclasses import dataclass

from unwrinkle.models.errors import InputError


@dataclass(frozen=True)
class VirtualControllerSettings:
    """What differs between controllers. Times in s, angles in rad.

    Attributes:
        period: of interpolation. ASSUMED 4 ms, common on a DX100, which reads it at run time.
        depth: increments that a group's queue holds.
        start_pulses: most that a first point may lie off.
        pulses_per_radian: of each axis. ASSUMED: 30 pulses are 1 mrad.
        braking: of servos whose commands have ended, rad/s^2. ASSUMED, for every axis.
        servo_time: until the servos are on. ASSUMED.
        job_time: until the job waits for points. ASSUMED.
        accepts: points as "groups" (one message each), "ex" (one for all) or "both".
        synchro: whether it knows `CHECK_SYNCHRO`, as the CloPeMa controller does.
        stamps: whether feedback carries the controller's time.
        possible_early: whether `motion_possible` is told as soon as trajectory mode could be started. ASSUMED; if
            not, only when it is.
        feedback_period: between two sets of feedback.
        keep: messages, points and periods that are remembered, each.
    """

    period: float = 0.004
    depth: int = 200
    start_pulses: float = 30.0
    pulses_per_radian: float = 30000.0
    braking: float = 10.0
    servo_time: float = 0.3
    job_time: float = 0.1
    accepts: str = "both"
    synchro: bool = False
    stamps: bool = True
    possible_early: bool = True
    feedback_period: float = 0.025
    keep: int = 20000

    def __post_init__(self) -> None:
        """Refuse settings that no controller has."""
        if self.accepts not in ("groups", "ex", "both"):
            raise InputError(f"virtual controller: accepts '{self.accepts}'; groups, ex or both")
        for name in ("period", "pulses_per_radian", "braking", "feedback_period"):
            if not getattr(self, name) > 0.0:
                raise InputError(f"virtual controller: {name} must be positive")
        if self.depth < 1 or self.keep < 1:
            raise InputError("virtual controller: depth and keep must be at least 1")


@dataclass(frozen=True)
class AcceptedPoint:
    """A trajectory point that was accepted.

    Attributes:
        clock: the controller's, s.
        sequence: of the point.
        time: from the trajectory's begin, s.
        positions, velocities: of the group's axes, rad and rad/s.
    """

    clock: float
    sequence: int
    time: float
    positions: tuple[float, ...]
    velocities: tuple[float, ...]
