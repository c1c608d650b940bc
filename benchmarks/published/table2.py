"""`unwrinkle bench table2`: crumpled towels, one or two arms, stereo head or Xtion, beside the
published Table II.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from benchmarks.harness.plots import bars, draw_cloth, save
from benchmarks.harness.report import Progress
from benchmarks.harness.statistics import mean_interval, wilson
from benchmarks.harness.trials import Trial, run_trials, trials_wall
from benchmarks.published.figures import run_figures
from benchmarks.published.loop_trials import VERTICES, LoopTrial
from benchmarks.published.table2_page import cell_name, page
from benchmarks.published.table2_results import CellFigures, OrderKept, PublishedCell, Table2Result

_XTION = {"kind": "depth", "depth_camera": "xtion"}
_STEREO = {"kind": "stereo"}
#: The published rule: the largest wrinkle first, pulled by its own slack.
_GREEDY = {"order": "volume", "section": "centre", "pull": "wrinkle"}
#: The rule that the benchmark `sensitivity` found better: the section that crosses most, pulled by all the slack
#: along it.
_TOGETHER = {"order": "together", "section": "centre", "pull": "section"}
#: What a cell of the table changes in the scenario. Its runs with two arms fall back to one where
#: there is no motion for two.
CELLS: dict[str, dict[str, Any]] = {
    "dual_stereo": {"loop": {"arms": "any", **_GREEDY}, "sensor": _STEREO},
    "single_stereo": {"loop": {"arms": "single", **_GREEDY}, "sensor": _STEREO},
    "dual_xtion": {"loop": {"arms": "any", **_GREEDY}, "sensor": _XTION},
    "single_xtion": {"loop": {"arms": "single", **_GREEDY}, "sensor": _XTION},
}
#: Not in the published table: two arms by the better rule.
OPTIONS: dict[str, dict[str, Any]] = {
    "dual_stereo_together": {"loop": {"arms": "any", **_TOGETHER}, "sensor": _STEREO},
}
_ALL = CELLS | OPTIONS
#: Published required number of iterations, mean and standard deviation, and dual-arm plans (Sun et
#: al., ICRA 2015, Table II).
PUBLISHED: dict[str, PublishedCell] = {
    "dual_stereo": PublishedCell(4.7, 0.95, 0.659),
    "single_stereo": PublishedCell(8.6, 2.99, None),
    "dual_xtion": PublishedCell(9.5, 2.07, 0.463),
    "single_xtion": PublishedCell(13.1, 2.85, None),
}
_STARTS = 10
_ACTIONS = 30  # most in a run
_WORK = "benchmarks.published.loop_trials:flattened"


def run(*, quick: bool, seed: int, progress: Progress) -> Table2Result:
    """Flatten the same crumpled towels in every cell.

    Args:
        quick: one start, at most three actions, small pictures.
        seed: of the first start; each start is a towel bunched by the seed, and the loop's own
            choices have the same seed.
        progress: told of every finished run.
    """
    starts = range(seed, seed + (1 if quick else _STARTS))
    trials = [_trial(cell, start, quick=quick) for cell in _ALL for start in starts]
    done = run_trials("table2", trials, LoopTrial, progress)
    runs = {
        cell: tuple(done[k * len(starts) : (k + 1) * len(starts)]) for k, cell in enumerate(_ALL)
    }
    cells = {cell: cell_figures(of) for cell, of in runs.items()}
    return Table2Result(
        trials_wall=trials_wall(done),
        starts=tuple(starts),
        most_actions=trials[0].settings["scenario"]["loop"]["actions"],
        cells=cells,
        published=PUBLISHED,
        order_kept=OrderKept(
            _ordered([cells[cell].rni_mean for cell in CELLS]),
            _ordered([cells[cell].rni_truth_mean for cell in CELLS]),
        ),
        runs=runs,
    )


def _trial(cell: str, seed: int, *, quick: bool) -> Trial:
    sensor = dict(_ALL[cell]["sensor"])
    if quick:
        sensor["scale"] = 0.25
    loop = {**_ALL[cell]["loop"], "actions": 3 if quick else _ACTIONS}
    settings = {
        "scenario": {"loop": loop, "sensor": sensor},
        "seed": seed,
        "start": {"kind": "bunched", "seed": seed},
    }
    return Trial(f"{cell}-{seed}", _WORK, settings)


def cell_figures(runs: Sequence[LoopTrial]) -> CellFigures:
    """Compute the figures of one cell."""
    truth = mean_interval([run.rni_truth for run in runs if run.rni_truth is not None])
    wanted = sum(run.dual_wanted for run in runs)
    found = sum(run.dual_found for run in runs)
    acted = [look for run in runs for look in run.looks if look.outcome in ("done", "missed")]
    stages = sorted({stage for look in acted for stage in look.seconds})
    return CellFigures(
        **vars(run_figures(runs)),
        rni_truth_mean=None if truth is None else truth.mean,
        rni_truth_std=None if truth is None else truth.std,
        rni_truth_interval=None if truth is None else (truth.low, truth.high),
        dual_wanted=wanted,
        dual_success=found / wanted if wanted else None,
        dual_interval=wilson(found, wanted) if wanted else None,
        coverage_start=float(np.mean([run.coverages[0] for run in runs])),
        height_median=float(np.median([run.heights[-1] for run in runs])),
        action_seconds_median=float(np.median([look.total for look in acted] or [0.0])),
        stage_seconds_median={
            stage: float(np.median([look.seconds.get(stage, 0.0) for look in acted]))
            for stage in stages
        },
    )


def _ordered(values: list[float | None]) -> bool | None:
    """Whether each cell needs more actions than the one before; None where a cell has no figure."""
    known = [value for value in values if value is not None]
    return None if len(known) < len(values) else known == sorted(known)


def table(results: Table2Result) -> str:
    """The page."""
    return page(results, list(CELLS), list(OPTIONS))


def plot(results: Table2Result, path: Path) -> None:
    """Draw the numbers of actions beside the published ones, and one start before and after in
    every cell.
    """
    cells = list(_ALL)
    figure = Figure(figsize=(13.5, 7.0), layout="constrained")
    grid = figure.add_gridspec(2, 6, height_ratios=(1.25, 1.0))
    axes = figure.add_subplot(grid[0, :])
    bars(
        axes,
        [cell_name(cell) for cell in cells],
        [results.cells[cell].rni_mean for cell in cells],
        [results.cells[cell].rni_interval for cell in cells],
        [
            (PUBLISHED[cell].rni_mean, PUBLISHED[cell].rni_std) if cell in PUBLISHED else None
            for cell in cells
        ],
        label="actions until the detector says flat",
    )
    axes.set_title(
        "Crumpled towel: actions needed. Here: simulated cloth and robot; published: the real ones"
    )
    views = [("before", results.runs[cells[0]][0], 0)]
    views += [(f"after, {cell_name(cell)}", results.runs[cell][0], -1) for cell in cells]
    for column, (title, run, number) in enumerate(views):
        below = figure.add_subplot(grid[1, column])
        if (Path(run.folder) / VERTICES).exists():
            draw_cloth(below, Path(run.folder) / VERTICES, number)
        below.set_title(title, fontsize=9)
        below.set_xlabel(f"{1e3 * run.heights[number]:.1f} mm high", fontsize=9)
    save(figure, path)
