"""`unwrinkle bench loop`: whole runs of the closed loop in the simulated cell, as a user would
start them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import LightSource
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchmarks.harness.report import Progress
from benchmarks.harness.statistics import MedianWorst
from benchmarks.harness.tables import line, rule
from benchmarks.loop.runs import Run, flatten
from unwrinkle.perception.range_map import RangeMap

_RUNS = Path("out") / "loop"
_STAGES = ("render", "stereo", "analysis", "planning", "verification", "motion")
_COMPUTING = ("stereo", "analysis", "planning", "verification")
_FLAT = 0.005  # no higher than this, by truth, m
_TOWELS, _SHIRTS = 10, 5


@dataclass(frozen=True, kw_only=True)
class LoopFigures:
    """One run of `unwrinkle flatten`.

    Attributes:
        name, folder, command: of the run.
        status, reason, exit_code: how it ended.
        wall: s.
        actions, missed, dual: how many.
        height_before, height: of the cloth's highest point, by truth, m.
        coverage_before, coverage: by truth.
        overstretch: greatest after an action.
        unverified: motions without a passing verdict.
        violations: of measured motions.
        seconds: of each action.
    """

    name: str
    folder: str
    command: str
    status: str
    reason: str
    exit_code: int
    wall: float
    actions: int
    missed: int
    dual: int
    height_before: float
    coverage_before: float
    height: float
    coverage: float
    overstretch: float
    unverified: int
    violations: tuple[str, ...]
    seconds: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class StagedRun(LoopFigures):
    """A run with the seconds of its actions by stage."""

    stages: dict[str, MedianWorst]


@dataclass(frozen=True)
class Repeated:
    """Whether a second run of one seed has the same bits, and their digest."""

    same_bits: bool
    fingerprint: str


@dataclass(frozen=True)
class LoopResult:
    """Whole runs.

    Attributes:
        towels, shirts, first, full_size: runs.
        repeated: the first towel again.
        stages: seconds of an action.
        actions_mean, actions_std: of the towels.
        flat_by_truth: towels.
        coverage_least: of the towels.
        dual_share: of the actions.
        unverified_motions, violations: sums.
        overstretch_worst: after an action.
        following_error_worst: rad.
        grip_distance_error_worst, clearance_short_worst: m.
    """

    towels: tuple[LoopFigures, ...]
    shirts: tuple[LoopFigures, ...]
    first: LoopFigures
    full_size: StagedRun | None
    repeated: Repeated
    stages: dict[str, MedianWorst]
    actions_mean: float
    actions_std: float
    flat_by_truth: int
    coverage_least: float
    dual_share: float
    unverified_motions: int
    violations: int
    overstretch_worst: float
    following_error_worst: float
    grip_distance_error_worst: float
    clearance_short_worst: float


def run(*, quick: bool, seed: int, progress: Progress) -> LoopResult:
    """Flatten towels and T-shirts from seeds on; whole runs, each in a process of its own.

    A run that was finished with the very same code is not run again: an interrupted benchmark resumes.
    """
    small = ("--scale", "0.25") if quick else ()
    towels = [
        (f"towel-{k}", ("--seed", str(k), *small))
        for k in range(seed, seed + (1 if quick else _TOWELS))
    ]
    shirts = [
        (f"tshirt-{k}", ("--garment", "tshirt", "--seed", str(k), *small))
        for k in range(seed, seed + (0 if quick else _SHIRTS))
    ]
    again = (f"towel-{seed}-again", ("--seed", str(seed), *small))
    full = (f"towel-{seed}-16-megapixels", ("--seed", str(seed), "--scale", "1"))
    wanted = [*towels, again, *shirts, *([] if quick else [full])]
    runs: dict[str, Run] = {}
    for done, (name, options) in enumerate(wanted):
        progress(done, len(wanted), name)
        runs[name] = flatten(_RUNS, name, options)
    progress(len(wanted), len(wanted), "done")
    flattened = [runs[name] for name, _ in towels]
    first, repeated = flattened[0], runs[again[0]]
    rows = [_row(run) for run in flattened]
    actions = [action for run in flattened for action in run.pulls]
    return LoopResult(
        towels=tuple(rows),
        shirts=tuple(_row(runs[name]) for name, _ in shirts),
        first=rows[0],
        full_size=None if quick else _full_size(runs[full[0]]),
        repeated=Repeated(
            same_bits=first.fingerprint == repeated.fingerprint, fingerprint=first.fingerprint
        ),
        stages=_stages(actions),
        actions_mean=float(np.mean([row.actions for row in rows])),
        actions_std=float(np.std([row.actions for row in rows])),
        flat_by_truth=sum(row.height <= _FLAT for row in rows),
        coverage_least=min(row.coverage for row in rows),
        dual_share=float(np.mean([len(action["arms"]) == 2 for action in actions])),
        unverified_motions=sum(row.unverified for row in rows),
        violations=sum(len(row.violations) for row in rows),
        overstretch_worst=max(row.overstretch for row in rows),
        following_error_worst=_worst(actions, "following_error"),
        grip_distance_error_worst=_worst(actions, "grip_distance_error"),
        clearance_short_worst=max(
            (
                max(0.0, action["clearance"] - action["clearance_measured"])
                for action in actions
                if action["clearance"] is not None and action["clearance_measured"] is not None
            ),
            default=0.0,
        ),
    )


def _full_size(run: Run) -> StagedRun:
    """The row of a run with pictures of full size, and the seconds of its actions by stage."""
    return StagedRun(**vars(_row(run)), stages=_stages(run.pulls))


def _row(run: Run) -> LoopFigures:
    truth = run.truth
    return LoopFigures(
        name=run.name,
        folder=str(run.folder),
        command=" ".join(["unwrinkle flatten", *run.options]),
        status=run.record["status"],
        reason=run.record["reason"],
        exit_code=run.exit_code,
        wall=run.wall,
        actions=len(run.pulls),
        missed=sum(action["outcome"] == "missed" for action in run.actions),
        dual=sum(len(action["arms"]) == 2 for action in run.pulls),
        height_before=run.actions[0]["truth_before"]["height"],
        coverage_before=run.actions[0]["truth_before"]["coverage"],
        height=truth["height"],
        coverage=truth["coverage"],
        overstretch=max(
            (action["truth_after"]["overstretch"] for action in run.pulls), default=0.0
        ),
        unverified=run.unverified(),
        violations=tuple(text for action in run.pulls for text in action["violations"]),
        seconds=tuple(sum(action["seconds"].values()) for action in run.pulls),
    )


def _stages(actions: list[dict[str, Any]]) -> dict[str, MedianWorst]:
    """Median and worst seconds of an action, by stage."""
    columns = {stage: [a["seconds"].get(stage, 0.0) for a in actions] for stage in _STAGES}
    columns["computing"] = [
        sum(a["seconds"].get(stage, 0.0) for stage in _COMPUTING) for a in actions
    ]
    columns["total"] = [sum(a["seconds"].values()) for a in actions]
    return {name: MedianWorst.of(values) for name, values in columns.items() if values}


def _worst(actions: list[dict[str, Any]], key: str) -> float:
    return max((a[key] for a in actions if a[key] is not None), default=0.0)


def table(results: LoopResult) -> str:
    """Return the headlines, a row per run, and the seconds of an action by stage."""
    first, stages = results.first, results.stages
    count = len(results.towels)
    lines = [
        "Cloth and robot are simulated; every run is a process of its own, from start to its written report.",
        "",
        line("what", "target", "measured"),
        rule(3),
        line("default run: status, actions", "flat, at most 5", f"{first.status}, {first.actions}"),
        line("its largest true height", "5 mm", f"{1e3 * first.height:.1f} mm"),
        line("its wall clock, installed", "240 s", f"{first.wall:.0f} s"),
        (
            line(
                "bunched towels flat by truth",
                f"{count} of {count}, or a reason",
                f"{results.flat_by_truth} of {count}",
            )
        ),
        line("least coverage", "98 %", f"{100 * results.coverage_least:.1f} %"),
        line("motions without a verdict", "0", f"{results.unverified_motions}"),
        line("limits and clearances broken by measured motions", "0", f"{results.violations}"),
        (
            line(
                "overstretch of the cloth after an action, worst",
                "10 %",
                f"{100 * results.overstretch_worst:.1f} %",
            )
        ),
        (
            line(
                "actions per towel, mean (std)",
                "",
                f"{results.actions_mean:.1f} ({results.actions_std:.2f})",
            )
        ),
        line("dual-arm share of actions", "", f"{100 * results.dual_share:.1f} %"),
        line(
            "perception + planning + verification, worst",
            "5 s",
            f"{stages['computing'].worst:.1f} s",
        ),
        (
            line(
                "one action, median (worst)",
                "25 s",
                f"{stages['total'].median:.1f} s ({stages['total'].worst:.1f} s)",
            )
        ),
        (
            line(
                "following error after lag, worst",
                "1 mrad",
                f"{1e3 * results.following_error_worst:.2f} mrad",
            )
        ),
        (
            line(
                "gripper distance against plan, worst",
                "3 mm",
                f"{1e3 * results.grip_distance_error_worst:.2f} mm",
            )
        ),
        (
            line(
                "clearance below the verdict's, worst",
                "within the padding",
                f"{1e3 * results.clearance_short_worst:.2f} mm",
            )
        ),
        (
            line(
                "two runs of one seed: plans and last state",
                "same bits",
                f"{('same bits' if results.repeated.same_bits else 'DIFFERENT')}",
            )
        ),
        "",
        "Seconds of an action, by stage (a noisy machine: compare medians):",
        "",
        line("stage", "median", "worst"),
        rule(3),
        *(
            line(f"{name}", f"{values.median:.2f}", f"{values.worst:.2f}")
            for name, values in stages.items()
        ),
        "",
        "## Bunched towels",
        "",
        *_rows(results.towels),
    ]
    if results.full_size:
        full = results.full_size
        stages = full.stages
        lines += [
            "",
            "## Pictures of 16 megapixels",
            "",
            *_rows([full]),
            (
                f"An action takes {stages['total'].median:.1f} s (median; worst "
                f"{stages['total'].worst:.1f} s), of which the pictures {stages['render'].median:.1f} s "
                f"and perception, planning and verification {stages['computing'].median:.1f} s."
            ),
        ]
    if results.shirts:
        lines += ["", "## T-shirts, as they are", "", *_rows(results.shirts)]
    return "\n".join([*lines, ""])


def _rows(rows: Sequence[LoopFigures]) -> list[str]:
    lines = [
        line(
            "run",
            "ended",
            "actions (dual, missed)",
            "true height, mm",
            "coverage, %",
            "overstretch, %",
            "wall, s",
        ),
        rule(7),
        *(
            line(
                f"{row.name}",
                f"{row.status}",
                f"{row.actions} ({row.dual}, {row.missed})",
                f"{1e3 * row.height_before:.1f} to {1e3 * row.height:.1f}",
                f"{100 * row.coverage_before:.1f} to {100 * row.coverage:.1f}",
                f"{100 * row.overstretch:.1f}",
                f"{row.wall:.0f}",
            )
            for row in rows
        ),
        "",
    ]
    lines += [f"- {row.name}: {row.reason}" for row in rows if row.status != "flat"]
    return lines


def plot(results: LoopResult, path: Path) -> None:
    """Draw what the head measured first and last in every run, as shaded relief."""
    rows = [*results.towels, *results.shirts]
    columns = 5
    count = -(-len(rows) // columns)
    figure = Figure(figsize=(3.0 * columns, 1.8 * count), layout="constrained")
    grid = figure.subplots(count, 2 * columns, squeeze=False)
    for axes in grid.flat:
        axes.set_axis_off()
    for place, row in enumerate(rows):
        looks = sorted(Path(row.folder).glob("[0-9]*/range_map.npz"))
        pair = grid[place // columns, 2 * (place % columns) : 2 * (place % columns) + 2]
        for axes, look in zip(pair, (looks[0], looks[-1]), strict=True):
            axes.imshow(_relief(RangeMap.load(look)), origin="lower", cmap="gray", vmin=0, vmax=1)
            axes.set_axis_off()
        pair[0].set_title(f"{row.name}: {row.actions} actions", fontsize=8, loc="left")
        pair[1].set_title(f"{1e3 * row.height:.0f} mm, {row.status}", fontsize=8, loc="left")
    figure.savefig(path, dpi=80)


def _relief(seen: RangeMap) -> NDArray[np.float64]:
    height = np.where(seen.garment & seen.valid, seen.height, 0.0)
    light = LightSource(azdeg=315, altdeg=45)
    shade = light.hillshade(height, vert_exag=1.5, dx=seen.resolution, dy=seen.resolution)
    return np.where(seen.garment & seen.valid, shade, 1.0)
