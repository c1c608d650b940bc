"""The results of the benchmark `garments`."""

from dataclasses import dataclass

from benchmarks.harness.statistics import Spread
from benchmarks.harness.trials import KeptTrial
from benchmarks.published.loop_trials import Look


@dataclass(frozen=True, kw_only=True)
class StartMade:
    """Whether a start could be made, and why not."""

    made: bool
    reason: str


@dataclass(frozen=True, kw_only=True)
class StartTrial(KeptTrial, StartMade):
    """A start that was tried."""


@dataclass(frozen=True, kw_only=True)
class PolicyRun:
    """A run of a baseline policy.

    Attributes:
        status, reason: how it ended.
        actions: that it had.
        coverages, heights, overstretch: before the first and after every action; heights in m.
        idle: actions for which the policy knew nothing to do.
        empty: hands that closed on nothing.
        broken: pulls that the cloth's solver could not follow: the cloth lay as before.
    """

    status: str
    reason: str
    actions: int
    coverages: tuple[float, ...]
    heights: tuple[float, ...]
    overstretch: tuple[float, ...]
    idle: int = 0
    empty: int = 0
    broken: int = 0


@dataclass(frozen=True, kw_only=True)
class GarmentTrial(KeptTrial, PolicyRun):
    """A run of a baseline policy, or of the loop.

    Attributes:
        rni_truth, dual, single, missed, dual_wanted, dual_found, looks: of the loop, see `LoopRun`.
        moved: way of the garment's middle over the table, m.
        hanging: share that hangs over the table's edge at the end.
    """

    rni_truth: int | None = None
    dual: int = 0
    single: int = 0
    missed: int = 0
    dual_wanted: int = 0
    dual_found: int = 0
    looks: tuple[Look, ...] = ()
    moved: float = 0.0
    hanging: float = 0.0


@dataclass(frozen=True, kw_only=True)
class MethodFigures:
    """Figures of one method over runs; a run that ended early keeps its last value.

    Attributes:
        runs: how many.
        coverage: by count of actions.
        improvement: by count of actions; None where no start lacked anything.
        success: runs whose last coverage is a success; success_ever, success_at_start: any, the
            first.
        first_success: action that first reached it.
        best: highest coverage of a run.
        height, height_max: at the end, m.
        actions: used.
        moved, hanging_max: as of `GarmentTrial`.
        overstretch_max: after any action.
        broken, idle, empty, missed, dual: sums over the runs.
        ended: how many by status.
        wall: mean, s.
    """

    runs: int
    coverage: dict[int, Spread]
    improvement: dict[int, Spread | None]
    success: int
    success_ever: int
    success_at_start: int
    first_success: Spread | None
    best: Spread | None
    height: Spread | None
    height_max: float
    actions: Spread | None
    moved: Spread | None
    hanging_max: float
    overstretch_max: float
    broken: int
    idle: int
    empty: int
    missed: int
    dual: int
    ended: dict[str, int]
    wall: float


@dataclass(frozen=True)
class LeftOut:
    """A start that was left out, and why."""

    start: str
    reason: str


@dataclass(frozen=True)
class PublishedCoverage:
    """A published result on other starts, cloths and simulators.

    Attributes:
        start: kind of start that it is nearest to.
        label, source: of it.
        coverage: lower and upper end.
        action: that it was reached at.
    """

    start: str
    label: str
    source: str
    coverage: tuple[float, float | None]
    action: int | None


@dataclass(frozen=True)
class GarmentsResult:
    """Four garments, every method from the same starts.

    Attributes:
        trials_wall: time of all runs, s.
        garments, starts, methods: names.
        seeds: by start and garment.
        starts_left_out: those that could not be made.
        most_actions: of a run.
        counts: of actions, in the tables.
        success_coverage: that is a success.
        unpaired: starts that differ between methods.
        cells: figures by start, garment and method.
        overall: figures by start and method.
        published: in other worlds.
        runs: all.
    """

    trials_wall: float
    garments: tuple[str, ...]
    starts: tuple[str, ...]
    methods: tuple[str, ...]
    seeds: dict[str, tuple[int, ...]]
    starts_left_out: tuple[LeftOut, ...]
    most_actions: int
    counts: tuple[int, ...]
    success_coverage: float
    unpaired: tuple[str, ...]
    cells: dict[str, dict[str, dict[str, MethodFigures]]]
    overall: dict[str, dict[str, MethodFigures]]
    published: tuple[PublishedCoverage, ...]
    runs: tuple[GarmentTrial, ...]
