"""`unwrinkle log`: show, replay and export a log, complete or incomplete."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from unwrinkle import cli
from unwrinkle.hardware.controller_state import DriverStatus, JointFeedback
from unwrinkle.hardware.run_log.reader import read_run_log
from unwrinkle.hardware.run_log.writer import RunLog
from unwrinkle.logs import export
from unwrinkle.logs.replay import MOST_FRAMES, measured_track, plan_of, replay_page
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell
from unwrinkle.planning.plan import FlatteningPlan

BEGIN = 100.0


@pytest.fixture
def log(plan: FlatteningPlan, cell: Cell, tmp_path: Path) -> Path:
    """Write the log of a run of the plan at 40 Hz, with rest before and after."""
    plan.save(tmp_path / "plan.npz")
    header = {
        "site": "loopback",
        "plan_file": str(tmp_path / "plan.npz"),
        "plan_hash": plan.content_hash,
        "axes": cell.robot.axes,
        "clock": BEGIN,
        "begun": "2026-01-02T03:04:05.000+00:00",
        "scenario": "",
        "speed": 1.0,
    }
    with RunLog.create(tmp_path / "run.jsonl", header) as writer:
        for segment in plan.segments:
            path = segment.trajectory
            for i in range(0, len(path.times), 10):
                now = BEGIN + 5.0 + segment.start + path.times[i]
                writer.commanded(now, 1, i, path.times[i], path.positions[i], path.velocities[i])
        times = np.arange(0.0, plan.segments[-1].end + 10.0, 0.025)
        for k, time in enumerate(times):
            local = np.clip(time - 5.0, 0.0, plan.segments[-1].end)
            segment = [s for s in plan.segments if s.start <= local][-1]
            q = segment.trajectory.interpolant()(
                min(local - segment.start, segment.trajectory.duration)
            )
            writer.measured(BEGIN + time, JointFeedback(q, np.zeros(13), BEGIN + time, time, k))
        for event in plan.events:
            now = BEGIN + 5.0 + event.time
            writer.event(now, "gripper", "both", closed=list(event.closed))
        writer.status(BEGIN, DriverStatus("ready"))
        writer.status(BEGIN + 5.0, DriverStatus("running"))
        writer.event(BEGIN + 9.0, "result", "done", outcome="done")
    return tmp_path / "run.jsonl"


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


def test_export(log: Path, monkeypatch: pytest.MonkeyPatch, plan: FlatteningPlan) -> None:
    from mcap.reader import make_reader

    target = log.with_suffix(".mcap")
    assert run(monkeypatch, "export", log, "--mcap", target) == 0
    records = read_run_log(log)
    with target.open("rb") as stream:
        messages = list(make_reader(stream).iter_messages())
    counts = {topic: 0 for topic in ("/commanded", "/measured", "/status", "/events")}
    for _, channel, _ in messages:
        counts[channel.topic] += 1
    assert counts["/measured"] == len(records.measured.times)
    assert counts["/commanded"] == len(records.commanded.times)
    assert (counts["/status"], counts["/events"]) == (2, len(records.events))
    first = next(m for _, channel, m in messages if channel.topic == "/commanded")
    value = json.loads(first.data)
    np.testing.assert_array_equal(value["position"], plan.segments[0].trajectory.positions[0])
    assert len(value["name"]) == 13
    # 5 s after the begin, whose time of day the header states.
    assert first.log_time == 1767323045_000_000_000 + 5_000_000_000
    times = [message.log_time for _, _, message in messages]
    assert times == sorted(times)


def test_export_without_the_package(
    log: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, "mcap.writer", None)
    with pytest.raises(InputError, match=r"pip install 'unwrinkle\[mcap\]'"):
        export.export_mcap(read_run_log(log), tmp_path / "a.mcap")
    assert not (tmp_path / "a.mcap").exists()


@pytest.mark.parametrize("command", ["show", "replay", "export"])
def test_a_file_that_is_no_log(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    command: str,
    plan: FlatteningPlan,
) -> None:
    plan.save(tmp_path / "plan.npz")
    options = ["--mcap", tmp_path / "a.mcap"] if command == "export" else []
    assert run(monkeypatch, command, tmp_path / "plan.npz", *options) == 2
    assert capsys.readouterr().err.startswith("unwrinkle: ")
