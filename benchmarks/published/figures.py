"""The figures that every board of whole runs has of some runs (rows of `_loop_rows.flattened`)."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmarks.harness.statistics import mean_interval
from benchmarks.published.loop_trials import FLAT


def run_figures(runs: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The figures of one or more runs.

    Returns:
        `runs`; `rni_mean`, `rni_std`, `rni_interval` (95 %) of the actions until the loop's own
        detector said flat, where a run that ended otherwise counts with the actions that it made
        and is one of `unfinished`; `flat_by_truth`, runs at whose end the cloth's highest point was
        at most FLAT above flat; `missed` grasps; at the end `height_max` (m), `coverage_mean`,
        `coverage_least`; `overstretch_max` after any action.
    """
    rni = mean_interval([run["actions"] for run in runs])
    assert rni is not None
    heights = [run["heights"][-1] for run in runs]
    covered = [run["coverages"][-1] for run in runs]
    return {
        "runs": len(runs),
        "rni_mean": rni.mean,
        "rni_std": rni.std,
        "rni_interval": [rni.low, rni.high],
        "unfinished": sum(run["status"] != "flat" for run in runs),
        "flat_by_truth": sum(height <= FLAT for height in heights),
        "missed": sum(run["missed"] for run in runs),
        "height_max": max(heights),
        "coverage_mean": float(np.mean(covered)),
        "coverage_least": min(covered),
        "overstretch_max": max(max(run["overstretch"][1:], default=0.0) for run in runs),
    }
