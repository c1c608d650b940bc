"""Every fault of the catalogue, and that a fault can fail."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from benchmarks.harness.results import to_json
from tests.robustness import catalogue
from tests.robustness.faults import firmware
from tests.robustness.page import PROPERTY
from tests.robustness.rig.fault import Case, Fault

pytestmark = pytest.mark.alone

#: Those that start processes, or run the whole loop.
SLOW = frozenset({"P1", "V1", "V2", "V5", "G2"})


def _marks(name: str) -> list[pytest.MarkDecorator]:
    if name in catalogue.LONG:  # their pieces stand in tests/unwrinkle/execution
        return [pytest.mark.slow, pytest.mark.long, pytest.mark.timeout(1800)]
    return [pytest.mark.slow] if name in SLOW else []


@pytest.mark.parametrize(
    "name", [pytest.param(each.id, marks=_marks(each.id)) for each in catalogue.faults()]
)
def test_fault_is_survived(
    name: str,
    tmp_path: Path,
    fault_seed: int,
    record_property: Callable[[str, object], None],
) -> None:
    result = catalogue.fault(name).run(tmp_path, fault_seed)
    record_property(PROPERTY, json.dumps(to_json(result)))
    assert result.survived, f"{result.outcome}\nread: {result.message}"
    assert result.limit_violations == 0


@pytest.mark.slow
def test_killed_drivers_leave_nothing_that_is_run(tmp_path: Path) -> None:
    case = Case(tmp_path)
    firmware.kills(case, 2)
    assert not case.broken and case.moved_before_command == 0.0
    assert "a stop as the first bytes empties the queues" in case.kept


def test_every_fault_of_the_catalogue_is_there_once() -> None:
    assert [each.id for each in catalogue.faults()] == catalogue.ids()


def _fault(play: Callable[[Case], None]) -> Fault:
    return Fault("N1", "a fault", "so", "this", play)


def test_a_fault_fails_with_what_differed(tmp_path: Path) -> None:
    def play(case: Case) -> None:
        case.expect(True, "it rains")
        case.expect(False, "the sun shines", "clouds")

    result = _fault(play).run(tmp_path)
    assert not result.survived
    assert result.outcome == "NOT: the sun shines (found: clouds)"


def test_a_case_that_looks_at_nothing_fails(tmp_path: Path) -> None:
    result = _fault(lambda case: None).run(tmp_path)
    assert not result.survived and "looked at something" in result.outcome


def test_an_exception_and_a_limit_violation_fail_a_fault(tmp_path: Path) -> None:
    def raising(case: Case) -> None:
        case.expect(True, "it rains")
        raise RuntimeError("out of paper")

    def beyond(case: Case) -> None:
        case.violations(["velocity of axis 3"])

    result = _fault(raising).run(tmp_path)
    assert not result.survived and "RuntimeError: out of paper" in result.outcome
    result = _fault(beyond).run(tmp_path)
    assert not result.survived and result.limit_violations == 1


def test_messages_are_read_word_by_word(tmp_path: Path) -> None:
    def play(case: Case) -> None:
        case.reads("the  Motion\nconnection", "motion connection", "absent")

    result = _fault(play).run(tmp_path)
    assert "NOT: the message says 'absent'" in result.outcome
    assert result.message == "the Motion connection"
