"""The page of Table II."""

from benchmarks.harness.tables import line, rule
from benchmarks.published.table2_results import Table2Result


def page(results: Table2Result, cells: list[str], options: list[str]) -> str:
    """Table, targets, what missed them, and every run.

    Args:
        results: as `table2.run` returns them.
        cells: names of the published table's cells, in order.
        options: names of the cells beside it.
    """
    published = results.published
    count = len(results.starts)
    lines = [
        (
            "**Cloth and robot are simulated here; the published figures are of a real towel and the real robot** (Sun, "
            "Aragon-Camarasa, Rogers, Siebert, ICRA 2015, Table II). The same start states and seeds in all cells. RNI, "
            "the required number of iterations, counts actions, missed grasps included. A cell with two arms falls back to one "
            "where there is no verified motion for two."
        ),
        "",
        line(
            "cell",
            "RNI, detector: mean (std)",
            "95 % of mean",
            "published",
            "RNI, truth: mean (std)",
            "flat by detector",
            "flat by truth",
        ),
        rule(7),
    ]
    for cell in [*cells, *options]:
        c, p = results.cells[cell], published.get(cell)
        low, high = c.rni_interval
        truth, was = "-", "-"
        if p is not None:
            was = f"{p.rni_mean:.1f} ({p.rni_std:.2f})"
        if c.rni_truth_mean is not None:
            truth = f"{c.rni_truth_mean:.1f} ({c.rni_truth_std:.2f})"
        lines.append(
            line(
                f"{cell_name(cell)}",
                f"{c.rni_mean:.1f} ({c.rni_std:.2f})",
                f"{low:.1f} to {high:.1f}",
                f"{was}",
                f"{truth}",
                f"{count - c.unfinished} of {count}",
                f"{c.flat_by_truth} of {count}",
            )
        )
    lines += [
        "",
        (
            "Flat by truth: the cloth's highest point is at most 5 mm above where it lies flat. RNI by truth is the mean over "
            "the runs that came to that, at any time; a run that did not end flat counts in the detector's column with all "
            f"actions that it made (at most {results.most_actions})."
        ),
        "",
        (
            line(
                "cell",
                "dual-arm plans",
                "published",
                "missed grasps",
                "coverage, mean (least)",
                "true height at the end, median (most)",
                "overstretch, most",
                "s per action",
            )
        ),
        rule(8),
    ]
    for cell in [*cells, *options]:
        c, p = results.cells[cell], published.get(cell)
        plans = "-"
        if c.dual_success is not None and c.dual_interval is not None:
            low, high = c.dual_interval
            plans = (
                f"{100 * c.dual_success:.1f} % of {c.dual_wanted} "
                f"({100 * low:.0f} to {100 * high:.0f} %)"
            )
        was = "-" if p is None or p.dual_success is None else f"{100 * p.dual_success:.1f} %"
        lines.append(
            line(
                f"{cell_name(cell)}",
                f"{plans}",
                f"{was}",
                f"{c.missed}",
                f"{100 * c.coverage_mean:.1f} ({100 * c.coverage_least:.1f}) %",
                f"{1e3 * c.height_median:.1f} ({1e3 * c.height_max:.1f}) mm",
                f"{100 * c.overstretch_max:.1f} %",
                f"{c.action_seconds_median:.1f}",
            )
        )
    lines += [
        "",
        _stages(results, cells),
        "",
        "## Against the targets",
        "",
        *_targets(results, cells),
    ]
    lines += _versions(results, [*cells, *options])
    lines += ["", "## Every run", "", *_runs(results, [*cells, *options])]
    return "\n".join([*lines, ""])


def cell_name(cell: str) -> str:
    """A cell's name in words."""
    arms, sensor, *rule = cell.split("_")
    return ", ".join([f"{arms}-arm", sensor, *(f"order {name}" for name in rule)])


