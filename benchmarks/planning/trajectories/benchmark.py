"""`unwrinkle bench trajectories`.

Ways to time the seven-pose paths of a public set, under one judge.
"""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.harness.report import Progress
from benchmarks.harness.trials import Trial, run_trials
from benchmarks.planning.trajectories.measures import NO_DEVIATION, QUANTITIES
from benchmarks.planning.trajectories.methods import METHODS, PERIOD, TRACKING_PERIOD
from benchmarks.planning.trajectories.page import draw, page
from benchmarks.planning.trajectories.paths import NAMES, load_paths
from benchmarks.planning.trajectories.results import (
    DurationRatio,
    Headline,
    JudgeSettings,
    MedianMax,
    MethodFigures,
    OptimumFigures,
    PathSetFigures,
    PieceRatios,
    StartFigures,
    TimedPath,
    TimedTrial,
    TrajectoriesResult,
)
from benchmarks.planning.trajectories.trials import MARGIN
from unwrinkle.planning.verification.joint_limits import TOLERANCE

_GROUPS = ("forward", "lateral", "wide")
_QUICK = 4
_SECOND_START = 4  # every so many paths the programme is also started from elsewhere
_WHOLE = "whole path"
_TARGET = 1.40  # times toppra's jerk-free time


def run(*, quick: bool, seed: int, progress: Progress) -> TrajectoriesResult:
    """Time every path of the set in every way, and judge the samples.

    The set is fixed, and nothing is drawn at random: the seed changes nothing.
    """
    paths = load_paths()
    names = [path.name for path in paths.paths]
    chosen = names[:: len(names) // _QUICK] if quick else names
    wanted = [
        Trial(
            name,
            "benchmarks.planning.trajectories.trials:timed",
            {
                "path": name,
                "set": paths.header["sha256"],
                "starts": 2 if i % _SECOND_START == 0 else 1,
            },
        )
        for i, name in enumerate(chosen)
    ]
    timed = run_trials("trajectories", wanted, TimedTrial, progress)
    return summary([_path(trial) for trial in timed])


def _path(trial: TimedTrial) -> TimedPath:
    names = [field.name for field in dataclasses.fields(TimedPath)]
    return TimedPath(**{name: getattr(trial, name) for name in names})


def summary(rows: Sequence[TimedPath]) -> TrajectoriesResult:
    """Compute the figures over timed paths."""
    paths = load_paths()
    methods = {key: _method(rows, key) for key in METHODS}
    optimum = _optimum(rows)
    return TrajectoriesResult(
        set=PathSetFigures(
            file="benchmarks/planning/trajectories/path_set/seven_pose_paths.npz",
            sha256=paths.header["sha256"],
            seed=paths.header["seed"],
            paths=len(paths.paths),
            timed=len(rows),
            points=int(sum(len(p.q) for path in paths.paths for p in path.pieces)),
        ),
        judge=JudgeSettings(
            margin=MARGIN,
            period=PERIOD,
            tracking_period=TRACKING_PERIOD,
            tolerance=TOLERANCE,
            no_deviation=NO_DEVIATION,
        ),
        headline=_headline(methods, optimum),
        methods=methods,
        groups={
            group: {key: _method([r for r in rows if r.group == group], key) for key in METHODS}
            for group in _GROUPS
        },
        optimum=optimum,
        start=_start(rows),
        paths=tuple(rows),
    )


def table(results: TrajectoriesResult) -> str:
    """The results as Markdown."""
    return page(results)


def plot(results: TrajectoriesResult, path: Path) -> None:
    """Draw duration against deviation for every method, and one axis of one piece over time."""
    draw(results, path)


def _headline(methods: dict[str, MethodFigures], optimum: OptimumFigures) -> Headline:
    ours = methods["ours"]
    clean = [
        key
        for key, row in methods.items()
        if row.clean == row.paths and key != "without_start"  # the same law as ours
    ]
    met = [key for key in clean if (methods[key].ratio.max or 0.0) <= _TARGET]
    return Headline(
        ours_ratio_median=ours.ratio.median,
        ours_ratio_max=ours.ratio.max,
        ours_clean_paths=ours.clean,
        ours_deviation_max=ours.deviation.max,
        ours_over_programme=optimum.pieces[_WHOLE].law_over_refined,
        ours_sent_over_programme=optimum.pieces[_WHOLE].sent_over_refined,
        clean_on_every_path=tuple(clean),
        target_ratio=_TARGET,
        target_met_by=tuple(met),
    )


def _method(rows: Sequence[TimedPath], key: str) -> MethodFigures:
    """Figures of one method over rows; those over no path at all are None."""
    judged = [row.methods[key] for row in rows]
    solved = [row for row in judged if not row.failures]
    ratios = [
        row.methods[key].duration / row.jerk_free for row in rows if not row.methods[key].failures
    ]
    reasons = sorted({f.reason for row in judged for f in row.failures})
    return MethodFigures(
        paths=len(rows),
        failed=len(judged) - len(solved),
        failed_pieces=sum(len(row.failures) for row in judged),
        reasons=tuple(reasons),
        clean=sum(
            sum(row.violations.values()) == 0 and row.deviation <= NO_DEVIATION for row in solved
        ),
        ratio=MedianMax.of(ratios),
        duration=MedianMax.of([row.duration for row in solved]),
        deviation=MedianMax.of([row.deviation for row in solved]),
        joint_deviation=MedianMax.of([row.joint_deviation for row in solved]),
        violations={q: sum(row.violations[q] for row in solved) for q in QUANTITIES},
        worst={q: max((row.ratio[q] for row in solved), default=None) for q in QUANTITIES},
        computing=MedianMax.of([row.computing for row in judged]),
    )


def _start(rows: Sequence[TimedPath]) -> StartFigures:
    """What the start from toppra's profile does to `optimal`.

    Durations with over without it, and CPU times of both.
    """
    both = [(row.methods["ours"], row.methods["without_start"]) for row in rows]
    pairs = [(a, b) for a, b in both if not a.failures and not b.failures]
    ratios = [a.duration / b.duration for a, b in pairs]
    return StartFigures(
        paths=len(pairs),
        duration_ratio=DurationRatio(**vars(MedianMax.of(ratios)), min=min(ratios, default=None)),
        computing=MedianMax.of([a.computing for a, _ in pairs]),
        computing_without=MedianMax.of([b.computing for _, b in pairs]),
    )


def _optimum(rows: Sequence[TimedPath]) -> OptimumFigures:
    """How far ours is above the programme's time and the lower bound, by curved piece and over
    whole paths.
    """
    result: dict[str, PieceRatios] = {}
    for k, name in [*list(enumerate(NAMES))[1:-1], (None, _WHOLE)]:
        columns = []
        for row in rows:
            pieces = row.optimum if k is None else [row.optimum[k]]
            durations = row.methods["ours"].durations
            columns.append(
                [
                    sum(getattr(p, key) for p in pieces)
                    for key in ("bound", "refined", "refined_dense", "law", "jerk_free")
                ]
                + [sum(durations) if k is None else durations[k]]
            )
        bound, refined, dense, law, free, sent = np.array(columns).T
        result[name] = PieceRatios(
            law_over_refined=MedianMax.of(list(law / refined)),
            sent_over_refined=MedianMax.of(list(sent / refined)),
            refined_over_jerk_free=MedianMax.of(list(refined / free)),
            refined_over_bound=MedianMax.of(list(refined / bound)),
            dense_over_refined=MedianMax.of(list(dense / refined)),
        )
    curved = [p for row in rows for p in row.optimum if p.starts]
    pairs = [p.starts for p in curved if len(p.starts) > 1]
    return OptimumFigures(
        pieces=result,
        programmes=len(curved),
        second_starts=len(pairs),
        starts_apart=MedianMax.of([max(x) / min(x) - 1.0 for x in pairs]),
        computing=MedianMax.of([p.computing / len(p.starts) for p in curved]),
    )
