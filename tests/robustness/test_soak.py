"""The soak: a short one, its file, and its table."""

import dataclasses
import json
from pathlib import Path
from typing import Any

import pytest

from tests.robustness import soak, soak_cycle
from tests.robustness.soak_cycle import Cycle

pytestmark = pytest.mark.alone


def quiet(done: int, total: int, stage: str) -> None:
    """Tell nobody."""


@pytest.mark.slow
def test_a_cycle_of_every_kind_keeps_its_promises(tmp_path: Path) -> None:
    count = len(soak_cycle.KINDS)
    results = soak.soak(tmp_path, count, 5, quiet)
    assert results.failed == () and results.limit_violations == 0
    assert {each.cycles for each in results.kinds.values()} == {1}
    assert set(results.kinds) == {kind.name for kind in soak_cycle.KINDS}


def test_cycles_that_were_played_are_not_played_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = soak.soak(tmp_path, 2, 1, quiet)
    (path,) = tmp_path.glob("*.jsonl")
    # A crash cuts the last line: that cycle is played again, the first is not.
    lines = path.read_text().splitlines()
    path.write_text(lines[0] + "\n" + lines[1][:20])
    played: list[int] = []
    play = soak_cycle.play

    def counted(folder: Path, seed: int, cycle: int) -> Any:
        played.append(cycle)
        return play(folder, seed, cycle)

    monkeypatch.setattr(soak, "play", counted)
    again = soak.soak(tmp_path, 2, 1, quiet)
    assert played == [1] and again.points == first.points
    assert json.loads(path.read_text().splitlines()[0])["cycle"] == 0


def test_the_table_names_what_failed(tmp_path: Path) -> None:
    results = soak.soak(tmp_path, 1, 2, quiet)
    page = soak.table(results)
    assert "| cycles that kept every promise | 1 of 1 | 1 of 1 |" in page
    failed = Cycle(0, "jump", "fault", problems=["NOT: it stops"])
    page = soak.table(dataclasses.replace(results, failed=(failed,)))
    assert "- cycle 0 (jump): NOT: it stops" in page
