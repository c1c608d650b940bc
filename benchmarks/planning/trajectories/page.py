"""The page of the benchmark `trajectories`, and its figure."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.harness.tables import line, rule
from benchmarks.planning.trajectories.measures import limit_ratios
from benchmarks.planning.trajectories.methods import METHODS, Failure
from benchmarks.planning.trajectories.paths import load_paths
from benchmarks.planning.trajectories.results import (
    MedianMax,
    MethodFigures,
    OptimumFigures,
    StartFigures,
    TrajectoriesResult,
)
from benchmarks.planning.trajectories.trials import find, problem_of

_COLOURS = {
    "toppra": "tab:gray",
    "moveit_sent": "tab:orange",
    "moveit_mitigated": "tab:brown",
    "moveit_motion": "tab:red",
    "tracking": "tab:purple",
    "ruckig": "tab:green",
    "without_start": "tab:cyan",
    "ours": "tab:blue",
}
_SHOWN = ("toppra", "moveit_sent", "tracking", "ours")  # over time
_PIECE = 1  # the approach
_FLOOR = 1e-5  # mm, of the logarithmic axis


def page(results: TrajectoriesResult) -> str:
    """The results as Markdown."""
    head, about, judge = results.headline, results.set, results.judge
    met, clean = (
        ", ".join(METHODS[key][0] for key in keys) or "none"
        for keys in (head.target_met_by, head.clean_on_every_path)
    )
    lines = [
        (
            f"{about.timed} of the {about.paths} seven-pose paths of `{about.file}` (SHA-256 "
            f"{about.sha256[:16]}; see the README beside it), timed under the same limits. The robot is a model: "
            "its accelerations and jerks are assumed, and nothing here ran on a machine. MoveIt 2's way is "
            "re-implemented from its behaviour, with toppra in the place of its TOTG."
        ),
        "",
        (
            f"Target: no violation, no deviation, at most {head.target_ratio:.2f} times toppra's jerk-free "
            f"time, on every path. It is met by: **{met}**. Ours (`timing: {{smoothing: optimal}}`, the default) takes {head.ours_ratio_median:.3f} (median) and "
            f"{head.ours_ratio_max:.3f} (worst) times that; {head.ours_clean_paths} of {about.timed} paths "
            f"without a violation or a deviation (worst {1e6 * (head.ours_deviation_max or 0.0):.2f} um). Under the same limits "
            f"an independent nonlinear programme is faster by {_percent(head.ours_over_programme)} (median, worst) of a "
            f"whole path. Without a violation or a "
            f"deviation on every path: {clean}."
        ),
        "",
        *_main(results.methods),
        "",
        (
            f"Time is that in motion, over toppra's optimum without a jerk limit at full limits; all methods stop at "
            f"the same six places, keep {100 * judge.margin:.1f} % below every limit, and end on a sample "
            f"(period {1e3 * judge.period:.0f} ms, tracking {1e3 * judge.tracking_period:.0f} ms). Violations "
            f"count sample intervals times axes beyond the full limits (relative tolerance {judge.tolerance:.0e}) "
            "in the cubics that the controller runs between samples; where acceleration jumps from sample to sample, "
            "those cubics overshoot it, and jerk has no bound but the sampling rate. Deviation is the greatest "
            "distance of either tool centre point from the path's nearest point, between samples too; up to "
            f"{1e3 * judge.no_deviation:.2f} mm counts as none. CPU time is that of all five pieces; toppra's law, "
            "which MoveIt 2 and the tracking start from, is counted under toppra alone, while ours include their own."
        ),
        "",
        *_reasons(results.methods),
        *_start(results.start),
        "## How near to the optimum",
        "",
        *_optimum(results.optimum),
        "",
        "## By group",
        "",
        *_groups(results.groups),
        "",
        (
            "To time the set with other software: read the file with NumPy (five lines in `benchmarks/planning/trajectories/path_set/README.md`), "
            "time each piece from rest to rest under the limits in its header, and compare the sum over the five "
            "pieces with `paths[].jerk_free` in this page's JSON."
        ),
    ]
    return "\n".join([*lines, ""])


def _main(methods: dict[str, MethodFigures]) -> list[str]:
    lines = [
        (
            line(
                "method",
                "failed",
                "clean paths",
                "time / jerk-free, median (max)",
                "violations v, a, j, tip",
                "worst v, a, j, tip over limit",
                "off the path, median (max), mm",
                "joints, max, rad",
                "CPU, median, s",
            )
        ),
        rule(9),
    ]
    for key, (label, _) in METHODS.items():
        row = methods[key]
        label = f"**{label}**" if key == "ours" else label
        head = f"| {label} | {row.failed} | {row.clean} of {row.paths} "
        if row.failed == row.paths:
            lines.append(head + "| | | | | | |")
            continue
        worst = ", ".join(f"{value:.3g}" for value in row.worst.values())
        lines.append(
            head + f"| {row.ratio.median:.3f} ({row.ratio.max:.3f}) "
            f"| {', '.join(str(n) for n in row.violations.values())} | {worst} "
            f"| {_mm(row.deviation.median)} ({_mm(row.deviation.max)}) "
            f"| {row.joint_deviation.max:.1e} | {row.computing.median:.2f} |"
        )
    return lines


def _percent(spread: MedianMax) -> str:
    """Median and worst of times over the programme's, as what the programme saves."""
    median, worst = (100.0 * (1.0 - 1.0 / (value or 1.0)) for value in (spread.median, spread.max))
    return f"{median:.1f} % and {worst:.1f} %"


