"""The planning benchmark's results as Markdown."""

from benchmarks.harness.tables import table
from benchmarks.planning.plans.results import PlansResult

_GROUPS = (
    ("forward", "8 directions x 5 places, about forward"),
    ("lateral", "8 directions x 5 places, about lateral"),
    ("wide", "+-90 deg, y -1.0..-1.3"),
)


def plans_table(results: PlansResult) -> str:
    """Tables of success, times, margins, failures and baselines."""
    parts = [
        _success(results),
        _times(results),
        _smoothings(results),
        _margins(results),
        _lines(results),
        _baselines(results),
    ]
    if results.failures:
        lines = [f"- {cause}: {text}" for cause, text in results.failures]
        parts.append("Targets without a dual-arm plan:\n\n" + "\n".join(lines) + "\n")
    return "\n".join(parts)


def _seconds(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def _millimetres(value: float | None) -> str:
    return "-" if value is None else f"{1e3 * value:.1f}"


def _success(results: PlansResult) -> str:
    columns = (
        "targets on the table",
        "number",
        "dual-arm",
        "single-arm rescue",
        "verdicts passed",
        "target",
        "dual-arm, turn-table fixed",
    )
    lines: list[tuple[str, ...]] = []
    fixed = results.turntable_fixed
    goals = {"forward": "1.00", "lateral": "1.00", "wide": ">= 0.98"}
    for key, title in _GROUPS:
        r = getattr(results, key)
        lines.append(
            (
                title,
                str(r.tasks),
                f"{r.dual_arm_success:.3f}",
                str(r.single_arm_rescues),
                f"{r.verdicts_passed_fraction:.3f}",
                goals[key],
                f"{getattr(fixed, key).dual_arm_success:.3f}",
            )
        )
    refused = [
        (title, len(getattr(results, key).refused if key else results.refused))
        for title, key in (("catalogue speed", ""), ("site speed", "site_speed"))
    ]
    return (
        table(columns, lines)
        + f"\n\nLeft out: {results.off_table} targets whose grasp point lies beside the table. Of the others "
        f"{results.dual_arm_success:.3f} have a dual-arm plan, with the turn-table fixed "
        f"{fixed.dual_arm_success:.3f} (and {fixed.single_arm_rescues} a single-arm one). Targets of which the verification "
        "refused a plan before one passed: "
        + ", ".join(f"{n} at {title}" for title, n in refused)
        + ".\n"
    )


def _times(results: PlansResult) -> str:
    columns = ("planning, s", "median", "p95", "max", "target")
    lines: list[tuple[str, ...]] = []
    goals = {"planning": "0.12 / 0.6 / 1.5"}
    titles = {"planning": "**whole plan**", "planning_cpu": "whole plan, CPU time"}
    for stage in ("search", "transit", "timing", "planning", "planning_cpu", "verification"):
        r = getattr(results, f"{stage}_time")
        title = titles.get(stage, stage)
        lines.append(
            (
                title,
                *(f"{value:.3f}" for value in (r.median, r.p95, r.max)),
                goals.get(stage, ""),
            )
        )
    return (
        table(columns, lines)
        + "\n\nAll but the CPU time is time on the clock, which other jobs on the machine lengthen. The planner runs in one thread.\n"
    )


def _smoothings(results: PlansResult) -> str:
    columns = (
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
    lines: list[tuple[str, ...]] = []
    for title, r, goal in (
        ("`optimal`", results, "1.26"),
        ("`ruckig`", results.smoothing_ruckig, "about 1.6"),
    ):
        ratios = [
            getattr(r, f"worst_{name}_ratio_sent") for name in ("velocity", "acceleration", "jerk")
        ]
        lines.append(
            (
                title,
                _seconds(r.timing_time.median),
                f"{_seconds(r.planning_time.median)} ({_seconds(r.planning_cpu_time.median)})",
                f"{r.motion_time_median:.2f} / {r.motion_time_max:.2f}",
                f"{r.motion_time_ratio_median:.3f} / {r.motion_time_ratio_max:.3f}",
                goal,
                f"{r.curved_time_ratio_median:.3f} / {r.curved_time_ratio_max:.3f}",
                ", ".join(f"{ratio:.4f}" for ratio in ratios),
                f"{r.verdicts_passed_fraction:.3f}",
            )
        )
    return (
        table(columns, lines)
        + "\n\ntoppra's optimum is that without a jerk limit, at the full limits, on the same paths with the same stops. "
        "Straight joint lines are ruckig's in both rows. All other tables are of `optimal`.\n"
    )


def _margins(results: PlansResult) -> str:
    slow = results.site_speed
    columns = ("motion", "catalogue speed", f"site speed ({100 * slow.speed:.0f} %)", "target")
    lines: list[tuple[str, ...]] = []
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
        lines.append(
            (title, form.format(getattr(results, key)), form.format(getattr(slow, key)), goal)
        )
    note = (
        f"Smallest clearance: {results.smallest_clearance_pair}. Clearance per kind of pair, m: "
        + ", ".join(f"{kind} {value:.4f}" for kind, value in results.clearances.items())
        + f". Transits: {results.transit_kinds}."
    )
    return f"{table(columns, lines)}\n\n{note}\n"


def _lines(results: PlansResult) -> str:
    columns = (
        "random straight lines, speed",
        "samples every, ms",
        "lines",
        "off the line",
        "greatest distance, rad",
        "velocity",
        "acceleration",
        "jerk, as sent over the limits",
    )
    lines: list[tuple[str, ...]] = []
    for line in results.random_lines:
        lines.append(
            (
                f"{line.speed:g}",
                f"{1e3 * line.period:.0f}",
                str(line.lines),
                str(line.off),
                f"{line.deviation_max:.1e}",
                *(
                    f"{ratio:.4f}"
                    for ratio in (
                        line.worst_velocity_ratio_sent,
                        line.worst_acceleration_ratio_sent,
                        line.worst_jerk_ratio_sent,
                    )
                ),
            )
        )
    return (
        table(columns, lines)
        + "\n\nAs sent: positions and velocities as float32, times as whole milliseconds. Greatest distance of a sample from a "
        f"line that was checked for collision, in these and in all plans: {results.line_deviation_max:.1e} rad.\n"
    )


def _baselines(results: PlansResult) -> str:
    own, drake, rrt = (
        results.same_tasks,
        results.drake_inverse_kinematics,
        results.ompl_rrt_connect,
    )
    columns = (f"on the same {own.tasks} targets", "own", "Drake IK in the search", "OMPL")
    lines: list[tuple[str, ...]] = []
    if rrt.skipped:
        return f"OMPL's RRT-Connect was skipped: {rrt.skipped}.\n"
    lines += [
        (
            "dual-arm success",
            f"{own.dual_arm_success:.3f}",
            f"{drake.dual_arm_success:.3f} ({drake.out_of_time} out of time)",
            f"{rrt.dual_arm_success:.3f}",
        ),
        (
            "search time median, s",
            _seconds(own.search_time.median),
            _seconds(drake.search_time_median),
            "(poses from the own search)",
        ),
        (
            "search time p95, s",
            _seconds(own.search_time.p95),
            _seconds(drake.search_time_p95),
            "",
        ),
        (
            "whole plan median, s",
            _seconds(own.planning_time_median),
            "",
            _seconds(rrt.planning_time_median),
        ),
        (
            "motion median, s",
            _seconds(own.motion_time_median),
            "",
            _seconds(rrt.motion_time_median),
        ),
        (
            "tip off the Cartesian path, median / max, mm",
            "0",
            "",
            f"{_millimetres(rrt.deviation_median)} / {_millimetres(rrt.deviation_max)}",
        ),
    ]
    return table(columns, lines) + "\n"
