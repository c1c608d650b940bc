"""`unwrinkle log`: show and replay a log, complete or incomplete."""

import sys
from pathlib import Path

import numpy as np
import pytest

from unwrinkle import cli
from unwrinkle.hardware.run_log.reader import read_run_log
from unwrinkle.hardware.run_log.writer import RunLog
from unwrinkle.logs.replay import MOST_FRAMES, measured_track, plan_of, replay_page
from unwrinkle.models.robot import Cell
from unwrinkle.planning.plan import FlatteningPlan

#: Time 0 of the fixture's log, s.
BEGIN = 100.0


def run(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> int:
    monkeypatch.setattr(sys, "argv", ["unwrinkle", "log", *map(str, arguments)])
    with pytest.raises(SystemExit) as stop:
        cli.main()
    return int(stop.value.code or 0)


def test_show(
    log: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, "show", log) == 0
    out = capsys.readouterr().out
    for text in ("loopback", "40.0 per second", "13 of 13", "ready > running", "done", "complete"):
        assert text in out


def test_show_of_a_log_that_was_cut(
    log: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    log.write_bytes(log.read_bytes()[:-40])
    assert run(monkeypatch, "show", log) == 0
    out = capsys.readouterr().out
    assert "incomplete, as after a crash" in out
    assert "the program ended before the execution did" in out


def test_the_track_is_the_motion_with_a_little_rest(
    log: Path, cell: Cell, plan: FlatteningPlan
) -> None:
    track = measured_track(read_run_log(log), cell)
    assert track.duration == pytest.approx(plan.segments[-1].end + 2.0, abs=0.2)
    begin = BEGIN + 5.0 - track.begin
    middle = plan.segments[1]
    axes, openings = track.at(begin + middle.start + 0.5)
    np.testing.assert_allclose(axes, middle.trajectory.interpolant()(0.5), atol=2e-3)
    np.testing.assert_allclose(openings, 0.0, atol=1e-9)
    axes, openings = track.at(0.0)
    np.testing.assert_allclose(openings, cell.scenario.gripper.opening)
    np.testing.assert_allclose(axes, 0.0)


def test_replay(
    log: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(monkeypatch, "replay", log) == 0
    page = log.with_suffix(".html").read_text()
    assert "replay" in capsys.readouterr().out
    assert len(page) < 10_000_000
    assert "Content-Security-Policy" in page
    assert "<td>gripper</td>" in page


def test_text_of_a_log_cannot_break_out_of_the_page(log: Path, cell: Cell) -> None:
    lines = log.read_text().splitlines()
    lines[-1] = lines[-1].replace('"text":"done"', '"text":"<script>alert(1)</script>"')
    log.write_text("\n".join(lines) + "\n")
    page = replay_page(read_run_log(log), cell, None, title="<b>")
    assert "&lt;script&gt;alert(1)" in page and "<script>alert(1)" not in page


def test_a_plan_that_is_gone_or_another_is_left_out(log: Path) -> None:
    records = read_run_log(log)
    assert plan_of(records) is not None
    plan_file = Path(records.header["plan_file"])
    plan_file.write_bytes(plan_file.read_bytes()[:-30])
    assert plan_of(records) is None
    plan_file.unlink()
    assert plan_of(records) is None


def test_nothing_to_replay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    RunLog.create(tmp_path / "a.jsonl", {}).close()
    assert run(monkeypatch, "replay", tmp_path / "a.jsonl") == 2
    assert "sets of joint feedback" in capsys.readouterr().err
    assert not (tmp_path / "a.html").exists()
    assert MOST_FRAMES > 0


@pytest.mark.parametrize("command", ["show", "replay"])
def test_a_file_that_is_no_log(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    command: str,
    plan: FlatteningPlan,
) -> None:
    plan.save(tmp_path / "plan.npz")
    assert run(monkeypatch, command, tmp_path / "plan.npz") == 2
    assert capsys.readouterr().err.startswith("unwrinkle: ")
