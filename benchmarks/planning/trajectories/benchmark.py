"""`unwrinkle bench trajectories`.

Ways to time the seven-pose paths of a public set, under one judge.
"""

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.harness.report import Progress
from benchmarks.harness.trials import Trial, run_trials
from benchmarks.planning.trajectories.measures import NO_DEVIATION, QUANTITIES
from benchmarks.planning.trajectories.methods import METHODS, PERIOD, TRACKING_PERIOD
from benchmarks.planning.trajectories.page import draw, page
from benchmarks.planning.trajectories.paths import NAMES, load_paths
from benchmarks.planning.trajectories.trials import MARGIN
from unwrinkle.planning.verification.joint_limits import TOLERANCE

_GROUPS = ("forward", "lateral", "wide")
_QUICK = 4
_SECOND_START = 4  # every so many paths the programme is also started from elsewhere
_WHOLE = "whole path"
_TARGET = 1.40  # times toppra's jerk-free time


def run(*, quick: bool, seed: int, progress: Progress) -> dict[str, Any]:
    """Time every path of the set in every way, and judge the samples.

    The set is fixed, and nothing is drawn at random: the seed changes nothing.

    Returns:
        `set`, `judge`, the `headline`, and figures by method: `methods`, `groups`; `optimum`;
        `rows`, one per path.
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
    kept = ("path", "group", "jerk_free", "methods", "optimum")
    return summary(
        [{key: row[key] for key in kept} for row in run_trials("trajectories", wanted, progress)]
    )


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Figures over rows of the board, with the rows."""
    paths = load_paths()
    methods = {key: _method(rows, key) for key in METHODS}
    optimum = _optimum(rows)
    return {
        "set": {
            "file": "benchmarks/paths/seven_pose_paths.npz",
            "sha256": paths.header["sha256"],
            "seed": paths.header["seed"],
            "paths": len(paths.paths),
            "timed": len(rows),
            "points": int(sum(len(p.q) for path in paths.paths for p in path.pieces)),
        },
        "judge": {
            "margin": MARGIN,
            "period": PERIOD,
            "tracking_period": TRACKING_PERIOD,
            "tolerance": TOLERANCE,
            "no_deviation": NO_DEVIATION,
        },
        "headline": _headline(methods, optimum),
        "methods": methods,
        "groups": {
            group: {key: _method([r for r in rows if r["group"] == group], key) for key in METHODS}
            for group in _GROUPS
        },
        "optimum": optimum,
        "start": _start(rows),
        "rows": rows,
    }


def table(results: dict[str, Any]) -> str:
    """The results as Markdown."""
    return page(results)


def plot(results: dict[str, Any], path: Path) -> None:
    """Draw duration against deviation for every method, and one axis of one piece over time."""
    draw(results, path)


def _headline(methods: dict[str, Any], optimum: dict[str, Any]) -> dict[str, Any]:
    ours = methods["ours"]
    clean = [
        key
        for key, row in methods.items()
        if row["clean"] == row["paths"] and key != "without_start"  # the same law as ours
    ]
    met = [key for key in clean if methods[key]["ratio"]["max"] <= _TARGET]
    return {
        "ours_ratio_median": ours["ratio"]["median"],
        "ours_ratio_max": ours["ratio"]["max"],
        "ours_clean_paths": ours["clean"],
        "ours_deviation_max": ours["deviation"]["max"],
        "ours_over_programme": optimum["pieces"][_WHOLE]["law_over_refined"],
        "ours_sent_over_programme": optimum["pieces"][_WHOLE]["sent_over_refined"],
        "clean_on_every_path": clean,
        "target_ratio": _TARGET,
        "target_met_by": met,
    }


def _method(rows: list[dict[str, Any]], key: str) -> dict[str, Any]:
    """Figures of one method over rows; those over no path at all are None."""
    judged = [row["methods"][key] for row in rows]
    solved = [row for row in judged if not row["failures"]]
    ratios = [
        row["methods"][key]["duration"] / row["jerk_free"]
        for row in rows
        if not row["methods"][key]["failures"]
    ]
    reasons = sorted({f["reason"] for row in judged for f in row["failures"]})
    return {
        "paths": len(rows),
        "failed": len(judged) - len(solved),
        "failed_pieces": sum(len(row["failures"]) for row in judged),
        "reasons": reasons,
        "clean": sum(
            sum(row["violations"].values()) == 0 and row["deviation"] <= NO_DEVIATION
            for row in solved
        ),
        "ratio": _spread(ratios),
        "duration": _spread([row["duration"] for row in solved]),
        "deviation": _spread([row["deviation"] for row in solved]),
        "joint_deviation": _spread([row["joint_deviation"] for row in solved]),
        "violations": {q: sum(row["violations"][q] for row in solved) for q in QUANTITIES},
        "worst": {q: max((row["ratio"][q] for row in solved), default=None) for q in QUANTITIES},
        "computing": _spread([row["computing"] for row in judged]),
    }


def _start(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """What the start from toppra's profile does to `optimal`.

    Durations with over without it, and CPU times of both.
    """
    both = [(row["methods"]["ours"], row["methods"]["without_start"]) for row in rows]
    pairs = [(a, b) for a, b in both if not a["failures"] and not b["failures"]]
    ratios = [a["duration"] / b["duration"] for a, b in pairs]
    return {
        "paths": len(pairs),
        "duration_ratio": _spread(ratios) | {"min": min(ratios, default=None)},
        "computing": _spread([a["computing"] for a, _ in pairs]),
        "computing_without": _spread([b["computing"] for _, b in pairs]),
    }


def _spread(values: list[float]) -> dict[str, float | None]:
    if not values:
        return {"median": None, "max": None}
    return {"median": float(np.median(values)), "max": float(np.max(values))}


def _optimum(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """How far ours is above the programme's time and the lower bound, by curved piece and over
    whole paths.
    """
    result: dict[str, Any] = {}
    for k, name in [*list(enumerate(NAMES))[1:-1], (None, _WHOLE)]:
        columns = []
        for row in rows:
            pieces = row["optimum"] if k is None else [row["optimum"][k]]
            durations = row["methods"]["ours"]["durations"]
            columns.append(
                [
                    sum(p[key] for p in pieces)
                    for key in ("bound", "refined", "refined_dense", "law", "jerk_free")
                ]
                + [sum(durations) if k is None else durations[k]]
            )
        bound, refined, dense, law, free, sent = np.array(columns).T
        result[name] = {
            "law_over_refined": _spread(list(law / refined)),
            "sent_over_refined": _spread(list(sent / refined)),
            "refined_over_jerk_free": _spread(list(refined / free)),
            "refined_over_bound": _spread(list(refined / bound)),
            "dense_over_refined": _spread(list(dense / refined)),
        }
    curved = [p for row in rows for p in row["optimum"] if p["starts"]]
    pairs = [p["starts"] for p in curved if len(p["starts"]) > 1]
    return {
        "pieces": result,
        "programmes": len(curved),
        "second_starts": len(pairs),
        "starts_apart": _spread([max(x) / min(x) - 1.0 for x in pairs]),
        "computing": _spread([p["computing"] / len(p["starts"]) for p in curved]),
    }