def _mm(value: float | None) -> str:
    if value is None:
        return "-"
    return f"{1e3 * value:.4f}" if value < 1e-5 else f"{1e3 * value:.3g}"


def _reasons(methods: dict[str, MethodFigures]) -> list[str]:
    lines = [
        f"- {METHODS[key][0]}, {row.failed_pieces} pieces: {'; '.join(row.reasons)}"
        for key, row in methods.items()
        if row.reasons
    ]
    return ["Why methods failed:", "", *lines, ""] if lines else []


def _start(start: StartFigures) -> list[str]:
    if not start.paths:
        return []
    ratio, own, without = start.duration_ratio, start.computing, start.computing_without
    return [
        "## What the start from toppra's profile does",
        "",
        (
            f"`optimal` started from toppra's profile takes {ratio.median:.5f} (median; {ratio.min:.5f} to "
            f"{ratio.max:.5f}) times the motion time that it takes when it starts from a constant, on {start.paths} paths. "
            f"CPU time, toppra included: {1e3 * (own.median or 0.0):.0f} ms (median) against {1e3 * (without.median or 0.0):.0f} ms."
        ),
        "",
    ]


def _optimum(optimum: OptimumFigures) -> list[str]:
    apart, computing = optimum.starts_apart, optimum.computing
    lines = [
        (
            "Straight lines (the transits) are timed at the optimum: a phase-synchronised ruckig motion is the fastest on a "
            "line. Along curves ours is compared with an independent nonlinear programme over s(t) (direct "
            f"transcription in time, 120 intervals of constant third derivative, {optimum.programmes} pieces). Its "
            "limits hold at its nodes, so that its time is slightly too small, and ours over it slightly too large. "
            "The lower bound is certain but not reachable in general: the greater of toppra's jerk-free time and the "
            "time that the slowest axis alone needs from end to end with its jerk limit."
        ),
        "",
        (
            line(
                "piece",
                "our law at full limits / programme, median (max)",
                "as sent / programme",
                "programme on a grid 8 x finer / at its nodes",
                "programme / jerk-free",
                "programme / lower bound",
            )
        ),
        rule(6),
    ]
    for name, row in optimum.pieces.items():
        cells = [
            f"{each.median:.4f} ({each.max:.4f})"
            for each in (
                row.law_over_refined,
                row.sent_over_refined,
                row.dense_over_refined,
                row.refined_over_jerk_free,
                row.refined_over_bound,
            )
        ]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    lines += [
        "",
        (
            "As sent there are also the margin below the limits and the rounding to samples. "
            + (
                f"Started from a fifth-order polynomial in time besides from ours, the programme ends at the same time on "
                f"{optimum.second_starts} pieces, {100 * (apart.max or 0.0):.2f} % apart at most. "
                if apart.max is not None
                else ""
            )
            + f"It takes {computing.median:.1f} s (median) a piece and start, ours some hundredths of a second for three."
        ),
    ]
    return lines


