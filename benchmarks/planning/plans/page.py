"""The planning benchmark's results as Markdown."""

from typing import Any

_GROUPS = (
    ("forward", "8 directions x 5 places, about forward"),
    ("lateral", "8 directions x 5 places, about lateral"),
    ("wide", "+-90 deg, y -1.0..-1.3"),
)


def plans_table(results: dict[str, Any]) -> str:
    """Tables of success, times, margins, failures and baselines."""
    parts = [
        _success(results),
        _times(results),
        _smoothings(results),
        _margins(results),
        _lines(results),
        _baselines(results),
    ]
    if results["failures"]:
        lines = [f"- {cause}: {text}" for cause, text in results["failures"]]
        parts.append("Targets without a dual-arm plan:\n\n" + "\n".join(lines) + "\n")
    return "\n".join(parts)


def _row(*cells: str) -> str:
    return "| " + " | ".join(cells) + " |"


def _head(*cells: str) -> list[str]:
    return [_row(*cells), _row(*["---"] * len(cells))]


def _seconds(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def _millimetres(value: float | None) -> str:
    return "-" if value is None else f"{1e3 * value:.1f}"


def _success(results: dict[str, Any]) -> str:
    lines = _head(
        "targets on the table",
        "number",
        "dual-arm",
        "single-arm rescue",
        "verdicts passed",
        "target",
        "dual-arm, turn-table fixed",
    )
    fixed = results["turntable_fixed"]
    goals = {"forward": "1.00", "lateral": "1.00", "wide": ">= 0.98"}
    for key, title in _GROUPS:
        r = results[key]
        lines.append(
            _row(
                title,
                str(r["tasks"]),
                f"{r['dual_arm_success']:.3f}",
                str(r["single_arm_rescues"]),
                f"{r['verdicts_passed_fraction']:.3f}",
                goals[key],
                f"{fixed[key]['dual_arm_success']:.3f}",
            )
        )
    refused = [
        (title, len(results[key]["refused"] if key else results["refused"]))
        for title, key in (("catalogue speed", ""), ("site speed", "site_speed"))
    ]
    return (
        "\n".join(lines)
        + f"\n\nLeft out: {results['off_table']} targets whose grasp point lies beside the table. Of the others "
        f"{results['dual_arm_success']:.3f} have a dual-arm plan, with the turn-table fixed "
        f"{fixed['dual_arm_success']:.3f} (and {fixed['single_arm_rescues']} a single-arm one). Targets of which the verification "
        "refused a plan before one passed: "
        + ", ".join(f"{n} at {title}" for title, n in refused)
        + ".\n"
    )


def _times(results: dict[str, Any]) -> str:
    lines = _head("planning, s", "median", "p95", "max", "target")
    goals = {"planning": "0.12 / 0.6 / 1.5"}
    titles = {"planning": "**whole plan**", "planning_cpu": "whole plan, CPU time"}
    for stage in ("search", "transit", "timing", "planning", "planning_cpu", "verification"):
        r = results[f"{stage}_time"]
        title = titles.get(stage, stage)
        lines.append(
            _row(
                title,
                *(f"{r[key]:.3f}" for key in ("median", "p95", "max")),
                goals.get(stage, ""),
            )
        )
    return (
        "\n".join(lines)
        + "\n\nAll but the CPU time is time on the clock, which other jobs on the machine lengthen. The planner runs in one thread.\n"
    )


def _smoothings(results: dict[str, Any]) -> str:
    lines = _head(
        "`timing: {smoothing: ...}`",
        "timing median, s",
        "whole plan median, s (CPU time)",
        "motion time median / max, s",
        "over toppra's optimum, median / max",
        "target, median",
        "curved pieces alone, median / max",
        "worst velocity, acceleration, jerk ratio as sent",
        "verdicts passed",
    )
    for title, r, goal in (
        ("`optimal`", results, "1.26"),
        ("`ruckig`", results["smoothing_ruckig"], "about 1.6"),
    ):
        ratios = [r[f"worst_{name}_ratio_sent"] for name in ("velocity", "acceleration", "jerk")]
        lines.append(
            _row(
                title,
                _seconds(r["timing_time"]["median"]),
                f"{_seconds(r['planning_time']['median'])} ({_seconds(r['planning_cpu_time']['median'])})",
                f"{r['motion_time_median']:.2f} / {r['motion_time_max']:.2f}",
                f"{r['motion_time_ratio_median']:.3f} / {r['motion_time_ratio_max']:.3f}",
                goal,
                f"{r['curved_time_ratio_median']:.3f} / {r['curved_time_ratio_max']:.3f}",
                ", ".join(f"{ratio:.4f}" for ratio in ratios),
                f"{r['verdicts_passed_fraction']:.3f}",
            )
        )
    return (
        "\n".join(lines)
        + "\n\ntoppra's optimum is that without a jerk limit, at the full limits, on the same paths with the same stops. "
        "Straight joint lines are ruckig's in both rows. All other tables are of `optimal`.\n"
    )


def _margins(results: dict[str, Any]) -> str:
    slow = results["site_speed"]
    lines = _head(
        "motion", "catalogue speed", f"site speed ({100 * slow['speed']:.0f} %)", "target"
    )
    rows = (
        ("motion time median, s", "motion_time_median", "{:.2f}", ""),
        ("motion time max, s", "motion_time_max", "{:.2f}", ""),
        ("over toppra's optimum, median", "motion_time_ratio_median", "{:.3f}", "<= 1.40"),
        ("over toppra's optimum, max", "motion_time_ratio_max", "{:.3f}", ""),
        ("worst velocity ratio", "worst_velocity_ratio", "{:.4f}", "<= 1.000"),
        ("worst acceleration ratio", "worst_acceleration_ratio", "{:.4f}", "<= 1.000"),
        ("worst jerk ratio", "worst_jerk_ratio", "{:.4f}", "<= 1.000"),
        ("as sent: worst velocity ratio", "worst_velocity_ratio_sent", "{:.4f}", "<= 1.000"),
        (
            "as sent: worst acceleration ratio",
            "worst_acceleration_ratio_sent",
            "{:.4f}",
            "<= 1.000",
        ),
        ("as sent: worst jerk ratio", "worst_jerk_ratio_sent", "{:.4f}", "<= 1.000"),
        ("smallest clearance, m", "smallest_clearance", "{:.4f}", ""),
    )
    for title, key, form, goal in rows:
        lines.append(_row(title, form.format(results[key]), form.format(slow[key]), goal))
    lines.append("")
    lines.append(
        f"Smallest clearance: {results['smallest_clearance_pair']}. Clearance per kind of pair, m: "
        + ", ".join(f"{kind} {value:.4f}" for kind, value in results["clearances"].items())
        + f". Transits: {results['transit_kinds']}."
    )
    return "\n".join(lines) + "\n"


def _lines(results: dict[str, Any]) -> str:
    lines = _head(
        "random straight lines, speed",
        "samples every, ms",
        "lines",
        "off the line",
        "greatest distance, rad",
        "velocity",
        "acceleration",
        "jerk, as sent over the limits",
    )
    for line in results["random_lines"]:
        lines.append(
            _row(
                f"{line['speed']:g}",
                f"{1e3 * line['period']:.0f}",
                str(line["lines"]),
                str(line["off"]),
                f"{line['deviation_max']:.1e}",
                *(
                    f"{line[f'worst_{name}_ratio_sent']:.4f}"
                    for name in ("velocity", "acceleration", "jerk")
                ),
            )
        )
    return (
        "\n".join(lines)
        + "\n\nAs sent: positions and velocities as float32, times as whole milliseconds. Greatest distance of a sample from a "
        f"line that was checked for collision, in these and in all plans: {results['line_deviation_max']:.1e} rad.\n"
    )


def _baselines(results: dict[str, Any]) -> str:
    own, drake, rrt = (
        results[k] for k in ("same_tasks", "drake_inverse_kinematics", "ompl_rrt_connect")
    )
    lines = _head(f"on the same {own['tasks']} targets", "own", "Drake IK in the search", "OMPL")
    if "skipped" in rrt:
        return f"OMPL's RRT-Connect was skipped: {rrt['skipped']}.\n"
    lines += [
        _row(
            "dual-arm success",
            f"{own['dual_arm_success']:.3f}",
            f"{drake['dual_arm_success']:.3f} ({drake['out_of_time']} out of time)",
            f"{rrt['dual_arm_success']:.3f}",
        ),
        _row(
            "search time median, s",
            _seconds(own["search_time"]["median"]),
            _seconds(drake["search_time_median"]),
            "(poses from the own search)",
        ),
        _row(
            "search time p95, s",
            _seconds(own["search_time"]["p95"]),
            _seconds(drake["search_time_p95"]),
            "",
        ),
        _row(
            "whole plan median, s",
            _seconds(own["planning_time_median"]),
            "",
            _seconds(rrt["planning_time_median"]),
        ),
        _row(
            "motion median, s",
            _seconds(own["motion_time_median"]),
            "",
            _seconds(rrt["motion_time_median"]),
        ),
        _row(
            "tip off the Cartesian path, median / max, mm",
            "0",
            "",
            f"{_millimetres(rrt['deviation_median'])} / {_millimetres(rrt['deviation_max'])}",
        ),
    ]
    return "\n".join(lines) + "\n"
