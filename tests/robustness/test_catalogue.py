"""Every row of the fault catalogue, as the benchmark plays it; and that a row can fail."""

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.robustness import page as faults
from tests.robustness.faults import firmware
from tests.robustness.rig.fault import Case, Row

pytestmark = pytest.mark.alone

#: Those that start processes, or run the whole loop.
SLOW = {"P1", "V1", "V2", "V5", "G2"}
#: Those that run `unwrinkle execute` several times: left to the benchmark, their pieces stand in
#: tests/unwrinkle/execution.
LONG = {"C2", "G1", "P4", "V6", "F1"}


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(row.id, marks=[pytest.mark.slow] if row.id in SLOW else [])
        for row in faults.rows()
        if row.id not in LONG
    ],
)
def test_fault_is_survived(name: str, tmp_path: Path) -> None:
    result = faults.row(name).run(tmp_path)
    assert result.survived, f"{result.outcome}\nread: {result.message}"
    assert result.limit_violations == 0


@pytest.mark.slow
def test_killed_drivers_leave_nothing_that_is_run(tmp_path: Path) -> None:
    case = Case(tmp_path)
    firmware.kills(case, 2)
    assert not case.broken and case.moved_before_command == 0.0
    assert "a stop as the first bytes empties the queues" in case.kept


def test_every_row_of_the_catalogue_is_there_once() -> None:
    wanted = [f"{letter}{k}" for letter, n in faults.CATALOGUE.items() for k in range(1, n + 1)]
    found = [row.id for row in faults.rows()]
    assert sorted(found) == sorted(wanted)


def _row(play: Callable[[Case], None]) -> Row:
    return Row("N1", "a fault", "so", "this", play)


def test_a_row_fails_with_what_differed(tmp_path: Path) -> None:
    def play(case: Case) -> None:
        case.expect(True, "it rains")
        case.expect(False, "the sun shines", "clouds")

    result = _row(play).run(tmp_path)
    assert not result.survived
    assert result.outcome == "NOT: the sun shines (found: clouds)"


def test_a_row_that_looks_at_nothing_fails(tmp_path: Path) -> None:
    result = _row(lambda case: None).run(tmp_path)
    assert not result.survived and "looked at something" in result.outcome


def test_an_exception_and_a_limit_violation_fail_a_row(tmp_path: Path) -> None:
    def raising(case: Case) -> None:
        case.expect(True, "it rains")
        raise RuntimeError("out of paper")

    def beyond(case: Case) -> None:
        case.violations(["velocity of axis 3"])

    result = _row(raising).run(tmp_path)
    assert not result.survived and "RuntimeError: out of paper" in result.outcome
    result = _row(beyond).run(tmp_path)
    assert not result.survived and result.limit_violations == 1


def test_messages_are_read_word_by_word(tmp_path: Path) -> None:
    def play(case: Case) -> None:
        case.reads("the  Motion\nconnection", "motion connection", "absent")

    result = _row(play).run(tmp_path)
    assert "NOT: the message says 'absent'" in result.outcome
    assert result.message == "the Motion connection"


def test_the_table_tells_what_failed() -> None:
    good = {
        "id": "N1",
        "fault": "a | b",
        "injected": "so",
        "must": "this",
        "outcome": "one; two",
        "survived": True,
        "message": "cannot connect to 127.0.0.1:4711",
        "limit_violations": 0,
        "seconds": 0.1,
    }
    bad = {**good, "id": "N2", "survived": False, "outcome": "NOT: it (found: not)"}
    page = faults.table(
        {
            "rows": [good, bad],
            "rows_survived_fraction": 1 / 3,
            "limit_violations": 0,
            "moved_before_command": 0.0,
            "increments": [],
            "missing": ["N3"],
        }
    )
    assert "| rows survived | 3 of 3 | 1 of 3 |" in page
    assert "| N2 | a \\| b | so | this | **FAILED** |" in page
    assert "rows without an injection | 0 | N3" in page
    assert "127.0.0.1:PORT" in page and "4711" not in page
