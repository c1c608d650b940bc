"""`unwrinkle bench soak`: cycles of random motion with one fault each, on the virtual controller
over real connections.
"""

import json
import logging
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.harness.digest import source_digest
from benchmarks.harness.report import Progress
from benchmarks.harness.results import from_json, to_json
from benchmarks.harness.statistics import MedianWorst
from benchmarks.harness.tables import table as table_of
from tests.robustness.soak_cycle import KINDS, Cycle, play

_FOLDER = Path("out") / "soak"
_CYCLES, _QUICK = 1000, 40


@dataclass(frozen=True)
class KindCount:
    """The cycles with one kind of fault.

    Attributes:
        expected: what they must come to.
        cycles: played.
        kept: that kept every promise.
        recovered: that ran again after a reset; None where that is not asked.
    """

    expected: str
    cycles: int
    kept: int
    recovered: int | None


@dataclass(frozen=True)
class SoakResult:
    """Many cycles.

    Attributes:
        cycles: played.
        failed: those that did not keep a promise.
        limit_violations: samples sent beyond a limit.
        moved_before_command: greatest angle, rad.
        left: cycles after which increments were left in the queues.
        points: sent to each group.
        changes: of override, and holds.
        kinds: by kind of fault.
        seconds: of a cycle, wall clock.
    """

    cycles: int
    failed: tuple[Cycle, ...]
    limit_violations: int
    moved_before_command: float
    left: int
    points: int
    changes: int
    kinds: dict[str, KindCount]
    seconds: MedianWorst


def run(*, quick: bool, seed: int, progress: Progress) -> SoakResult:
    """Play the cycles; those that the very same code has played already are read from their file.

    Args:
        quick: 40 cycles instead of 1,000.
        seed: of every random choice.
        progress: is told the kind of fault.
    """
    return soak(_FOLDER, _QUICK if quick else _CYCLES, seed, progress)


def soak(folder: Path, count: int, seed: int, progress: Progress) -> SoakResult:
    """Play so many cycles.

    Args:
        folder: of the results, which are written as they come, and of the logs of cycles that
            failed.
        count: of the cycles.
        seed: of every random choice.
        progress: is told the kind of fault.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"seed-{seed}-{source_digest()[:12]}.jsonl"
    done = {each.cycle: each for each in _read(path)}
    level = logging.root.manager.disable
    logging.disable(logging.ERROR)  # faults are told by the results
    try:
        with path.open("a", encoding="utf-8") as results:
            for cycle in range(count):
                if cycle in done:
                    continue
                done[cycle] = play(folder, seed, cycle)
                results.write(json.dumps(to_json(done[cycle])) + "\n")
                results.flush()
                progress(cycle + 1, count, done[cycle].kind)
    finally:
        logging.disable(level)
    played = [done[cycle] for cycle in range(count)]
    return SoakResult(
        cycles=count,
        failed=tuple(each for each in played if each.problems or each.violations),
        limit_violations=sum(each.violations for each in played),
        moved_before_command=max(each.moved for each in played),
        left=sum(each.left > 0 for each in played),
        points=sum(each.points for each in played),
        changes=sum(each.changes for each in played),
        kinds=_kinds(played),
        seconds=MedianWorst.of([each.seconds for each in played]),
    )


def _read(path: Path) -> Iterator[Cycle]:
    """Yield the cycles that were played before; a line that was cut is played again."""
    if not path.exists():
        return
    for line in path.read_text(encoding="utf-8").splitlines():
        try:
            yield from_json(Cycle, json.loads(line), str(path))
        except json.JSONDecodeError:
            continue


def _kinds(played: Sequence[Cycle]) -> dict[str, KindCount]:
    total = Counter(each.kind for each in played)
    kept = Counter(each.kind for each in played if not each.problems)
    recovered = Counter(each.kind for each in played if each.recovered)
    return {
        kind.name: KindCount(
            kind.ends,
            total[kind.name],
            kept[kind.name],
            recovered[kind.name] if kind.recovers else None,
        )
        for kind in KINDS
        if total[kind.name]
    }


def table(results: SoakResult) -> str:
    """Return the headline, a line per kind of fault, and what failed."""
    count, failed = results.cycles, results.failed
    lines = [
        "Each cycle: connect, run a random motion of all thirteen axes with random overrides, holds and resumes, one fault",
        "at a random step; then the fault must be latched, or survived, as promised, and the log whole. The (simulated)",
        "controller has the firmware of 1.9.12 or 2013, a clock of 4 or 8 ms and a delay of 50 to 200 ms, at random.",
        "",
        table_of(
            ("what", "target", "measured"),
            (
                (
                    "cycles that kept every promise",
                    f"{count} of {count}",
                    f"{count - len(failed)} of {count}",
                ),
                ("samples sent beyond a limit", "0", f"{results.limit_violations}"),
                (
                    "greatest angle that an axis moved before it was commanded to",
                    "0 rad",
                    f"{results.moved_before_command:g} rad",
                ),
                (
                    "cycles that left increments in the controller's queues, then connected again",
                    "",
                    f"{results.left}",
                ),
                ("points sent to each group", "", f"{results.points}"),
                ("changes of override, holds", "", f"{results.changes}"),
                (
                    "seconds of a cycle, median (worst)",
                    "",
                    f"{results.seconds.median:.2f} ({results.seconds.worst:.2f})",
                ),
            ),
        ),
        "",
        table_of(
            ("fault", "must end in", "cycles", "kept every promise", "ran again after a reset"),
            (
                (
                    name,
                    each.expected,
                    f"{each.cycles}",
                    f"{each.kept}",
                    "" if each.recovered is None else f"{each.recovered}",
                )
                for name, each in results.kinds.items()
            ),
        ),
    ]
    if failed:
        lines += ["", "## Failed", ""]
        lines += [
            f"- cycle {each.cycle} ({each.kind}): {'; '.join(each.problems)}"
            for each in failed[:40]
        ]
    return "\n".join([*lines, ""])
