"""The page of the faults, from pytest's report."""

import dataclasses
import json
from pathlib import Path
from xml.sax.saxutils import quoteattr

import pytest

from benchmarks.harness.results import to_json
from tests.robustness import catalogue, page
from tests.robustness.rig.fault import FaultResult
from unwrinkle.models.errors import InputError

GOOD = FaultResult(
    "N1", "a | b", "so", "this", "one; two", True, "cannot connect to 127.0.0.1:4711", seconds=0.1
)
BAD = dataclasses.replace(GOOD, id="N2", survived=False, outcome="NOT: it (found: not)")


def _value(result: FaultResult) -> str:
    return quoteattr(json.dumps(to_json(result)))


def _report(path: Path, *results: FaultResult) -> Path:
    found = "".join(
        f"<testcase><properties><property name='fault' value={_value(each)}/>"
        "</properties></testcase>"
        for each in results
    )
    path.write_text(f"<testsuites><testsuite>{found}</testsuite></testsuites>")
    return path


def test_results_come_back_from_the_report_of_the_tests(tmp_path: Path) -> None:
    assert page.read_results(_report(tmp_path / "r.xml", BAD, GOOD)) == [BAD, GOOD]


def test_a_report_without_results_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError):
        page.read_results(_report(tmp_path / "r.xml"))
    with pytest.raises(InputError):
        page.read_results(tmp_path / "none.xml")


def test_what_was_not_injected_does_not_count_as_survived() -> None:
    results = page.summed([BAD, GOOD])
    assert [each.id for each in results.faults] == ["N1", "N2"]
    assert results.missing == tuple(catalogue.ids()[2:])
    assert results.survived_fraction == pytest.approx(1.0 / len(catalogue.ids()))


def test_the_page_tells_what_failed() -> None:
    total = len(catalogue.ids())
    text = page.table(page.summed([GOOD, BAD]))
    assert f"| faults survived | {total} of {total} | 1 of {total} |" in text
    assert "| N2 | a \\| b | so | this | **FAILED** |" in text
    assert "127.0.0.1:PORT" in text and "4711" not in text
