"""Compute the figures that several benchmarks have of runs of the loop."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.harness.statistics import mean_interval
from benchmarks.published.loop_trials import FLAT, LoopRun


@dataclass(frozen=True, kw_only=True)
class RunFigures:
    """Figures of one or more runs.

    Attributes:
        runs: how many.
        rni_mean, rni_std, rni_interval: of the actions until the loop's own detector said flat
            (95 % interval of the mean); a run that ended otherwise counts with the actions that it
            made.
        unfinished: runs that ended otherwise.
        flat_by_truth: runs at whose end the cloth's highest point was at most FLAT above flat.
        missed: grasps.
        height_max: at the end, m.
        coverage_mean, coverage_least: at the end.
        overstretch_max: after any action.
    """

    runs: int
    rni_mean: float
    rni_std: float
    rni_interval: tuple[float, float]
    unfinished: int
    flat_by_truth: int
    missed: int
    height_max: float
    coverage_mean: float
    coverage_least: float
    overstretch_max: float


def run_figures(runs: Sequence[LoopRun]) -> RunFigures:
    """Compute the figures of one or more runs."""
    rni = mean_interval([run.actions for run in runs])
    assert rni is not None
    heights = [run.heights[-1] for run in runs]
    covered = [run.coverages[-1] for run in runs]
    return RunFigures(
        runs=len(runs),
        rni_mean=rni.mean,
        rni_std=rni.std,
        rni_interval=(rni.low, rni.high),
        unfinished=sum(run.status != "flat" for run in runs),
        flat_by_truth=sum(height <= FLAT for height in heights),
        missed=sum(run.missed for run in runs),
        height_max=max(heights),
        coverage_mean=float(np.mean(covered)),
        coverage_least=min(covered),
        overstretch_max=max(max(run.overstretch[1:], default=0.0) for run in runs),
    )
