"""`unwrinkle bench table1`: single wrinkles in eight directions, five repeats each, beside the
published Table I.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from benchmarks.harness.plots import bars, draw_cloth, save
from benchmarks.harness.report import Progress
from benchmarks.harness.statistics import wilson
from benchmarks.harness.tables import line, rule
from benchmarks.harness.trials import Trial, run_trials, trials_wall
from benchmarks.published.figures import RunFigures, run_figures
from benchmarks.published.loop_trials import VERTICES, LoopTrial
from unwrinkle.testing.targets import DIRECTIONS


@dataclass(frozen=True)
class PublishedTable1:
    """The published figures over all directions.

    Attributes:
        rni_mean: required number of iterations.
        dual_success: share of dual-arm plans.
        dual_least: of the worst direction.
        grasp_success: share.
    """

    rni_mean: float
    dual_success: float
    dual_least: float
    grasp_success: float


@dataclass(frozen=True, kw_only=True)
class WrinkleFigures(RunFigures):
    """Figures of runs with one wrinkle each.

    Attributes:
        rni_max: most actions of a run.
        rni_one: runs with one action.
        flat: runs that the detector called flat.
        dual_success, dual_interval: share of first actions that were planned, verified and carried
            out with two arms, with its 95 % interval.
        grasp_success: share of actions in which both grippers got hold of cloth.
        height_before: median of the true heights, m.
    """

    rni_max: int
    rni_one: int
    flat: int
    dual_success: float
    dual_interval: tuple[float, float]
    grasp_success: float
    height_before: float


@dataclass(frozen=True, kw_only=True)
class DirectionFigures(WrinkleFigures):
    """Figures of one direction, degrees."""

    direction: float


@dataclass(frozen=True, kw_only=True)
class ReadingFigures(WrinkleFigures):
    """Figures of one reading of the directions, with the least dual-arm success of a direction."""

    dual_least: float
    directions: tuple[DirectionFigures, ...]


@dataclass(frozen=True)
class Table1Result:
    """Single wrinkles in all directions.

    Attributes:
        trials_wall: time of all runs, s.
        repeats: of each direction.
        readings: by name.
        published: the published figures.
        runs: by reading; those of a direction stand together.
    """

    trials_wall: float
    repeats: int
    readings: dict[str, ReadingFigures]
    published: PublishedTable1
    runs: dict[str, tuple[LoopTrial, ...]]


#: The two readings of the published directions: wrinkles about the robot's forward axis, and about
#: its lateral one; degrees from the world's x of the way across a wrinkle whose direction is 0.
READINGS = {"forward": 0.0, "lateral": 90.0}
#: Those that are run; `bench plans` plans motions in both.
RUN = ("forward",)
#: Published over all directions (Sun et al., ICRA 2015, Table I); one direction had no dual-arm
#: plan at all.
PUBLISHED = PublishedTable1(rni_mean=1.0, dual_success=0.85, dual_least=0.0, grasp_success=1.0)
_REPEATS = 5
_ACTIONS = 10
_SLACK, _BASE, _OFFSET = (0.018, 0.035), (0.040, 0.050), (-0.03, 0.03)  # m
_WORK = "benchmarks.published.loop_trials:flattened"


def run(*, quick: bool, seed: int, progress: Progress) -> Table1Result:
    """Flatten towels with one wrinkle each.

    Args:
        quick: two directions of one reading, one repeat, small pictures.
        seed: of the wrinkles' slack, width and place, and of the loops.
        progress: told of every finished run.
    """
    readings = ["forward"] if quick else list(RUN)
    directions = DIRECTIONS[:: len(DIRECTIONS) - 1] if quick else DIRECTIONS
    repeats = 1 if quick else _REPEATS
    trials = [
        _trial(reading, float(direction), repeat, seed, quick=quick)
        for reading in readings
        for direction in directions
        for repeat in range(repeats)
    ]
    done = run_trials("table1", trials, LoopTrial, progress)
    found: dict[str, ReadingFigures] = {}
    runs: dict[str, tuple[LoopTrial, ...]] = {}
    for k, reading in enumerate(readings):
        of = done[k * len(directions) * repeats : (k + 1) * len(directions) * repeats]
        by_direction = [
            DirectionFigures(
                direction=float(direction), **vars(figures(of[i * repeats : (i + 1) * repeats]))
            )
            for i, direction in enumerate(directions)
        ]
        least = min(row.dual_success for row in by_direction)
        found[reading] = ReadingFigures(
            dual_least=least, directions=tuple(by_direction), **vars(figures(of))
        )
        runs[reading] = tuple(of)
    return Table1Result(trials_wall(done), repeats, found, PUBLISHED, runs)


def _trial(reading: str, direction: float, repeat: int, seed: int, *, quick: bool) -> Trial:
    own = [seed, repeat, round(10 * direction) + 1000, list(READINGS).index(reading)]
    rng = np.random.default_rng(own)
    start = {
        "kind": "ridge",
        "direction": float(np.radians(direction + READINGS[reading])),
        "slack": float(rng.uniform(*_SLACK)),
        "base": float(rng.uniform(*_BASE)),
        "offset": float(rng.uniform(*_OFFSET)),
    }
    scenario: dict[str, Any] = {"loop": {"actions": _ACTIONS}}
    if quick:
        scenario["sensor"] = {"scale": 0.25}
    settings = {"scenario": scenario, "seed": seed + repeat, "start": start}
    return Trial(f"{reading}-{direction:+.1f}-{repeat}", _WORK, settings)


def figures(runs: Sequence[LoopTrial]) -> WrinkleFigures:
    """Compute the figures of some runs."""
    found = run_figures(runs)
    dual = sum(run.looks[0].arms == 2 for run in runs)
    actions = sum(run.actions for run in runs)
    return WrinkleFigures(
        **vars(found),
        rni_max=max(run.actions for run in runs),
        rni_one=sum(run.actions == 1 for run in runs),
        flat=found.runs - found.unfinished,
        dual_success=dual / len(runs),
        dual_interval=wilson(dual, len(runs)),
        grasp_success=(actions - found.missed) / actions if actions else 0.0,
        height_before=float(np.median([run.heights[0] for run in runs])),
    )


def table(results: Table1Result) -> str:
    """The page: a table for each reading of the directions, targets, and the runs that missed one."""
    lines = [
        (
            "**Cloth and robot are simulated here; the published figures are of a real towel and the real robot** (Sun, "
            "Aragon-Camarasa, Rogers, Siebert, ICRA 2015, Table I): RNI 1 in all directions, dual-arm plans 85 % with none at "
            "all in one direction, grasps 100 %. Which way direction 0 lies was not published; here "
            f"directions are about the robot's {' and its '.join(results.readings)} axis ([plans](plans.md) plans motions in "
            "both readings). A wrinkle's "
            "slack, width and place are drawn for every repeat."
        ),
        "",
        (
            line(
                "wrinkles about",
                "runs",
                "RNI, mean (most)",
                "flat by detector, by truth",
                "dual-arm plans (95 %)",
                "least of a direction",
                "grasps",
                "true height before, median; after, most",
                "overstretch, most",
            )
        ),
        rule(9),
    ]
    for reading in results.readings:
        c = results.readings[reading]
        low, high = c.dual_interval
        lines.append(
            line(
                f"{reading}",
                f"{c.runs}",
                f"{c.rni_mean:.2f} ({c.rni_max})",
                f"{c.flat}, {c.flat_by_truth}",
                f"{100 * c.dual_success:.1f} % ({100 * low:.0f} to {100 * high:.0f} %)",
                f"{100 * c.dual_least:.0f} %",
                f"{100 * c.grasp_success:.1f} %",
                f"{1e3 * c.height_before:.1f} mm; {1e3 * c.height_max:.1f} mm",
                f"{100 * c.overstretch_max:.1f} %",
            )
        )
    lines += ["", "## Against the targets", "", line("target", "here", "met"), rule(3)]
    for reading in results.readings:
        c = results.readings[reading]
        for what, value, met in (
            ("RNI 1 everywhere", f"{c.rni_one} of {c.runs}", c.rni_one == c.runs),
            (
                "dual-arm at least 97.5 %",
                f"{100 * c.dual_success:.1f} %",
                c.dual_success >= 0.975,
            ),
            ("no direction under 80 %", f"{100 * c.dual_least:.0f} %", c.dual_least >= 0.8),
            ("grasps 100 %", f"{100 * c.grasp_success:.1f} %", c.grasp_success == 1.0),
        ):
            lines.append(line(f"{what} ({reading})", f"{value}", f"{('yes' if met else 'no')}"))
    for reading in results.readings:
        lines += ["", f"## Directions about {reading}", ""]
        lines += [
            line(
                "direction, deg",
                "RNI, mean",
                "dual-arm plans",
                "grasps",
                "true height after, most",
                "coverage, least",
            ),
            rule(6),
        ]
        lines += [
            line(
                f"{d.direction:+.1f}",
                f"{d.rni_mean:.1f}",
                f"{100 * d.dual_success:.0f} %",
                f"{100 * d.grasp_success:.0f} %",
                f"{1e3 * d.height_max:.1f} mm",
                f"{100 * d.coverage_least:.1f} %",
            )
            for d in results.readings[reading].directions
        ]
    return "\n".join([*lines, *_not_in_one(results), ""])


def _not_in_one(results: Table1Result) -> list[str]:
    """The runs that needed more than one action, or did not end flat."""
    rows = [
        line(
            f"{run.name}",
            f"{run.status}",
            f"{run.actions}",
            f"{run.looks[0].arms}",
            f"{', '.join(f'{1e3 * height:.1f}' for height in run.heights)}",
        )
        for reading in results.readings
        for run in results.runs[reading]
        if run.actions != 1 or run.status != "flat"
    ]
    if not rows:
        return []
    head = [
        line("run", "ended", "actions", "arms of the first", "true heights, mm"),
        rule(5),
    ]
    return ["", "## Runs that took other than one action", "", *head, *rows]


def plot(results: Table1Result, path: Path) -> None:
    """Draw dual-arm success by direction, and one wrinkle of each direction before and after."""
    readings = list(results.readings)
    columns = len(results.readings[readings[0]].directions)
    figure = Figure(figsize=(12.0, 4.0 + 3.0 * len(readings)), layout="constrained")
    grid = figure.add_gridspec(
        1 + 2 * len(readings), columns, height_ratios=(2, *[1, 1] * len(readings))
    )
    for k, reading in enumerate(readings):
        half = columns // len(readings)
        axes = figure.add_subplot(grid[0, k * half : (k + 1) * half])
        of = results.readings[reading].directions
        bars(
            axes,
            [f"{row.direction:+.0f}" for row in of],
            [100 * row.dual_success for row in of],
            [(100 * row.dual_interval[0], 100 * row.dual_interval[1]) for row in of],
            label="dual-arm plans, %",
        )
        axes.axhline(100 * PUBLISHED.dual_success, color="#9aa5ab", linestyle="--")
        axes.set_title(
            f"wrinkles about {reading} (dashed: published mean, real robot)", fontsize=10
        )
        repeats = results.repeats
        for column, row in enumerate(of):
            run = results.runs[reading][column * repeats]
            for below_it, number in enumerate((0, -1)):
                below = figure.add_subplot(grid[1 + 2 * k + below_it, column])
                if (Path(run.folder) / VERTICES).exists():
                    draw_cloth(below, Path(run.folder) / VERTICES, number)
                below.set_title(
                    f"{row.direction:+.0f} deg, {1e3 * run.heights[number]:.1f} mm",
                    fontsize=8,
                )
    save(figure, path)