def _stages(results: Table2Result, cells: list[str]) -> str:
    parts = []
    for cell in cells:
        stages = results.cells[cell].stage_seconds_median
        of = ", ".join(f"{name} {stages[name]:.1f}" for name in stages)
        parts.append(f"{cell_name(cell)}: {of}")
    return (
        "Median seconds of an action by stage, with as many runs at once as there are cores (`look` is mostly the drawing of "
        f"the pictures). {'; '.join(parts)}."
    )


def _targets(results: Table2Result, cells: list[str]) -> list[str]:
    first = results.cells[cells[0]]
    rows = [
        (
            "dual-arm, stereo: mean RNI at most 3.5",
            f"{first.rni_mean:.1f}",
            first.rni_mean <= 3.5,
        ),
        (
            "dual-arm, stereo: at least 95 % dual-arm plans",
            "-" if first.dual_success is None else f"{100 * first.dual_success:.1f} %",
            (first.dual_success or 0.0) >= 0.95,
        ),
    ]
    for cell in cells:
        mine, theirs = results.cells[cell].rni_mean, results.published[cell].rni_mean
        rows.append(
            (f"{cell_name(cell)}: below the published {theirs:.1f}", f"{mine:.1f}", mine < theirs)
        )
    for kept, word in (
        (results.order_kept.rni_mean, "detector"),
        (results.order_kept.rni_truth_mean, "truth"),
    ):
        said = "not told" if kept is None else "kept" if kept else "not kept"
        rows.append((f"order of the cells, by the {word}", said, bool(kept)))
    lines = [
        line("target", "here", "met"),
        rule(3),
        *(line(f"{what}", f"{value}", f"{('yes' if met else 'no')}") for what, value, met in rows),
    ]
    if not results.order_kept.rni_mean:
        lines += ["", _why_not_ordered(results, cells)]
    return lines


def _versions(results: Table2Result, cells: list[str]) -> list[str]:
    """Which cells are of which code, where rows that were kept from before are of another one than
    the rest.
    """
    code: dict[str, set[str]] = {}
    for cell in cells:
        for run in results.runs[cell]:
            code.setdefault(run.code[:12], set()).add(cell_name(cell))
    if len(code) == 1:
        return []
    of = ". ".join(f"{digest}: {'; '.join(sorted(names))}" for digest, names in code.items())
    return ["", f"**These runs are of {len(code)} versions of the code**, by its digest. {of}."]


def _why_not_ordered(results: Table2Result, cells: list[str]) -> str:
    """What the order of the cells depends on here."""
    count = len(results.starts)
    flat = {
        sensor: sum(results.cells[cell].flat_by_truth for cell in cells if cell.endswith(sensor))
        for sensor in ("stereo", "xtion")
    }
    left = max(results.cells[cell].height_max for cell in cells if cell.endswith("xtion"))
    return (
        "The published order is by sensor as much as by arms; here the arms decide. A loop that looks with the Xtion stops "
        f"sooner than the same loop with the stereo head, not because the towel is flat: {flat['xtion']} of {2 * count} of its "
        f"towels are flat by truth at the end, {flat['stereo']} of {2 * count} with the stereo head, and up to "
        f"{1e3 * left:.1f} mm are left that its detector calls flat. The published runs needed more actions with the Xtion than with "
        "the stereo head."
    )


def _runs(results: Table2Result, cells: list[str]) -> list[str]:
    lines = [
        line(
            "run",
            "ended",
            "actions (two arms, one arm, missed)",
            "flat by truth after",
            "true height, mm",
            "coverage, %",
        ),
        rule(6),
    ]
    for cell in cells:
        for run in results.runs[cell]:
            after = "-" if run.rni_truth is None else str(run.rni_truth)
            heights, covered = run.heights, run.coverages
            lines.append(
                line(
                    f"{run.name}",
                    f"{run.status}",
                    f"{run.actions} ({run.dual}, {run.single}, {run.missed})",
                    f"{after}",
                    f"{1e3 * heights[0]:.1f} to {1e3 * heights[-1]:.1f}",
                    f"{100 * covered[0]:.1f} to {100 * covered[-1]:.1f}",
                )
            )
    return lines
