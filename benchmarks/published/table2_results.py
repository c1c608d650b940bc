"""The results of Table II."""

from dataclasses import dataclass

from benchmarks.published.figures import RunFigures
from benchmarks.published.loop_trials import LoopTrial


@dataclass(frozen=True)
class PublishedCell:
    """A published cell: required number of iterations, and share of dual-arm plans."""

    rni_mean: float
    rni_std: float
    dual_success: float | None


@dataclass(frozen=True, kw_only=True)
class CellFigures(RunFigures):
    """Figures of one cell of the table.

    Attributes:
        rni_truth_mean, rni_truth_std, rni_truth_interval: of the actions until the cloth's highest
            point was at most 5 mm, over the runs in which it came to that.
        dual_wanted: motions for two arms that were looked for.
        dual_success, dual_interval: share that was found and verified, with its 95 % interval.
        coverage_start: mean.
        height_median: at the end, m.
        action_seconds_median, stage_seconds_median: of an action, and by its stages.
    """

    rni_truth_mean: float | None
    rni_truth_std: float | None
    rni_truth_interval: tuple[float, float] | None
    dual_wanted: int
    dual_success: float | None
    dual_interval: tuple[float, float] | None
    coverage_start: float
    height_median: float
    action_seconds_median: float
    stage_seconds_median: dict[str, float]


@dataclass(frozen=True)
class OrderKept:
    """Whether each cell needs more actions than the one before; None where one has no figure."""

    rni_mean: bool | None
    rni_truth_mean: bool | None


@dataclass(frozen=True)
class Table2Result:
    """Crumpled towels in the cells of the table.

    Attributes:
        trials_wall: time of all runs, s.
        starts: seeds.
        most_actions: of a run.
        cells: by name, those beside the published table last.
        published: by name of the cell.
        order_kept: of the published cells, by detector and by truth.
        runs: by name of the cell.
    """

    trials_wall: float
    starts: tuple[int, ...]
    most_actions: int
    cells: dict[str, CellFigures]
    published: dict[str, PublishedCell]
    order_kept: OrderKept
    runs: dict[str, tuple[LoopTrial, ...]]
