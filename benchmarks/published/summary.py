"""Write the summary of the benchmarks beside the published figures into a page.

`python -m benchmarks.published.summary docs/results`.
"""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.harness.registry import find, results_type
from benchmarks.harness.report import load_report
from benchmarks.harness.tables import table
from benchmarks.planning.trajectories.results import TrajectoriesResult
from benchmarks.published.garments.results import GarmentsResult
from benchmarks.published.grasps.results import GraspsResult
from benchmarks.published.sensitivity.results import SensitivityResult
from benchmarks.published.table1 import Table1Result
from benchmarks.published.table2_page import cell_name
from benchmarks.published.table2_results import Table2Result
from unwrinkle.models.errors import InputError
from unwrinkle.models.io.files import write_text

BEGIN, END = "<!-- summary: begin -->", "<!-- summary: end -->"
#: Of a line: what was measured, published, here, and the target with whether it is met; empty where
#: there is none.
Line = tuple[str, str, str, str]


def _met(target: str, met: bool) -> str:
    return f"{target}: {'met' if met else '**missed**'}"


def _table1(results: Table1Result) -> list[Line]:
    lines = []
    for reading in results.readings:
        c, p = results.readings[reading], results.published
        least, most = c.rni_mean == 1.0, c.rni_max
        dual = c.dual_success >= 0.975 and c.dual_least >= 0.8
        lines += [
            (
                f"single wrinkles about {reading}: actions",
                f"{p.rni_mean:.0f}",
                f"{c.rni_mean:.2f} (most {most})",
                _met("1 everywhere", least),
            ),
            (
                f"single wrinkles about {reading}: dual-arm plans (least direction)",
                f"{100 * p.dual_success:.0f} % ({100 * p.dual_least:.0f} %)",
                f"{100 * c.dual_success:.1f} % ({100 * c.dual_least:.0f} %)",
                _met("97.5 %, none under 80 %", dual),
            ),
            (
                f"single wrinkles about {reading}: grasps",
                f"{100 * p.grasp_success:.0f} %",
                f"{100 * c.grasp_success:.1f} %",
                _met("100 %", c.grasp_success == 1.0),
            ),
        ]
    return lines


def _table2(results: Table2Result) -> list[Line]:
    lines = []
    for cell, p in results.published.items():
        c = results.cells[cell]
        most = 3.5 if cell == "dual_stereo" else p.rni_mean
        lines.append(
            (
                f"crumpled towel, {cell_name(cell)}: actions until the detector says flat (flat by truth)",
                f"{p.rni_mean:.1f} ({p.rni_std:.2f})",
                f"{c.rni_mean:.1f} ({c.rni_std:.2f}); {c.flat_by_truth} of {c.runs}",
                _met(
                    f"{'at most' if cell == 'dual_stereo' else 'below'} {most:.1f}",
                    c.rni_mean <= most,
                ),
            )
        )
        if p.dual_success is not None and c.dual_success is not None:
            target = _met("95 %", c.dual_success >= 0.95) if cell == "dual_stereo" else ""
            lines.append(
                (
                    f"crumpled towel, {cell_name(cell)}: dual-arm plans",
                    f"{100 * p.dual_success:.1f} %",
                    f"{100 * c.dual_success:.1f} % of {c.dual_wanted}",
                    target,
                )
            )
    kept = bool(results.order_kept.rni_mean)
    lines.append(
        (
            "crumpled towel: the order of the four cells",
            "rising in this order",
            "the same" if kept else "by arms alone; the page says why",
            _met("kept", kept),
        )
    )
    for cell, c in results.cells.items():
        if cell.endswith("_together"):
            lines.append(
                (
                    f"the same, {cell_name(cell)}: all slack along the section that crosses most",
                    "",
                    f"{c.rni_mean:.1f} ({c.rni_std:.2f}); {c.flat_by_truth} of {c.runs}",
                    "",
                )
            )
    return lines


def _garments(results: GarmentsResult) -> list[Line]:
    lines = []
    for start in results.starts:
        for method in results.methods:
            one = results.overall[start][method]
            covered = one.coverage[results.counts[-1]].mean
            before = one.coverage[0].mean
            lines.append(
                (
                    f"four garments, {start}, {method}: coverage at first, after {results.counts[-1]} actions (95 % reached)",
                    "",
                    f"{100 * before:.1f} to {100 * covered:.1f} %; {one.success} of {one.runs}",
                    "",
                )
            )
    return lines


