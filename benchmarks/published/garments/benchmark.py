"""`unwrinkle bench garments`.

Four garments, flattened by the system and by simple ways from the same starts.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.harness.plots import OURS as OUR_COLOUR
from benchmarks.harness.plots import PUBLISHED as GREY
from benchmarks.harness.plots import draw_cloth, save
from benchmarks.harness.report import Progress
from benchmarks.harness.statistics import Spread, mean_interval, spread
from benchmarks.harness.trials import run_trials, trials_wall
from benchmarks.published.garments.page import page
from benchmarks.published.garments.results import (
    GarmentsResult,
    GarmentTrial,
    LeftOut,
    MethodFigures,
    PublishedCoverage,
    StartTrial,
)
from benchmarks.published.garments.trials import (
    GARMENTS,
    METHODS,
    OURS,
    STARTS,
    TOGETHER,
    start_trial,
    wanted,
)
from benchmarks.published.loop_trials import VERTICES
from unwrinkle.models.errors import InputError
from unwrinkle.models.io.archive import load_archive

SUCCESS = 0.95  # coverage
#: Learned results on other starts, cloths and simulators, by their abstracts: start kind they are
#: nearest to, label, coverage (lower, upper), action they were reached at.
PUBLISHED: tuple[PublishedCoverage, ...] = (
    PublishedCoverage(
        start="pinched",
        label="FlingBot: over 80 % within 3 actions (another simulator)",
        source="H. Ha and S. Song, CoRL 2021, arXiv:2105.03655, abstract: novel cloths, crumpled",
        coverage=(0.80, None),
        action=3,
    ),
    PublishedCoverage(
        start="pinched",
        label="Seita: 83 % to 95 % (another robot and cloth)",
        source=(
            "D. Seita et al., IROS 2020, arXiv:1910.04854, abstract: RGBD policies in 180 runs on a real robot, a small "
            "square of cloth, by difficulty of the start"
        ),
        coverage=(0.83, 0.95),
        action=None,
    ),
)
_SEEDS = {"bunched": 5, "pinched": 0}
_ACTIONS = 20
_COUNTS = (5, 10, 15, 20)
_COLUMNS = 3  # of two rows of pictures below each panel: before, and after each method
_MOST_ROUNDS = 5  # in which other starts are taken for those that the cloth's solver cannot make
_FALLEN = 0.01  # m below flat: cloth that hangs over the table's edge
_LEAST_ROOM = 1e-3  # coverage that a start must lack, for an improvement to mean anything
_COLOURS = {
    OURS: OUR_COLOUR,
    TOGETHER: "#6a4c93",
    "random": "#c8553d",
    "contour": "#588157",
    "wrinkledness": "#e0a030",
}


def run(*, quick: bool, seed: int, progress: Progress) -> GarmentsResult:
    """Flatten every garment from every start in every way.

    Args:
        quick: towel and dishcloth, bunched, one seed, three actions.
        seed: of the first start.
        progress: told of every finished row.
    """
    garments = ["towel", "dishcloth"] if quick else list(GARMENTS)
    starts = [STARTS[0]] if quick else [start for start in STARTS if _SEEDS[start]]
    actions = 3 if quick else _ACTIONS
    pairs = [(start, garment) for start in starts for garment in garments]
    seeds, left_out = chosen_seeds(
        pairs, seed, dict.fromkeys(STARTS, 1) if quick else _SEEDS, progress
    )
    trials = wanted(seeds, actions=actions)
    done = [_displaced(each) for each in run_trials("garments", trials, GarmentTrial, progress)]
    counts = [count for count in _COUNTS if count <= actions] or [actions]
    by_key: dict[tuple[str, str, str], list[GarmentTrial]] = {}
    for trial, found in zip(trials, done, strict=True):
        start, garment, _, method = trial.name.rsplit("-", 3)
        by_key.setdefault((start, garment, method), []).append(found)
    unpaired = [
        f"{start}-{garment}"
        for start in starts
        for garment in garments
        if not _paired([by_key[start, garment, method] for method in METHODS])
    ]
    return GarmentsResult(
        trials_wall=trials_wall(done),
        garments=tuple(garments),
        starts=tuple(starts),
        methods=tuple(METHODS),
        seeds={f"{start}-{garment}": tuple(of) for (start, garment), of in seeds.items()},
        starts_left_out=tuple(left_out),
        most_actions=actions,
        counts=tuple(counts),
        success_coverage=SUCCESS,
        unpaired=tuple(unpaired),
        cells={
            start: {
                garment: {
                    method: figures(by_key[start, garment, method], counts) for method in METHODS
                }
                for garment in garments
            }
            for start in starts
        },
        overall={
            start: {
                method: figures(
                    [run for garment in garments for run in by_key[start, garment, method]], counts
                )
                for method in METHODS
            }
            for start in starts
        },
        published=PUBLISHED,
        runs=tuple(done),
    )


def chosen_seeds(
    pairs: list[tuple[str, str]], first: int, counts: Mapping[str, int], progress: Progress
) -> tuple[dict[tuple[str, str], list[int]], list[LeftOut]]:
    """The first seeds from which the starts can be made, by start kind and garment; and those left
    out, with reasons.

    Raises:
        InputError: the cloth's solver fails at too many of them.
    """
    seeds: dict[tuple[str, str], list[int]] = {pair: [] for pair in pairs}
    following = dict.fromkeys(pairs, first)
    left_out: list[LeftOut] = []
    for _ in range(_MOST_ROUNDS):
        asked = [
            (pair, following[pair] + k)
            for pair in pairs
            for k in range(counts[pair[0]] - len(seeds[pair]))
        ]
        if not asked:
            return seeds, left_out
        trials = [start_trial(*pair, seed) for pair, seed in asked]
        found = run_trials("garments", trials, StartTrial, progress)
        for (pair, seed), each in zip(asked, found, strict=True):
            following[pair] = seed + 1
            if each.made:
                seeds[pair].append(seed)
            else:
                left_out.append(LeftOut(start=f"{'-'.join(pair)}-{seed}", reason=each.reason))
    raise InputError(
        f"garments: the cloth's solver fails at {len(left_out)} starts, the last {left_out[-1].start}; "
        "give another seed"
    )


def figures(runs: Sequence[GarmentTrial], counts: Sequence[int]) -> MethodFigures:
    """Compute the figures of one method over runs."""
    improvements: dict[int, Spread | None] = {}
    for count in counts:
        values = [improvement(run.coverages, count) for run in runs]
        improvements[count] = mean_interval([v for v in values if v is not None])
    firsts = [
        next(n for n, share in enumerate(run.coverages) if share >= SUCCESS)
        for run in runs
        if max(run.coverages) >= SUCCESS
    ]
    ended: dict[str, int] = {}
    for run in runs:
        ended[run.status] = ended.get(run.status, 0) + 1
    return MethodFigures(
        runs=len(runs),
        coverage={
            count: spread([after(run.coverages, count) for run in runs]) for count in (0, *counts)
        },
        improvement=improvements,
        success=sum(run.coverages[-1] >= SUCCESS for run in runs),
        success_ever=len(firsts),
        success_at_start=sum(run.coverages[0] >= SUCCESS for run in runs),
        first_success=mean_interval(firsts),
        best=mean_interval([max(run.coverages) for run in runs]),
        height=mean_interval([run.heights[-1] for run in runs]),
        height_max=max(run.heights[-1] for run in runs),
        actions=mean_interval([run.actions for run in runs]),
        moved=mean_interval([run.moved for run in runs]),
        hanging_max=max(run.hanging for run in runs),
        overstretch_max=max(max(run.overstretch[1:], default=0.0) for run in runs),
        broken=sum(run.broken for run in runs),
        idle=sum(run.idle for run in runs),
        empty=sum(run.empty for run in runs),
        missed=sum(run.missed for run in runs),
        dual=sum(run.dual for run in runs),
        ended=ended,
        wall=float(np.mean([run.wall for run in runs])),
    )


def _displaced(trial: GarmentTrial) -> GarmentTrial:
    """Add how far a run moved the garment's middle, and the share that hangs over the table's edge."""
    header, arrays = load_archive(Path(trial.folder) / VERTICES)
    last = sum(name.startswith("v") for name in arrays) - 1
    before, end = arrays["v0"], arrays[f"v{last}"]
    moved = (end - before)[:, :2].mean(axis=0, dtype=float)
    fallen = end[:, 2] < float(header["flat_height"]) - _FALLEN
    return dataclasses.replace(trial, moved=float(np.hypot(*moved)), hanging=float(fallen.mean()))


def after(values: Sequence[float], count: int) -> float:
    """The value after `count` actions; the last one of a run that ended before."""
    return values[min(count, len(values) - 1)]


def improvement(coverages: Sequence[float], count: int) -> float | None:
    """Normalised improvement after `count` actions: the share of what the start lacked that was
    gained.

    (c - c0) / (1 - c0): 1 is flat, 0 no better than the start, below 0 worse. None where the start
    lacks nothing.
    """
    first = coverages[0]
    if 1.0 - first < _LEAST_ROOM:
        return None
    return (after(coverages, count) - first) / (1.0 - first)


def _paired(runs: Sequence[Sequence[GarmentTrial]]) -> bool:
    """Whether all methods began with the same coverage, seed by seed."""
    return all(
        len({round(run.coverages[0], 9) for run in same}) == 1 for same in zip(*runs, strict=True)
    )


def table(results: GarmentsResult) -> str:
    """The page."""
    return page(results)


def plot(results: GarmentsResult, path: Path) -> None:
    """Draw coverage against actions, a panel per garment and start, and one start of each before
    and after.
    """
    garments, starts = results.garments, results.starts
    runs = {run.name: run for run in results.runs}
    figure = Figure(figsize=(3.4 * len(garments) + 0.5, 5.2 * len(starts)), layout="constrained")
    parts: Any = figure.subfigures(2 * len(starts), 1, height_ratios=[1.1, 1.0] * len(starts))
    for k, start in enumerate(starts):
        grid = parts[2 * k].subplots(1, len(garments), squeeze=False, sharey=True)
        for axes, garment in zip(grid[0], garments, strict=True):
            for method in METHODS:
                _curve(axes, _runs_of(runs, start, garment, method), results, method)
            _published(axes, results, start)
            axes.set_title(f"{garment}, {start}", fontsize=9)
            axes.set_xlabel("actions")
            axes.xaxis.get_major_locator().set_params(integer=True)
            axes.spines[["top", "right"]].set_visible(False)
        grid[0, 0].set_ylabel("coverage, % of the flat garment")
        grid[0, 0].legend(frameon=False, fontsize=6)
        strips = parts[2 * k + 1].subplots(2, _COLUMNS * len(garments), squeeze=False)
        for axes in strips.flat:
            axes.set_axis_off()
        for place, garment in enumerate(garments):
            names = [
                f"{start}-{garment}-{results.seeds[f'{start}-{garment}'][0]}-{method}"
                for method in METHODS
            ]
            shown = [("before", names[0], 0)]
            shown += [(method, name, -1) for method, name in zip(METHODS, names, strict=True)]
            tiles = strips[:, place * _COLUMNS : (place + 1) * _COLUMNS].flat
            for axes, (title, name, number) in zip(tiles, shown, strict=False):
                draw_cloth(axes, Path(runs[name].folder) / VERTICES, number)
                axes.set_xlim(-0.42, 0.42)  # the whole table: some drag the garment about
                axes.set_ylim(-1.62, -0.78)
                axes.set_title(title, fontsize=6)
    save(figure, path)


def _runs_of(
    runs: dict[str, GarmentTrial], start: str, garment: str, method: str
) -> list[GarmentTrial]:
    return [
        run
        for name, run in runs.items()
        if name.startswith(f"{start}-{garment}-") and name.endswith(f"-{method}")
    ]


def _curve(axes: Axes, runs: Sequence[GarmentTrial], results: GarmentsResult, method: str) -> None:
    counts = np.arange(results.most_actions + 1)
    spreads = [mean_interval([after(run.coverages, int(n)) for run in runs]) for n in counts]
    known = [each for each in spreads if each is not None]
    means, low, high = 100.0 * np.array([(s.mean, s.low, s.high) for s in known]).T
    axes.plot(counts, means, color=_COLOURS[method], label=method, linewidth=1.5)
    axes.fill_between(counts, low, high, color=_COLOURS[method], alpha=0.2, linewidth=0.0)


def _published(axes: Axes, results: GarmentsResult, start: str) -> None:
    most = results.most_actions
    axes.axhline(100.0 * SUCCESS, color="black", linestyle=":", linewidth=0.8)
    for line in results.published:
        if line.start != start:
            continue
        low, high = line.coverage
        if high is None:
            begin = min(line.action or 0, most)
            axes.plot([begin, most], [100.0 * low] * 2, color=GREY, label=line.label)
        else:
            axes.axhspan(100.0 * low, 100.0 * high, color=GREY, alpha=0.25, label=line.label)
