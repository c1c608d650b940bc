"""`unwrinkle bench soak`: cycles of random motion with one fault each, on the virtual controller
over real connections.
"""

import json
import logging
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.harness.report import Progress
from benchmarks.loop.runs import source_digest
from tests.robustness.soak_cycle import KINDS, play

_FOLDER = Path("out") / "soak"
_CYCLES, _QUICK = 1000, 40


def run(*, quick: bool, seed: int, progress: Progress) -> dict[str, Any]:
    """Play the cycles; those that the very same code has played already are read from their file.

    Args:
        quick: 40 cycles instead of 1,000.
        seed: of every random choice.
        progress: is told the kind of fault.

    Returns:
        See `soak`.
    """
    return soak(_FOLDER, _QUICK if quick else _CYCLES, seed, progress)


def soak(folder: Path, count: int, seed: int, progress: Progress) -> dict[str, Any]:
    """Play so many cycles.

    Args:
        folder: of the results, which are written as they come, and of the logs of cycles that
            failed.
        count: of the cycles.
        seed: of every random choice.
        progress: is told the kind of fault.

    Returns:
        `cycles`, `failed` (those that did not keep a promise), `limit_violations`,
        `moved_before_command` (greatest angle, rad), `left` (cycles after which increments were
        left in the queues), `points` sent, `changes` (of override, holds), `kinds` (per kind of
        fault: cycles, ended as promised, recovered) and `seconds` (of a cycle: median, worst).
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"seed-{seed}-{source_digest()[:12]}.jsonl"
    done = {item["cycle"]: item for item in _read(path)}
    level = logging.root.manager.disable
    logging.disable(logging.ERROR)  # faults are told by the results
    try:
        with path.open("a", encoding="utf-8") as results:
            for cycle in range(count):
                if cycle in done:
                    continue
                done[cycle] = play(folder, seed, cycle).to_json()
                results.write(json.dumps(done[cycle]) + "\n")
                results.flush()
                progress(cycle + 1, count, done[cycle]["kind"])
    finally:
        logging.disable(level)
    played = [done[cycle] for cycle in range(count)]
    seconds = [item["seconds"] for item in played]
    failed = [item for item in played if item["problems"] or item["violations"]]
    return {
        "cycles": count,
        "failed": failed,
        "limit_violations": sum(item["violations"] for item in played),
        "moved_before_command": max(item["moved"] for item in played),
        "left": sum(item["left"] > 0 for item in played),
        "points": sum(item["points"] for item in played),
        "changes": sum(item["changes"] for item in played),
        "kinds": _kinds(played),
        "seconds": {"median": float(np.median(seconds)), "worst": float(np.max(seconds))},
    }


def _read(path: Path) -> Iterator[dict[str, Any]]:
    """Cycles that were played before; a line that was cut is played again."""
    if not path.exists():
        return
    for line in path.read_text(encoding="utf-8").splitlines():
        try:
            yield json.loads(line)
        except json.JSONDecodeError:
            continue


def _kinds(played: list[dict[str, Any]]) -> dict[str, dict[str, Any]]:
    total = Counter(item["kind"] for item in played)
    kept = Counter(item["kind"] for item in played if not item["problems"])
    recovered = Counter(item["kind"] for item in played if item["recovered"])
    return {
        kind.name: {
            "expected": kind.ends,
            "cycles": total[kind.name],
            "kept": kept[kind.name],
            "recovered": recovered[kind.name] if kind.recovers else None,
        }
        for kind in KINDS
        if total[kind.name]
    }


def table(results: dict[str, Any]) -> str:
    """Return the headline, a row per kind of fault, and what failed."""
    count, failed = results["cycles"], results["failed"]
    lines = [
        "Each cycle: connect, run a random motion of all thirteen axes with random overrides, holds and resumes, one fault",
        "at a random step; then the fault must be latched, or survived, as promised, and the log whole. The (simulated)",
        "controller has the firmware of 1.9.12 or 2013, a clock of 4 or 8 ms and a delay of 50 to 200 ms, at random.",
        "",
        "| what | target | measured |",
        "|---|---|---|",
        f"| cycles that kept every promise | {count} of {count} | {count - len(failed)} of {count} |",
        f"| samples sent beyond a limit | 0 | {results['limit_violations']} |",
        f"| greatest angle that an axis moved before it was commanded to | 0 rad | {results['moved_before_command']:g} rad |",
        f"| cycles that left increments in the controller's queues, then connected again | | {results['left']} |",
        f"| points sent to each group | | {results['points']} |",
        f"| changes of override, holds | | {results['changes']} |",
        (
            f"| seconds of a cycle, median (worst) | | {results['seconds']['median']:.2f} "
            f"({results['seconds']['worst']:.2f}) |"
        ),
        "",
        "| fault | must end in | cycles | kept every promise | ran again after a reset |",
        "|---|---|---|---|---|",
        *(
            f"| {name} | {item['expected']} | {item['cycles']} | {item['kept']} "
            f"| {'' if item['recovered'] is None else item['recovered']} |"
            for name, item in results["kinds"].items()
        ),
    ]
    if failed:
        lines += ["", "## Failed", ""]
        lines += [
            f"- cycle {item['cycle']} ({item['kind']}): {'; '.join(item['problems'])}"
            for item in failed[:40]
        ]
    return "\n".join([*lines, ""])
