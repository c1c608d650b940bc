"""The adapter between the executor and the devices: feedback in, commands and events out."""

import dataclasses as dc
from typing import Any

import numpy as np
import pytest

from unwrinkle.flattening.execution.state import Outcome
from unwrinkle.hardware.controller_state import DriverState
from unwrinkle.hardware.run_log.protocol import NoLog
from unwrinkle.models.errors import InputError
from unwrinkle.planning.motion_mode import MotionMode


class Events(NoLog):
    """Log that keeps its events, and fails from one of them on."""

    def __init__(self, fails_at: str = "") -> None:
        self.events: list[tuple[str, str]] = []
        self._fails_at, self._full = fails_at, False

    def event(self, now: float, kind: str, text: str, **data: object) -> None:
        self._full |= bool(self._fails_at) and text == self._fails_at
        if self._full:
            raise OSError("No space left on device")
        self.events.append((kind, text))


def test_a_plan_is_passed_on_to_the_devices(bench_of: Any) -> None:
    log = Events()
    bench = bench_of(log=log)
    steps: list[str] = []
    progress: list[float] = []
    bench.run(
        lambda: steps.append(bench.executor.step) or progress.append(bench.executor.progress)  # type: ignore[func-returns-value]
    )
    assert bench.executor.result.outcome == Outcome.DONE
    assert bench.driver.runs == ["approach", "pull", "release"]
    assert bench.grippers.commands == [(True, True), (False, False)]
    order = [step for step in dict.fromkeys(steps) if step != "waiting"]
    wanted = ["approach", "closing grippers", "pull", "opening grippers", "release"]
    assert order[:5] == wanted
    assert progress[-1] == pytest.approx(bench.plan.segments[-1].end, abs=0.05)
    # The stop leaves trajectory mode; the hold after it acknowledges its number.
    assert [call[0] for call in bench.driver.calls[-2:]] == ["stop", "hold"]
    assert [kind for kind, _ in log.events] == [
        *("segment", "gripper", "segment", "gripper", "segment"),
        *("end", "result"),
    ]


def test_numbers_count_up_from_the_devices(bench_of: Any) -> None:
    bench = bench_of(stroke=4)
    bench.driver.status = dc.replace(bench.driver.status, command=7, completed=7)
    bench.executor = type(bench.executor)(
        bench.driver, bench.grippers, bench.plan, bench.executor._settings, speed=0.5, stroke=4
    )
    bench.run()
    assert [call[1] for call in bench.driver.calls if call[0] == "run"] == [8, 9, 10]
    assert bench.grippers.status.command == 6


def test_wishes_reach_the_driver_in_the_next_poll(bench: Any) -> None:
    bench.run(bench.during("pull"))
    before = len(bench.driver.calls)
    bench.executor.hold("held")
    bench.executor.set_speed(0.25)
    assert len(bench.driver.calls) == before and bench.executor.speed == 0.25
    bench.step()
    assert [call[0] for call in bench.driver.calls[before:]] == ["override", "hold"]
    assert bench.executor.held == "held"
    bench.executor.resume()
    bench.step()
    assert bench.driver.calls[-1][0] == "resume"
    bench.executor.stop("enough")
    bench.run()
    assert (bench.executor.result.outcome, bench.executor.result.reason) == ("stopped", "enough")
    assert bench.grippers.commands == [(True, True)]


@pytest.mark.parametrize("speed", [0.0, 0.6, float("nan")])
def test_a_speed_beyond_what_is_allowed_is_refused(bench_of: Any, speed: float) -> None:
    with pytest.raises(InputError):
        bench_of(speed=speed)
    bench = bench_of(speed=0.2)
    with pytest.raises(InputError):
        bench.executor.set_speed(speed)
    assert bench.executor.speed == 0.2


@pytest.mark.parametrize("state", DriverState)
def test_every_state_of_a_driver_has_a_mode(bench: Any, state: DriverState) -> None:
    bench.driver.status = dc.replace(bench.driver.status, state=state)
    mode = bench.executor._feedback(0.0).controller.state
    still = {DriverState.READY, DriverState.CONNECTING}
    lost = {DriverState.FAULT, DriverState.OFFLINE}
    assert (mode == MotionMode.IDLE) == (state in still)
    assert (mode == MotionMode.FAULT) == (state in lost)
    assert (mode == MotionMode.HELD) == (state == DriverState.HELD)


def test_missing_feedback_is_unknown(bench: Any) -> None:
    bench.driver.feedback = None
    feedback = bench.executor._feedback(0.0)
    assert np.isnan(feedback.positions).all() and feedback.age == float("inf")


def test_a_closed_gripper_without_a_sensor_counts_as_holding(bench: Any) -> None:
    bench.grippers.holding = (None, False)
    bench.run()
    assert bench.executor.result.outcome == Outcome.MISSED
    assert "the left gripper" in bench.executor.result.reason
    assert bench.driver.runs == ["approach", "retreat"]


def test_without_grippers_events_are_pauses(bench_of: Any) -> None:
    bench = bench_of(grippers=False)
    bench.run()
    assert bench.executor.result.outcome == Outcome.DONE and bench.grippers.commands == []


def test_a_full_disk_sends_no_further_segment(bench_of: Any) -> None:
    bench = bench_of(log=Events(fails_at="pull"))
    bench.run()
    assert bench.executor.result.outcome == Outcome.FAILED
    assert "No space left" in bench.executor.result.reason
    assert bench.driver.runs == ["approach"]
    assert [call[0] for call in bench.driver.calls[-2:]] == ["stop", "hold"]


def test_a_fault_of_the_driver_ends_it_with_its_reason(bench: Any) -> None:
    bench.run(bench.during("approach"))
    bench.driver.fail("an emergency stop is pressed")
    bench.run()
    assert bench.executor.result.outcome == Outcome.FAILED
    assert "an emergency stop is pressed" in bench.executor.result.reason
