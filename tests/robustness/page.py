"""The fault catalogue's page: `unwrinkle bench faults` runs the tests of the faults, and tells.

`python -m tests.robustness.page REPORT.xml` writes the page of a test run that was made with
`pytest tests/robustness/test_catalogue.py --junitxml REPORT.xml`, to the standard output.
"""

import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

from benchmarks.harness.report import Progress
from benchmarks.harness.results import from_json
from benchmarks.harness.tables import cell
from benchmarks.harness.tables import table as table_of
from tests.robustness import catalogue
from tests.robustness.rig.fault import FaultResult
from tests.robustness.rig.increments import Increments
from unwrinkle.models.errors import InputError

_TESTS = Path(__file__).parent / "test_catalogue.py"
#: The property of a test that holds its fault's result.
PROPERTY = "fault"
_ENDED = (0, 1)  # pytest's exit codes of a run that came to its end


@dataclass(frozen=True)
class FaultsResult:
    """The catalogue, injected once.

    Attributes:
        faults: in the catalogue's order.
        survived_fraction: of the whole catalogue.
        limit_violations: samples sent beyond a limit.
        moved_before_command: greatest angle, rad.
        missing: ids of the catalogue that were not injected.
    """

    faults: tuple[FaultResult, ...]
    survived_fraction: float
    limit_violations: int
    moved_before_command: float
    missing: tuple[str, ...]


def run(*, quick: bool, seed: int, progress: Progress) -> FaultsResult:
    """Inject the faults into virtual equipment, by their tests.

    Args:
        quick: leave out what takes a quarter of a minute or more.
        seed: of every random choice.
        progress: is told the fault.

    Raises:
        InputError: the tests did not run.
    """
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.xml"
        command = [sys.executable, "-m", "pytest", str(_TESTS), "-v", "--no-header"]
        command += ["-o", "junit_family=xunit1", "--junitxml", str(report), "--timeout", "1800"]
        command += ["--fault-seed", str(seed), "-k", "test_fault_is_survived"]
        command += ["-m", "not long"] if quick else []
        root = _TESTS.parents[2]
        total = len(catalogue.faults())
        with subprocess.Popen(
            command, cwd=root, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        ) as tests:
            assert tests.stdout is not None
            output = []
            for line in tests.stdout:
                output.append(line)
                if found := re.search(r"test_fault_is_survived\[(\w+)\]", line):
                    progress(catalogue.ids().index(found[1]), total, found[1])
        if tests.returncode not in _ENDED:
            raise InputError(f"the tests did not run: {''.join(output[-5:])}")
        progress(total, total, "done")
        return summed(read_results(report))


def read_results(report: Path) -> list[FaultResult]:
    """Read the faults' results from pytest's JUnit report.

    Raises:
        InputError: the file cannot be read, or has no results.
    """
    try:
        tree = ElementTree.parse(report)
    except (OSError, ElementTree.ParseError) as error:
        raise InputError(f"{report}: {error}; name the file of `pytest --junitxml`") from None
    found = [
        from_json(FaultResult, json.loads(each.get("value", "")), str(report))
        for each in tree.iter("property")
        if each.get("name") == PROPERTY
    ]
    if not found:
        raise InputError(f"{report}: has no results of faults")
    return found


def summed(found: Iterable[FaultResult]) -> FaultsResult:
    """Sum up the results of the faults that were injected."""
    by_id = {each.id: each for each in found}
    results = tuple(by_id[name] for name in catalogue.ids() if name in by_id)
    return FaultsResult(
        faults=results,
        survived_fraction=sum(each.survived for each in results) / len(catalogue.ids()),
        limit_violations=sum(each.limit_violations for each in results),
        moved_before_command=max((each.moved for each in results), default=0.0),
        missing=tuple(name for name in catalogue.ids() if name not in by_id),
    )


def table(results: FaultsResult) -> str:
    """Return the headline, a line per fault, and what was asserted."""
    survived = sum(each.survived for each in results.faults)
    total = len(results.faults) + len(results.missing)
    headline = [
        ("faults survived", f"{total} of {total}", f"{survived} of {total}"),
        ("samples sent beyond a limit", "0", f"{results.limit_violations}"),
        (
            "greatest angle that an axis moved before it was commanded to",
            "0 rad",
            f"{results.moved_before_command:g} rad",
        ),
    ]
    if results.missing:
        headline.append(("faults that were not injected", "0", ", ".join(results.missing)))
    lines = [
        "Every fault is injected into virtual equipment over real connections of the loopback interface, through public",
        "interfaces, with a fake clock. A fault is survived if all that is promised for it was seen.",
        "",
        table_of(("what", "target", "measured"), headline),
        "",
        table_of(
            ("id", "fault", "injected", "must happen", "result"),
            (
                (
                    each.id,
                    cell(_text(each.fault)),
                    cell(_text(each.injected)),
                    cell(_text(each.must)),
                    "survived" if each.survived else "**FAILED**",
                )
                for each in results.faults
            ),
        ),
        "",
        *_increments([each for fault in results.faults for each in fault.increments]),
        "## What was asserted, and what the user reads",
    ]
    for each in results.faults:
        lines += ["", f"**{each.id}, {each.fault}** ({each.seconds:.1f} s)", ""]
        lines += [f"- {_text(promise)}" for promise in each.outcome.split("; ")]
        if each.message:
            lines += ["", "Reads:", ""]
            lines += [f"> {_text(text)}\n>" for text in each.message.split(" / ")]
            lines[-1] = lines[-1].removesuffix("\n>")
    return "\n".join([*lines, ""])


def _increments(found: list[Increments]) -> list[str]:
    """What the controller ran of a plan at full speed, a line per profile and clock."""
    if not found:
        return []
    columns = (
        "profile|clock|velocity|acceleration|jerk|path error|in the queues: least, median|ran out"
    )
    return [
        "## A plan at full speed, as the controller runs it (simulated)",
        "",
        "Greatest shares of the plan's limits in the differences of the increments, whose times the controller cuts to whole",
        "milliseconds; and how much motion stands in the queues while the axes move (but for each segment's end).",
        "",
        table_of(
            columns.split("|"),
            (
                (
                    each.profile,
                    f"{1e3 * each.period:g} ms",
                    f"{each.velocity:.4f}",
                    f"{each.acceleration:.4f}",
                    f"{each.jerk:.4f}",
                    f"{1e3 * each.path_error:.4f} mrad",
                    f"{1e3 * each.queue_least:.0f} ms, {1e3 * each.queue_median:.0f} ms",
                    f"{each.underruns}",
                )
                for each in found
            ),
        ),
        "",
    ]


def _text(text: str) -> str:
    """One line, without places and numbers that differ from run to run."""
    text = re.sub(r"127\.0\.0\.1[:-]\d+", "127.0.0.1:PORT", " ".join(text.split()))
    text = re.sub(r"(?<![\w/])/(?:[\w.-]+/)+", "", text)
    return re.sub(r"process \d+", "process PID", re.sub(r"':\d+'", "':PORT'", text))


if __name__ == "__main__":
    sys.stdout.write(table(summed(read_results(Path(sys.argv[1])))))