def _groups(groups: dict[str, dict[str, MethodFigures]]) -> list[str]:
    names = [name for name, rows in groups.items() if rows["ours"].paths]
    titles = " | ".join(f"{name} ({groups[name]['ours'].paths} paths)" for name in names)
    lines = [
        "Time over toppra's jerk-free time, median (max); greatest deviation, mm:",
        "",
        line("method", f"{titles}"),
        "|---" * (len(names) + 1) + "|",
    ]
    for key, (label, _) in METHODS.items():
        cells = []
        for name in names:
            row = groups[name][key]
            cells.append(
                "failed"
                if row.ratio.median is None
                else f"{row.ratio.median:.3f} ({row.ratio.max:.3f}); {_mm(row.deviation.max)}"
            )
        lines.append(f"| {label} | " + " | ".join(cells) + " |")
    return lines


def draw(results: TrajectoriesResult, file: Path) -> None:
    """Duration over deviation, one point per path and method.

    Beside it one axis of one approach over time.
    """
    figure = Figure(figsize=(13.0, 6.0), layout="constrained")
    grid = figure.add_gridspec(3, 2)
    axes = figure.add_subplot(grid[:, 0])
    for key, (label, _) in METHODS.items():
        points = [
            (
                1e3 * row.methods[key].deviation,
                row.methods[key].duration / row.jerk_free,
            )
            for row in results.paths
            if not row.methods[key].failures
        ]
        if points:
            deviation, ratio = np.array(points).T
            violations = sum(results.methods[key].violations.values())
            axes.scatter(
                np.maximum(deviation, _FLOOR),
                ratio,
                s=22,
                color=_COLOURS[key],
                marker="x" if violations else "o",
                label=label,
            )
    axes.axhline(results.headline.target_ratio, color="0.5", linestyle=":", linewidth=1)
    axes.set(
        xscale="log",
        yscale="log",
        xlabel="greatest deviation of a tool centre point from the path, mm",
        ylabel="time in motion / toppra's jerk-free time",
        title="one mark per path; a cross: the method breaks limits",
    )
    axes.set_yticks([1, 1.2, 1.4, 2, 3, 4, 5], ["1", "1.2", "1.4", "2", "3", "4", "5"])
    axes.minorticks_off()
    axes.legend(fontsize=8)
    _draw_example(results.paths[0].path, [figure.add_subplot(grid[i, 1]) for i in range(3)])
    figure.savefig(file, dpi=90)


def _draw_example(name: str, rows: list[Axes]) -> None:
    """Velocity, acceleration and jerk over their limits of the axis that has most to do in a path's
    approach.
    """
    paths = load_paths()
    path = find(paths, name)
    problem = problem_of(path, paths.limits)
    axis = int(
        np.argmax(np.abs(np.diff(path.pieces[_PIECE].q, axis=0)).sum(0) / paths.limits.velocity)
    )
    for key in _SHOWN:
        samples = METHODS[key][1](problem)[_PIECE]
        if isinstance(samples, Failure):
            continue
        middle = 0.5 * (samples[0][1:] + samples[0][:-1])
        ratios = limit_ratios(samples, paths.limits)
        for axes, quantity in zip(rows, ratios.values(), strict=True):
            axes.plot(middle, quantity[:, axis], color=_COLOURS[key], label=METHODS[key][0], lw=1.2)
    for axes, label in zip(rows, ("|velocity|", "|acceleration|", "|jerk|"), strict=True):
        axes.axhline(1.0, color="black", linewidth=0.8, linestyle="--")
        axes.set_ylabel(f"{label} / limit")
    rows[2].set_yscale("symlog", linthresh=1.0)
    rows[2].set_ylim(bottom=0.0)
    rows[0].legend(fontsize=8)
    rows[0].set_title(f"{paths.header['axes'][axis]} in the approach of {name}")
    rows[2].set_xlabel("time, s")