def _trajectories(results: TrajectoriesResult) -> list[Line]:
    head, methods = results.headline, results.methods
    timed = results.set.timed
    clean = f"{head.ours_clean_paths} of {timed} paths clean"
    met = (
        head.ours_clean_paths == timed
        and head.ours_ratio_max is not None
        and head.ours_ratio_max <= head.target_ratio
    )
    moveit = methods["moveit_sent"]
    return [
        (
            "trajectories, ours: time over toppra's without a jerk limit, median (most)",
            "",
            f"{head.ours_ratio_median:.2f} ({head.ours_ratio_max:.2f}); {clean}",
            _met("no violation, no deviation, at most 1.40", met),
        ),
        (
            "trajectories, ours: time over an independent nonlinear programme's",
            "",
            f"{head.ours_over_programme.median:.3f} ({head.ours_over_programme.max:.3f})",
            "",
        ),
        (
            "trajectories, waypoint-wise ruckig as MoveIt 2 sends it",
            "",
            f"{moveit.ratio.median:.2f} ({moveit.ratio.max:.2f}); {moveit.clean} of {timed} paths clean",
            "",
        ),
    ]


def _grasps(results: GraspsResult) -> list[Line]:
    p = results.published
    return [
        (
            "grasps at the wrinkledness point, five states",
            f"{p.successes} of {p.attempts}",
            f"{results.successes} of {results.attempts}",
            "",
        )
    ]


def _sensitivity(results: SensitivityResult) -> list[Line]:
    wanted = {"all its slack, order together": "together, all slack along the section"}
    return [
        (
            f"sensitivity, {wanted[c.value]}: actions more than the default's, same starts (95 %)",
            "",
            f"{c.to_default.mean:+.1f} ({c.to_default.low:+.1f} to {c.to_default.high:+.1f})",
            "",
        )
        for c in results.conditions
        if c.value in wanted and c.to_default is not None
    ]


BENCHMARKS: dict[str, Callable[[Any], list[Line]]] = {
    "table1": _table1,
    "table2": _table2,
    "sensitivity": _sensitivity,
    "garments": _garments,
    "trajectories": _trajectories,
    "grasps": _grasps,
}


#: Benchmarks whose figures are of computed trajectories, without a simulated robot or cloth.
COMPUTED = ("trajectories",)


def _marked(figure: str, how: str) -> str:
    """Say in the cell of a figure how it was measured."""
    return f"{figure} ({how})" if figure and how else figure


def summary(folder: Path) -> str:
    """Return the benchmarks' headlines as a Markdown table.

    Args:
        folder: holds each benchmark's report, `NAME.json`.

    Raises:
        InputError: a report is missing, cannot be read, or is of a quick run, which is no result.
    """
    lines: list[tuple[str, ...]] = []
    for name, headlines in BENCHMARKS.items():
        path = folder / f"{name}.json"
        if not path.is_file():
            raise InputError(
                f"{path}: no such file; run `python -m benchmarks {name} --json {path}`"
            )
        report = load_report(path, results_type(find(name)))
        if report.quick:
            raise InputError(
                f"{path}: is of a quick run, which is no result; run it without --quick"
            )
        here = "" if name in COMPUTED else "simulated"
        lines += [
            (f"[{name}]({name}.md)", what, _marked(there, "real robot"), _marked(own, here), target)
            for what, there, own, target in headlines(report.results)
        ]
    return table(("benchmark", "what", "published", "here", "target"), lines)


def with_summary(page: str, lines: str) -> str:
    """Return a page with the table between its marks.

    Raises:
        InputError: the page lacks a mark.
    """
    before, begin, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end):
        raise InputError(f"the page lacks {BEGIN} or {END}")
    return f"{before}{BEGIN}\n{lines}\n{END}{after}"


def main(folder: Path) -> None:
    """Write the table into a folder's README.md."""
    page = folder / "README.md"
    write_text(page, with_summary(page.read_text(encoding="utf-8"), summary(folder)))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
