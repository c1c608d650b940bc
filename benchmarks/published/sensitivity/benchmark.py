"""`unwrinkle bench sensitivity`: what each setting of the loop, the cloth and the sensor does to
crumpled towels.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.harness.plots import OURS, PUBLISHED, save
from benchmarks.harness.report import Progress
from benchmarks.harness.statistics import Spread, mean_interval
from benchmarks.harness.trials import run_trials, trials_wall
from benchmarks.published.figures import run_figures
from benchmarks.published.loop_trials import LoopTrial
from benchmarks.published.sensitivity.conditions import (
    ACTIONS,
    CONDITIONS,
    DEFAULT,
    QUICK,
    QUICK_ACTIONS,
    STEREO,
    core_minutes,
)
from benchmarks.published.sensitivity.page import page
from benchmarks.published.sensitivity.results import (
    ConditionFigures,
    MoreFigures,
    SensitivityResult,
)


def run(*, quick: bool, seed: int, progress: Progress) -> SensitivityResult:
    """Flatten the same crumpled towels in every condition, each of which changes one thing.

    Args:
        quick: two conditions, one start, at most two actions, small pictures.
        seed: of the first start.
        progress: told of every finished run, and first of what it costs.
    """
    conditions = QUICK if quick else CONDITIONS
    trials = [condition.trials(seed, quick=quick) for condition in conditions]
    count = sum(len(of) for of in trials)
    if not quick:
        progress(
            0,
            count,
            f"sensitivity: {count} runs, about {core_minutes(conditions):.0f} core-minutes",
        )
    found = run_trials("sensitivity", [trial for of in trials for trial in of], LoopTrial, progress)
    done = iter(found)
    runs = [[next(done) for _ in of] for of in trials]
    default = {
        condition.look: of
        for condition, of in zip(conditions, runs, strict=True)
        if condition.is_default
    }
    return SensitivityResult(
        trials_wall=trials_wall(found),
        most_actions=QUICK_ACTIONS if quick else ACTIONS,
        expected_core_minutes=None if quick else core_minutes(conditions),
        conditions=tuple(
            [
                ConditionFigures(
                    setting=condition.setting,
                    value=condition.value,
                    look=condition.look,
                    loop=condition.loop,
                    sensor=condition.sensor,
                    material=condition.material,
                    **vars(condition_figures(of)),
                    to_default=None
                    if condition.is_default
                    else paired(of, default[condition.look]),
                )
                for condition, of in zip(conditions, runs, strict=True)
            ]
        ),
        runs=tuple(run for of in runs for run in of),
    )


def condition_figures(runs: Sequence[LoopTrial]) -> MoreFigures:
    """The figures of one condition: those of `run_figures`, and others."""
    covered = mean_interval([run.coverages[-1] for run in runs])
    assert covered is not None
    return MoreFigures(
        **vars(run_figures(runs)),
        coverage_interval=(covered.low, covered.high),
        single=sum(run.single for run in runs),
    )


def paired(runs: Sequence[LoopTrial], default: Sequence[LoopTrial]) -> Spread | None:
    """How many actions more than the default's on the same starts: mean and interval.

    None without a common start.
    """
    of = {run.settings["seed"]: run.actions for run in default}
    more = [run.actions - of[run.settings["seed"]] for run in runs if run.settings["seed"] in of]
    return mean_interval(more)


def table(results: SensitivityResult) -> str:
    """The page."""
    return page(results)


def plot(results: SensitivityResult, path: Path) -> None:
    """Draw a panel for each setting.

    Each value's runs, their mean and its interval, beside the default's.
    """
    conditions = results.conditions
    panels: list[tuple[str, str]] = []
    for condition in conditions:
        if condition.setting != DEFAULT and (condition.setting, condition.look) not in panels:
            panels.append((condition.setting, condition.look))
    columns = min(3, len(panels))
    count = -(-len(panels) // columns)
    figure = Figure(figsize=(4.6 * columns, 2.5 * count), layout="constrained")
    grid = figure.subplots(count, columns, squeeze=False)
    for axes in grid.flat[len(panels) :]:
        axes.set_axis_off()
    most = max(condition.rni_interval[1] for condition in conditions)
    for axes, (setting, look) in zip(grid.flat, panels, strict=False):
        of = [condition for condition in conditions if condition.look == look]
        shown = [condition for condition in of if condition.setting in (DEFAULT, setting)]
        _panel(axes, f"{setting} ({'stereo head' if look == STEREO else 'true maps'})", shown)
        axes.set_xlim(0.0, 1.15 * most + 0.3)
    for axes in grid[-1]:
        axes.set_xlabel("actions until the detector says flat")
    figure.suptitle(
        "Crumpled towel, one thing changed at a time: mean and 95 % interval. Cloth and robot are simulated"
    )
    save(figure, path)


def _panel(axes: Axes, title: str, conditions: Sequence[ConditionFigures]) -> None:
    places = np.arange(len(conditions))[::-1]
    means = np.array([condition.rni_mean for condition in conditions])
    ends = np.array([condition.rni_interval for condition in conditions]).T
    error = np.maximum(np.stack([means - ends[0], ends[1] - means]), 0.0)
    axes.axvline(means[0], color=PUBLISHED, linewidth=1.0, linestyle="--")
    axes.errorbar(means, places, xerr=error, fmt="o", color=OURS, ecolor="black", capsize=3)
    for place, condition in zip(places, conditions, strict=True):
        flat = f"{condition.flat_by_truth} of {condition.runs} flat"
        axes.annotate(
            flat,
            (condition.rni_interval[1], place),
            (6, 0),
            textcoords="offset points",
            va="center",
            fontsize=7,
            color="gray",
        )
    axes.set_yticks(places, [condition.value or DEFAULT for condition in conditions], fontsize=8)
    axes.set_ylim(-0.6, len(conditions) - 0.4)
    axes.set_title(title, fontsize=10, loc="left")
    axes.spines[["top", "right"]].set_visible(False)
