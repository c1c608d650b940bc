"""The faults of the driver see a driver that breaks its promises."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.robustness import catalogue
from tests.robustness.rig.fault import FaultResult
from unwrinkle.hardware.controller.driver import ControllerDriver
from unwrinkle.hardware.controller.monitor import Monitor
from unwrinkle.hardware.run_log.writer import RunLog
from unwrinkle.hardware.streaming import path_clock
from unwrinkle.hardware.streaming.sent_cubics import StreamLimits
from unwrinkle.hardware.streaming.stream import PointStream

pytestmark = pytest.mark.alone


def played(name: str, tmp_path: Path) -> FaultResult:
    result = catalogue.fault(name).run(tmp_path)
    assert not result.survived
    return result


def test_a_driver_that_sees_no_following_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Monitor, "follows", lambda *_: None)
    assert "NOT: the message says 'off its path'" in played("S2", tmp_path).outcome


def test_a_driver_whose_faults_do_not_latch(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fault = ControllerDriver._fault

    def forgetful(self: Any, finding: Any) -> None:
        fault(self, finding)
        self._state = "ready"

    monkeypatch.setattr(ControllerDriver, "_fault", forgetful)
    assert "latches" in played("S4", tmp_path).outcome


def test_changes_of_rate_that_take_no_notice_of_limits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(StreamLimits, "keeps", lambda *_: True)
    monkeypatch.setattr(path_clock, "plausible", lambda path, start, target, times, limits: times)
    result = played("P7", tmp_path)
    assert result.limit_violations > 0 and "beyond its limit" in result.outcome


def test_a_log_that_forgets_points(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    commanded = RunLog.commanded

    def sometimes(self: Any, now: float, number: int, sequence: int, *rest: Any) -> None:
        if sequence % 9:
            commanded(self, now, number, sequence, *rest)

    monkeypatch.setattr(RunLog, "commanded", sometimes)
    assert "NOT: the log has every point" in played("N2", tmp_path).outcome


def test_points_that_are_sent_late(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(PointStream, "ran_out", lambda *_: "")
    assert "NOT:" in played("C1", tmp_path).outcome


def test_feedback_that_is_believed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Monitor, "plausible", lambda *_: None)
    assert "never ready" in played("S5", tmp_path).outcome


def test_the_same_seed_plays_the_same_cycle(tmp_path: Path) -> None:
    from tests.robustness.soak_cycle import play

    first, again = (play(tmp_path / name, 3, 4) for name in "ab")
    assert first.points == again.points > 0 and first.reason == again.reason
    assert first.changes == again.changes and np.isfinite(first.seconds)
