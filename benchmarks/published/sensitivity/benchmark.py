"""`unwrinkle bench levers`: what each setting of the loop, the cloth and the sensor does to
crumpled towels.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.harness.plots import OURS, PUBLISHED, save
from benchmarks.harness.report import Progress
from benchmarks.harness.statistics import mean_interval
from benchmarks.harness.trials import run_trials, trials_wall
from benchmarks.published.figures import run_figures
from benchmarks.published.sensitivity.conditions import (
    ACTIONS,
    CELLS,
    DEFAULT,
    QUICK,
    QUICK_ACTIONS,
    STEREO,
    core_minutes,
)
from benchmarks.published.sensitivity.page import page


def run(*, quick: bool, seed: int, progress: Progress) -> dict[str, Any]:
    """Flatten the same crumpled towels in every cell, each of which changes one thing.

    Args:
        quick: two cells, one start, at most two actions, small pictures.
        seed: of the first start.
        progress: told of every finished run, and first of what the board costs.
    """
    cells = QUICK if quick else CELLS
    rows = [cell.rows(seed, quick=quick) for cell in cells]
    count = sum(len(of) for of in rows)
    if not quick:
        progress(0, count, f"levers: {count} runs, about {core_minutes(cells):.0f} core-minutes")
    found = run_trials("levers", [row for of in rows for row in of], progress)
    done = iter(found)
    runs = [[next(done) for _ in of] for of in rows]
    default = {cell.look: of for cell, of in zip(cells, runs, strict=True) if cell.is_default}
    return {
        "trials_wall": trials_wall(found),
        "most_actions": QUICK_ACTIONS if quick else ACTIONS,
        "expected_core_minutes": None if quick else core_minutes(cells),
        "cells": [
            {
                "lever": cell.lever,
                "value": cell.value,
                "look": cell.look,
                "loop": cell.loop,
                "sensor": cell.sensor,
                "material": cell.material,
                **cell_figures(of),
                "to_default": None if cell.is_default else paired(of, default[cell.look]),
            }
            for cell, of in zip(cells, runs, strict=True)
        ],
        "runs": [run for of in runs for run in of],
    }


def cell_figures(runs: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The figures of one cell: those of `run_figures`, and others."""
    covered = mean_interval([run["coverages"][-1] for run in runs])
    assert covered is not None
    return {
        **run_figures(runs),
        "coverage_interval": [covered.low, covered.high],
        "single": sum(run["single"] for run in runs),
    }


def paired(
    runs: Sequence[dict[str, Any]], default: Sequence[dict[str, Any]]
) -> dict[str, Any] | None:
    """How many actions more than the default's on the same starts: mean and interval.

    None without a common start.
    """
    of = {run["settings"]["seed"]: run["actions"] for run in default}
    more = [
        run["actions"] - of[run["settings"]["seed"]]
        for run in runs
        if run["settings"]["seed"] in of
    ]
    spread = mean_interval(more)
    return None if spread is None else spread.to_json()


def table(results: dict[str, Any]) -> str:
    """The page."""
    return page(results)


def plot(results: dict[str, Any], path: Path) -> None:
    """Draw a panel for each lever.

    Each value's runs, their mean and its interval, beside the default's.
    """
    cells = results["cells"]
    panels: list[tuple[str, str]] = []
    for cell in cells:
        if cell["lever"] != DEFAULT and (cell["lever"], cell["look"]) not in panels:
            panels.append((cell["lever"], cell["look"]))
    columns = min(3, len(panels))
    count = -(-len(panels) // columns)
    figure = Figure(figsize=(4.6 * columns, 2.5 * count), layout="constrained")
    grid = figure.subplots(count, columns, squeeze=False)
    for axes in grid.flat[len(panels) :]:
        axes.set_axis_off()
    most = max(cell["rni_interval"][1] for cell in cells)
    for axes, (lever, look) in zip(grid.flat, panels, strict=False):
        of = [cell for cell in cells if cell["look"] == look]
        shown = [cell for cell in of if cell["lever"] in (DEFAULT, lever)]
        _panel(axes, f"{lever} ({'stereo head' if look == STEREO else 'true maps'})", shown)
        axes.set_xlim(0.0, 1.15 * most + 0.3)
    for axes in grid[-1]:
        axes.set_xlabel("actions until the detector says flat")
    figure.suptitle(
        "Crumpled towel, one thing changed at a time: mean and 95 % interval. Cloth and robot are simulated"
    )
    save(figure, path)


def _panel(axes: Axes, title: str, cells: list[dict[str, Any]]) -> None:
    places = np.arange(len(cells))[::-1]
    means = np.array([cell["rni_mean"] for cell in cells])
    ends = np.array([cell["rni_interval"] for cell in cells]).T
    error = np.maximum(np.stack([means - ends[0], ends[1] - means]), 0.0)
    axes.axvline(means[0], color=PUBLISHED, linewidth=1.0, linestyle="--")
    axes.errorbar(means, places, xerr=error, fmt="o", color=OURS, ecolor="black", capsize=3)
    for place, cell in zip(places, cells, strict=True):
        flat = f"{cell['flat_by_truth']} of {cell['runs']} flat"
        axes.annotate(
            flat,
            (cell["rni_interval"][1], place),
            (6, 0),
            textcoords="offset points",
            va="center",
            fontsize=7,
            color="gray",
        )
    axes.set_yticks(places, [cell["value"] or DEFAULT for cell in cells], fontsize=8)
    axes.set_ylim(-0.6, len(cells) - 0.4)
    axes.set_title(title, fontsize=10, loc="left")
    axes.spines[["top", "right"]].set_visible(False)
