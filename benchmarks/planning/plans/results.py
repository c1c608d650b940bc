"""The results of the benchmark `plans`."""

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Spread95:
    """Median, 95th percentile and greatest value of a sample."""

    median: float
    p95: float
    max: float


@dataclass(frozen=True, kw_only=True)
class PlannedTask:
    """One task; without a plan the values from `passed` on are empty.

    Attributes:
        group: of the task.
        dual, planned: whether there is a plan, and one for two arms.
        cause, message: why there is none for two arms.
        search, transit, timing, planning, planning_cpu, verification: times, s.
        transit_kinds: how the transits were found.
        violations: first of each plan that the verification refused.
        passed: the verdict on the plan.
        motion: time of the motion, s.
        ratio, curved_ratio: of the motion time to toppra's optimum, and of the curved pieces alone.
        line_deviation: of transit samples from their lines, rad.
        velocity_ratio, acceleration_ratio, jerk_ratio: worst, to the limits.
        velocity_ratio_sent, acceleration_ratio_sent, jerk_ratio_sent: of the samples as sent.
        clearance, clearance_pair: smallest, m.
        clearances: smallest by kind of pair, m.
    """

    group: str
    dual: bool
    planned: bool
    cause: str | None
    message: str | None
    search: float
    transit: float
    timing: float
    planning: float
    planning_cpu: float
    transit_kinds: tuple[str, ...]
    violations: tuple[str, ...]
    verification: float = 0.0
    passed: bool = False
    motion: float = 0.0
    ratio: float = 0.0
    curved_ratio: float = 0.0
    line_deviation: float = 0.0
    velocity_ratio: float = 0.0
    acceleration_ratio: float = 0.0
    jerk_ratio: float = 0.0
    velocity_ratio_sent: float = 0.0
    acceleration_ratio_sent: float = 0.0
    jerk_ratio_sent: float = 0.0
    clearance: float | None = None
    clearance_pair: str | None = None
    clearances: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class PlanFigures:
    """Figures over a set of tasks; times in s, lengths in m, ratios to limits or optima.

    Attributes:
        tasks: how many.
        dual_arm_success: share with a plan for two arms.
        single_arm_rescues: tasks with a plan for one arm alone.
        failures: cause and message.
        refused: violations by task of which a plan was refused before one passed.
        transit_kinds: how many.
    """

    tasks: int
    dual_arm_success: float
    single_arm_rescues: int
    failures: tuple[tuple[str | None, str | None], ...]
    planning_time_median: float
    planning_time_p95: float
    planning_time_max: float
    planning_time: Spread95
    planning_cpu_time: Spread95
    search_time: Spread95
    transit_time: Spread95
    timing_time: Spread95
    verification_time: Spread95
    motion_time_median: float
    motion_time_max: float
    motion_time_ratio_median: float
    motion_time_ratio_max: float
    curved_time_ratio_median: float
    curved_time_ratio_max: float
    worst_velocity_ratio: float
    worst_acceleration_ratio: float
    worst_jerk_ratio: float
    worst_velocity_ratio_sent: float
    worst_acceleration_ratio_sent: float
    worst_jerk_ratio_sent: float
    smallest_clearance: float | None
    smallest_clearance_pair: str | None
    clearances: dict[str, float]
    verdicts_passed_fraction: float
    refused: tuple[tuple[str, ...], ...]
    transit_kinds: dict[str, int]


@dataclass(frozen=True, kw_only=True)
class GroupedFigures(PlanFigures):
    """Figures over all tasks, and by their groups."""

    forward: PlanFigures
    lateral: PlanFigures
    wide: PlanFigures


@dataclass(frozen=True, kw_only=True)
class SiteFigures(PlanFigures):
    """Figures at a fraction of the catalogue speed."""

    speed: float


@dataclass(frozen=True)
class LineFigures:
    """Random straight lines at one speed.

    Attributes:
        speed: fraction of the catalogue's.
        period: of the samples, s.
        lines: how many; off: those that are left by a sample.
        deviation_max: rad.
        worst_velocity_ratio_sent, worst_acceleration_ratio_sent, worst_jerk_ratio_sent: to the
            limits.
    """

    speed: float
    period: float
    lines: int
    off: int
    deviation_max: float
    worst_velocity_ratio_sent: float
    worst_acceleration_ratio_sent: float
    worst_jerk_ratio_sent: float


@dataclass(frozen=True)
class DrakeFigures:
    """The search with SNOPT in place of the closed form; times in s."""

    tasks: int
    dual_arm_success: float
    out_of_time: int
    budget: float
    search_time_median: float
    search_time_p95: float


@dataclass(frozen=True, kw_only=True)
class RrtFigures:
    """OMPL's RRT-Connect; times in s, deviations in m.

    Attributes:
        skipped: why it was not run; empty if it was.
        stretch_max: distance of the tips over the cloth's.
    """

    tasks: int
    skipped: str = ""
    dual_arm_success: float = 0.0
    planning_time_median: float | None = None
    planning_time_max: float | None = None
    motion_time_median: float | None = None
    deviation_median: float | None = None
    deviation_max: float | None = None
    stretch_max: float | None = None


@dataclass(frozen=True, kw_only=True)
class PlansResult(GroupedFigures):
    """Dual-arm planning on the fixed set of targets.

    Attributes:
        off_table: targets that were left out, since a grasp or put-down point lies beside the table.
        site_speed, turntable_fixed, smoothing_ruckig: with one thing changed.
        random_lines: by speed.
        line_deviation_max: of these and of all plans, rad.
        drake_inverse_kinematics, ompl_rrt_connect, same_tasks: on some of the targets.
    """

    off_table: int
    site_speed: SiteFigures
    turntable_fixed: GroupedFigures
    dual_arm_success_turntable_fixed: float
    smoothing_ruckig: PlanFigures
    random_lines: tuple[LineFigures, ...]
    line_deviation_max: float
    drake_inverse_kinematics: DrakeFigures
    ompl_rrt_connect: RrtFigures
    same_tasks: PlanFigures
