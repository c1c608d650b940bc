"""`unwrinkle bench grasps`: pinching at the point of highest wrinkledness, in five states of cloth."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from benchmarks.harness.plots import OURS as OUR_COLOUR
from benchmarks.harness.plots import draw_cloth, save
from benchmarks.harness.report import Progress
from benchmarks.harness.statistics import wilson
from benchmarks.harness.tables import line
from benchmarks.harness.trials import FailedTrial, trials_wall, try_trials
from benchmarks.published.grasps.results import (
    ChoiceFigures,
    GraspsResult,
    GraspTrial,
    LeftOut,
    PublishedGrasps,
    StateFigures,
)
from benchmarks.published.grasps.states import STATES
from benchmarks.published.grasps.trials import CHOICES, LIFT, MISPLACED, OURS, wanted
from benchmarks.published.loop_trials import VERTICES
from unwrinkle.models.errors import InputError
from unwrinkle.simulation.cloth.cloth import ClothError

#: Grasps of five states, one attempt each (Sun et al. 2016, Robot vision architecture for
#: autonomous clothes manipulation, arXiv 1610.05824, Fig. 6).
PUBLISHED = (4, 5)
_TOLERATED = ClothError.__name__
_SEEDS, _QUICK_STATES = 10, 3
_MOST_ROUNDS = 5  # in which other starts are taken for those that cannot be made
_COLOURS = (OUR_COLOUR, "#7fb069", "#e6aa68", "#9aa5ab")


def run(*, quick: bool, seed: int, progress: Progress) -> GraspsResult:
    """Grasp in every state from every seed.

    Args:
        quick: one seed of the first three states.
        seed: the first one.
        progress: told of every finished row.
    """
    states = [state.name for state in STATES[: _QUICK_STATES if quick else None]]
    rows, left_out = _grasped(states, seed, 1 if quick else _SEEDS, progress)
    ours = _successes(rows, OURS)
    return GraspsResult(
        starts_left_out=tuple(left_out),
        trials_wall=trials_wall(rows),
        successes=ours,
        attempts=len(rows),
        success=ours / len(rows),
        success_interval=wilson(ours, len(rows)),
        published=PublishedGrasps(*PUBLISHED),
        misplaced=MISPLACED,
        overall={choice: _figures(rows, choice) for choice in CHOICES},
        states={name: _state(name, rows) for name in states},
        runs=tuple(rows),
    )


def _grasped(
    states: list[str], first: int, count: int, progress: Progress
) -> tuple[list[GraspTrial], list[LeftOut]]:
    """So many rows of each state; and the starts that the cloth's solver could not make, for which
    the next seeds are taken.

    Raises:
        InputError: it cannot make too many of them.
    """
    rows: dict[str, list[GraspTrial]] = {state: [] for state in states}
    following = dict.fromkeys(states, first)
    left_out: list[LeftOut] = []
    for _ in range(_MOST_ROUNDS):
        asked = []
        for state in states:
            seeds = range(following[state], following[state] + count - len(rows[state]))
            asked += wanted([state], seeds)
            following[state] = seeds.stop
        if not asked:
            return [row for state in states for row in rows[state]], left_out
        for row in try_trials("grasps", asked, GraspTrial, progress, tolerated=_TOLERATED):
            if isinstance(row, FailedTrial):
                left_out.append(LeftOut(row.name, row.reason))
            else:
                rows[row.settings["state"]].append(row)
    raise InputError(
        f"grasps: the cloth's solver fails at {len(left_out)} starts, the last {left_out[-1].start}; give another seed"
    )


def _state(name: str, rows: Sequence[GraspTrial]) -> StateFigures:
    own = [row for row in rows if row.settings["state"] == name]
    return StateFigures(
        title=next(state.title for state in STATES if state.name == name),
        wrinkles=float(np.mean([row.wrinkles for row in own])),
        layers=float(np.mean([1.0 / row.coverage for row in own])),
        height=float(np.median([row.height for row in own])),
        choices={choice: _figures(own, choice) for choice in CHOICES},
    )


def _successes(rows: Sequence[GraspTrial], choice: str) -> int:
    return sum(row.choices[choice].success for row in rows)


def _figures(rows: Sequence[GraspTrial], choice: str) -> ChoiceFigures:
    """Successes with their interval, causes of failure, and how well the blades were placed."""
    tried = [row.choices[choice] for row in rows]
    placed = [one.misplaced for one in tried if one.misplaced is not None]
    hits = _successes(rows, choice)

    def median(values: Sequence[float | None]) -> float | None:
        known = [value for value in values if value is not None]
        return float(np.median(known)) if known else None

    return ChoiceFigures(
        successes=hits,
        attempts=len(rows),
        interval=wilson(hits, len(rows)),
        planned=len(placed),
        causes=dict(Counter(one.cause for one in tried if one.cause is not None)),
        depth=median([one.depth for one in tried]),
        misplaced=tuple(np.mean(placed, axis=0).tolist()) if placed else None,
        inset=median([one.inset for one in tried]),
        weight_most=max((one.weight for one in tried if one.weight is not None), default=None),
    )


def table(results: GraspsResult) -> str:
    """The page: successes by state and point, causes of failure, and what is modelled."""
    hits, count = PUBLISHED
    low, high = wilson(hits, count)
    states, overall = results.states, results.overall
    lines = [
        (
            "**Cloth, robot and sensor are simulated here; the published figures are of real garments and the real robot.** "
            f"Grasps where the wrinkledness is highest: **{results.successes} of {results.attempts}** "
            f"({_share(results.success_interval)}); published: {hits} of {count} ({_share((low, high))}). "
            "Intervals are Wilson's, 95 %."
        ),
        "",
        (
            "Each row's states come from seeds; all points of a row are pinched from the same start and the same look, by the "
            "arm, turn-table angle and posture that the planner finds. A grasp counts if there is such a plan without collision, "
            "a fold of at least 5 mm stands between the blades, and lifting it takes at least 10 cm2 of cloth 50 mm up."
        ),
        "",
        "| state | wrinkles found | layers, mean | highest point (mm) | "
        + " | ".join(_heading(choice) for choice in CHOICES)
        + " |",
        "|---" * (4 + len(CHOICES)) + "|",
    ]
    lines += [
        f"| {state.title} | {state.wrinkles:.1f} | {state.layers:.2f} | {1e3 * state.height:.0f} | "
        + " | ".join(_cell(state.choices[choice]) for choice in CHOICES)
        + " |"
        for state in states.values()
    ]
    lines += [
        "| **all** | | | | " + " | ".join(_cell(overall[choice]) for choice in CHOICES) + " |",
        "",
        "## How sure the grasps are",
        "",
        "| point | planned | from the garment's rim, median (mm) | fold above the tips, median (mm) | "
        + " | ".join(f"still caught with the tool {1e3 * d:.0f} mm off" for d in results.misplaced)
        + " | causes of failure |",
        "|---" * (5 + len(results.misplaced)) + "|",
    ]
    lines += [_sure(choice, overall[choice], len(results.misplaced)) for choice in CHOICES]
    failures = [
        f"- {row.name}: {tried.cause}: {tried.reason}"
        for row in results.runs
        if not (tried := row.choices[OURS]).success
    ]
    lines += ["", "## Failures at the wrinkledness point", "", *(failures or ["None."])]
    if results.starts_left_out:
        names = ", ".join(one.start for one in results.starts_left_out)
        lines += [
            "",
            f"The cloth's solver could not make these starts; the next seeds were taken: {names}.",
        ]
    weight = overall[OURS].weight_most
    lines += ["", "## What is modelled, and what is not", "", *_notes(weight), ""]
    return "\n".join(lines)


def _notes(weight: float | None) -> list[str]:
    heaviest = "" if weight is None else f" (at most {weight:.2f} N hung from the blades here)"
    return [
        (
            "- States, in the order of difficulty: more wrinkles that cross, then layers on each other, then thinner cloth in a "
            "heap. They are ours: what the published five were like is not known in numbers."
        ),
        (
            "- The sensor is the true shape with the stereo head's noise: no shadows behind folds, no errors of matching or "
            "calibration. The columns with the tool off its place stand in for those: eight directions on the table each."
        ),
        (
            "- The blades come down open, 30 mm apart, both tips equally high, at most 20 mm below the crest. What is under a tip is "
            "pressed flat, no further than its layers' thickness, and takes the cloth between the blades with it by the mean of "
            "both; flat cloth is never gathered up. A fold of 5 mm over half of the blades' width is caught."
        ),
        (
            "- The arm is planned from home to above the fold, down along the blades, and up, without collision by the planner's own "
            "check; the motion is neither timed nor verified as flattening motions are. With both tips equally high the tool leans "
            "17 deg past the vertical, outside the window of tilts (30 to 75 deg) that flattening uses: within it the upper tip "
            "stands 18 mm or more above the lower one, over the crest of most wrinkles."
        ),
        (
            f"- What is caught cannot slip out{heaviest}; the friction of the closed blades on cloth is not known."
        ),
        (
            "- The other points are pinched across the sharpest convex bending there, with the same planner and blades: the middle "
            "of the largest wrinkle, the highest point, a random point of the garment."
        ),
    ]


def _heading(choice: str) -> str:
    return f"**{choice}**" if choice == OURS else choice


def _share(interval: tuple[float, float]) -> str:
    low, high = interval
    return f"{100 * low:.0f} to {100 * high:.0f} %"


def _cell(figures: ChoiceFigures) -> str:
    return f"{figures.successes} of {figures.attempts} ({_share(figures.interval)})"


def _sure(choice: str, figures: ChoiceFigures, distances: int) -> str:
    inset, depth = (
        "-" if value is None else f"{1e3 * value:.0f}" for value in (figures.inset, figures.depth)
    )
    shares = figures.misplaced or [None] * distances
    off = " | ".join("-" if share is None else f"{100 * share:.0f} %" for share in shares)
    causes = ", ".join(f"{cause} {n}" for cause, n in figures.causes.items()) or "none"
    planned = f"{figures.planned} of {figures.attempts}"
    return line(f"{choice}", f"{planned}", f"{inset}", f"{depth}", f"{off}", f"{causes}")


def plot(results: GraspsResult, path: Path) -> None:
    """Draw successes with their intervals, and the first seed's state with our blades upon it and
    lifted, from above.
    """
    states = results.states
    figure = Figure(figsize=(11.0, 8.4), layout="constrained")
    grid = figure.add_gridspec(3, len(states), height_ratios=(1.25, 1.0, 1.0))
    axes = figure.add_subplot(grid[0, :])
    places, width = np.arange(len(states), dtype=float), 0.8 / len(CHOICES)
    for k, (choice, colour) in enumerate(zip(CHOICES, _COLOURS, strict=True)):
        of = [state.choices[choice] for state in states.values()]
        share = np.array([one.successes / one.attempts for one in of])
        ends = np.array([one.interval for one in of]).T
        at = places + (k - 0.5 * (len(CHOICES) - 1)) * width
        axes.bar(at, share, width, color=colour, label=choice)
        error = np.maximum(np.abs(ends - share), 0.0)
        axes.errorbar(at, share, error, fmt="none", ecolor="black", capsize=3, linewidth=1.0)
    published = PUBLISHED[0] / PUBLISHED[1]
    axes.axhline(published, color="grey", linestyle="--", label="published, all states: 4 of 5")
    axes.set_xticks(places, [state.title.replace(", ", ",\n") for state in states.values()])
    axes.set_ylabel("grasps that held (95 % intervals)")
    axes.set_ylim(0.0, 1.05)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(
        frameon=False, ncols=len(CHOICES) + 1, loc="upper center", bbox_to_anchor=(0.5, 1.12)
    )
    for k, name in enumerate(states):
        row = next(row for row in results.runs if row.settings["state"] == name)
        ours, highest = row.choices[OURS], 1e3 * row.height
        for number, most in enumerate((max(30.0, highest), highest + 1e3 * LIFT)):
            below = figure.add_subplot(grid[1 + number, k])
            draw_cloth(below, Path(row.folder) / VERTICES, number)
            below.collections[-1].set_clim(0.0, most)
            if number == 0:
                below.set_title("before, with the blades", fontsize=9)
                for line in np.array(ours.tips or np.empty((0, 2, 2))):
                    below.plot(*line.T, color="#e63946", linewidth=2.0)
            else:
                below.set_title("lifted" if ours.success else str(ours.cause), fontsize=9)
    save(figure, path)
