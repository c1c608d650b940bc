"""`unwrinkle verify` as a user runs it."""

import dataclasses as dc
import json
import sys
from pathlib import Path

import numpy as np
import pytest

from unwrinkle import cli
from unwrinkle.models.robot import load_cell
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.search.planner import FlatteningPlanner
from unwrinkle.testing.targets import flattening_task

pytestmark = pytest.mark.end_to_end


@pytest.fixture(scope="module")
def plan() -> FlatteningPlan:
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
    assert "is verified against the model of the cell" in captured.out
    for word in ("jerk", "tip speed", "finger table", "lower bound"):
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
    assert "NOT verified" in captured.err
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


@pytest.fixture(scope="module")
def elsewhere() -> tuple[FlatteningPlan, str]:
    """A plan from another posture than home, and the posture as text."""
    start = np.zeros(13)
    start[[0, 1, 7]] = [-0.2, 0.3, -0.3]
    target = flattening_task((0.0, -1.10), 0.2)
    result = FlatteningPlanner(load_cell()).plan(target, start=start)
    assert result.plan is not None
    return result.plan, ",".join(map(str, start))


def test_a_plan_made_from_elsewhere_needs_its_start(
    elsewhere: tuple[FlatteningPlan, str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    plan, start = elsewhere
    plan.save(tmp_path / "plan.npz")
    assert verify(monkeypatch, tmp_path / "plan.npz") == 3
    assert "where the robot stands at" in " ".join(capsys.readouterr().out.split())
    assert verify(monkeypatch, tmp_path / "plan.npz", "--start", start) == 0
    assert verify(monkeypatch, tmp_path / "plan.npz", "--start", "ext_plus_90") == 3


def test_home_by_name(
    plan: FlatteningPlan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan.save(tmp_path / "plan.npz")
    assert verify(monkeypatch, tmp_path / "plan.npz", "--start", "home") == 0


@pytest.mark.parametrize("start", ["nowhere", "0,0,0", "nan" + 12 * ",0", "1e999" + 12 * ",0", ""])
def test_a_start_that_is_none(
    plan: FlatteningPlan,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    start: str,
) -> None:
    plan.save(tmp_path / "plan.npz")
    assert verify(monkeypatch, tmp_path / "plan.npz", "--start", start) == 2
    message = capsys.readouterr().err
    assert "ext_plus_90" in message and "13 finite angles" in message
    assert message.count("\n") == 1
