"""The results of the benchmark `parity`."""

from dataclasses import dataclass


@dataclass(frozen=True)
class AgainstPlan:
    """A run beside its plan.

    Attributes:
        error: following error after the lag, rad.
        grip_distance_error: of the grippers' distance, m.
        violations: of limits and clearances.
    """

    error: float
    grip_distance_error: float
    violations: tuple[str, ...]


@dataclass(frozen=True)
class BothAgainstPlan:
    """The simulation's run and the drivers' beside the plan."""

    sim: AgainstPlan
    loopback: AgainstPlan


@dataclass(frozen=True)
class JointDifference:
    """Greatest and RMS difference of a joint, rad."""

    max: float
    rms: float


@dataclass(frozen=True)
class Differences:
    """A run beside the simulation's: lags by segment, s, and what they leave, by joint."""

    lags: dict[str, float]
    joints: tuple[JointDifference, ...]


@dataclass(frozen=True)
class ClothDistance:
    """Distances between two states of the cloth, m."""

    worst: float
    rms: float


@dataclass(frozen=True)
class ClothDistances:
    """Last states beside the simulation's: in phase, as soon as each step is done, begun later."""

    in_phase: ClothDistance
    loopback: ClothDistance
    sim_later: ClothDistance


@dataclass(frozen=True)
class Stopping:
    """Times and ways of the tips from a stop to rest, for stops all over a plan: s and m."""

    hold_time: tuple[float, ...]
    hold_way: tuple[float, ...]
    stop_time: tuple[float, ...]
    stop_way: tuple[float, ...]


@dataclass(frozen=True)
class ClosedLoop:
    """The default towel, flattened through the drivers: seconds, true height in m, coverage."""

    status: str
    actions: int
    seconds: float
    height: float
    coverage: float


@dataclass(frozen=True)
class ParityResult:
    """One plan in three forms.

    Attributes:
        seed, plan, axes, duration: of the plan; s of motion.
        against_plan: both runs.
        loopback, log: beside the simulation.
        cloth: in the end.
        stops: times of braking along the path, s, by share of the speed.
        stopping: times and ways, by share of the speed.
        closed_loop: None for a quick run.
        held: the grippers held the cloth in both.
        records, points: of the log.
    """

    seed: int
    plan: str
    axes: tuple[str, ...]
    duration: float
    against_plan: BothAgainstPlan
    loopback: Differences
    log: Differences
    cloth: ClothDistances
    stops: dict[str, tuple[float, ...]]
    stopping: dict[str, Stopping]
    closed_loop: ClosedLoop | None
    held: bool
    records: int
    points: int
