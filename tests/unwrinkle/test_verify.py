"""`unwrinkle verify` as a user runs it."""

import dataclasses as dc
import json
import sys
from pathlib import Path

import pytest

from unwrinkle import cli
from unwrinkle.models.robot import load_cell
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.planner import FlatteningPlanner

pytestmark = pytest.mark.end_to_end


@pytest.fixture(scope="module")
def plan() -> FlatteningPlan:
    from unwrinkle.benchmarks._plan_tasks import flattening_task

    result = FlatteningPlanner(load_cell()).plan(flattening_task((0.0, -1.10), 0.2))
    assert result.plan is not None
    return result.plan


def verify(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> int:
    monkeypatch.setattr(sys, "argv", ["unwrinkle", "verify", *map(str, arguments)])
    with pytest.raises(SystemExit) as stop:
        cli.main()
    return int(stop.value.code or 0)


def test_good_plan(
    plan: FlatteningPlan,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    plan.save(tmp_path / "plan.npz")
    assert verify(monkeypatch, tmp_path / "plan.npz", "--json", tmp_path / "verdict.json") == 0
    captured = capsys.readouterr()
    assert captured.err == ""
    assert "is safe" in captured.out
    for word in ("jerk", "tip speed", "finger table", "proven"):
        assert word in captured.out
    verdict = json.loads((tmp_path / "verdict.json").read_text())
    assert verdict["passed"] is True
    assert verdict["plan_hash"] == plan.content_hash


def test_bad_plan(
    plan: FlatteningPlan,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    dc.replace(plan, events=plan.events[:1]).save(tmp_path / "plan.npz")
    assert verify(monkeypatch, tmp_path / "plan.npz", "--json", tmp_path / "verdict.json") == 3
    captured = capsys.readouterr()
    assert "there are 1 gripper events, expected 2" in " ".join(captured.out.split())
    assert "FAIL" in captured.out
    assert captured.err.startswith("unwrinkle: plan ") and captured.err.count("\n") == 1
    assert "NOT safe" in captured.err
    assert json.loads((tmp_path / "verdict.json").read_text())["violations"][0]["kind"] == "gripper"


def test_plan_of_another_cell(
    plan: FlatteningPlan,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    dc.replace(plan, robot_hash="0" * 64).save(tmp_path / "plan.npz")
    assert verify(monkeypatch, tmp_path / "plan.npz") == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "another model of the cell" in captured.err
