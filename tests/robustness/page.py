"""`unwrinkle bench faults`: every fault of the catalogue injected, and its outcome asserted."""

import logging
import re
import tempfile
from pathlib import Path
from typing import Any

from benchmarks.harness.report import Progress
from tests.robustness.faults import (
    bytes,
    commands,
    feedback,
    firmware,
    grippers,
    host,
    network,
    planning,
    vision,
)
from tests.robustness.rig.fault import Row, RowResult

_MODULES = (
    network,
    bytes,
    feedback,
    host,
    commands,
    planning,
    vision,
    grippers,
    firmware,
)
_GROUPS = "NSCPVGHF"
#: The catalogue: how many rows each letter has.
CATALOGUE = {"N": 9, "S": 5, "C": 4, "P": 7, "V": 6, "G": 2, "H": 2, "F": 8}


def _place(row: Row) -> tuple[int, int]:
    return _GROUPS.index(row.id[0]), int(row.id[1:])


def rows() -> tuple[Row, ...]:
    """All rows, in the catalogue's order."""
    return tuple(sorted((row for module in _MODULES for row in module.ROWS), key=_place))


def row(name: str) -> Row:
    """The row of that id.

    Raises:
        KeyError: there is none.
    """
    return {item.id: item for item in rows()}[name]


def run(*, quick: bool, seed: int, progress: Progress) -> dict[str, Any]:
    """Inject every fault; virtual equipment, loopback addresses.

    Args:
        quick: makes no difference: all rows are quick.
        seed: of every random choice.
        progress: is told the row.

    Returns:
        `rows` (see `RowResult`, and `must`, what the catalogue asks), `rows_survived_fraction`,
        `limit_violations`, `moved_before_command` (greatest angle, rad), `increments` (see
        `run_increments`) and `missing` (ids of the catalogue without a row).
    """
    wanted = rows()
    results: list[tuple[Row, RowResult]] = []
    level = logging.root.manager.disable
    logging.disable(logging.ERROR)  # faults are told by the table
    try:
        with tempfile.TemporaryDirectory() as folder:
            for done, item in enumerate(wanted):
                progress(done, len(wanted), item.id)
                results.append((item, item.run(Path(folder) / item.id, seed)))
    finally:
        logging.disable(level)
    progress(len(wanted), len(wanted), "done")
    known = {item.id for item in wanted}
    missing = [
        name
        for letter, count in CATALOGUE.items()
        for name in (f"{letter}{k}" for k in range(1, count + 1))
        if name not in known
    ]
    survived = sum(result.survived for _, result in results)
    return {
        "rows": [{**result.to_json(), "must": item.must} for item, result in results],
        "rows_survived_fraction": survived / (len(results) + len(missing)),
        "limit_violations": sum(result.limit_violations for _, result in results),
        "moved_before_command": max(result.moved for _, result in results),
        "increments": [found for _, result in results for found in result.increments],
        "missing": missing,
    }


def table(results: dict[str, Any]) -> str:
    """Return the headline and a row per fault."""
    found = results["rows"]
    survived = sum(item["survived"] for item in found)
    total = len(found) + len(results["missing"])
    lines = [
        "Every fault is injected into virtual equipment over real connections of the loopback interface, through public",
        "interfaces, with a fake clock. A row is survived if all that it promises was seen.",
        "",
        "| what | target | measured |",
        "|---|---|---|",
        f"| rows survived | {total} of {total} | {survived} of {total} |",
        f"| samples sent beyond a limit | 0 | {results['limit_violations']} |",
        f"| greatest angle that an axis moved before it was commanded to | 0 rad | {results['moved_before_command']:g} rad |",
    ]
    if results["missing"]:
        lines.append(f"| rows without an injection | 0 | {', '.join(results['missing'])} |")
    lines += [
        "",
        "| row | fault | injected | must happen | result |",
        "|---|---|---|---|---|",
        *(
            f"| {item['id']} | {_cell(item['fault'])} | {_cell(item['injected'])} "
            f"| {_cell(item['must'])} | {'survived' if item['survived'] else '**FAILED**'} |"
            for item in found
        ),
        "",
        *_increments(results["increments"]),
        "## What was asserted, and what the user reads",
    ]
    for item in found:
        lines += ["", f"**{item['id']}, {item['fault']}** ({item['seconds']:.1f} s)", ""]
        lines += [f"- {_text(promise)}" for promise in item["outcome"].split("; ")]
        if item["message"]:
            lines += ["", "Reads:", ""]
            lines += [f"> {_text(text)}\n>" for text in item["message"].split(" / ")]
            lines[-1] = lines[-1].removesuffix("\n>")
    return "\n".join([*lines, ""])


def _increments(found: list[dict[str, Any]]) -> list[str]:
    """What the controller ran of a plan at full speed, a row per profile and clock."""
    if not found:
        return []
    return [
        "## A plan at full speed, as the controller runs it (simulated)",
        "",
        "Greatest shares of the plan's limits in the differences of the increments, whose times the controller cuts to whole",
        "milliseconds; and how much motion stands in the queues while the axes move (but for each segment's end).",
        "",
        "| profile | clock | velocity | acceleration | jerk | path error | in the queues: least, median | ran out |",
        "|---|---|---|---|---|---|---|---|",
        *(
            f"| {item['profile']} | {1e3 * item['period']:g} ms | {item['velocity']:.4f} | {item['acceleration']:.4f} "
            f"| {item['jerk']:.4f} | {1e3 * item['path_error']:.4f} mrad | {1e3 * item['queue_least']:.0f} ms, "
            f"{1e3 * item['queue_median']:.0f} ms | {item['underruns']} |"
            for item in found
        ),
        "",
    ]


def _cell(text: str) -> str:
    return _text(text).replace("|", "\\|")


def _text(text: str) -> str:
    """One line, without places and numbers that differ from run to run."""
    text = re.sub(r"127\.0\.0\.1[:-]\d+", "127.0.0.1:PORT", " ".join(text.split()))
    text = re.sub(r"(?<![\w/])/(?:[\w.-]+/)+", "", text)
    return re.sub(r"process \d+", "process PID", re.sub(r"':\d+'", "':PORT'", text))
