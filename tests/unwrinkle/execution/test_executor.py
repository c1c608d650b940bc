"""The executor on a fake clock: order of motion and grippers, and every way to end it."""

import dataclasses as dc
from typing import Any

import pytest

from unwrinkle.execution.executor import DONE, FAILED, STOPPED, PlanExecutor
from unwrinkle.hardware.controller_state import HELD
from unwrinkle.hardware.run_log.protocol import NoLog
from unwrinkle.models.errors import InputError

pytestmark = pytest.mark.alone

STEP = 0.02


def test_segments_and_grippers_in_order(bench: Any) -> None:
    steps: list[str] = []
    bench.run(lambda: steps.append(bench.executor.step) is not None)
    assert bench.executor.result is not None
    assert bench.executor.result.outcome == DONE
    assert bench.executor.result.finished == ("approach", "pull", "release")
    assert bench.driver.runs == ["approach", "pull", "release"]
    assert bench.grippers.commands == [(True, True), (False, False)]
    order = [step for i, step in enumerate(steps) if i == 0 or step != steps[i - 1]]
    wanted = ["approach", "closing grippers", "pull", "opening grippers", "release"]
    assert [step for step in order if step in wanted] == wanted
    assert bench.driver.calls[-1] == ("stop", "the plan is done")


@pytest.mark.parametrize("off", [-4e-4, -1e-15, 0.0, 4e-16, 4e-4])
def test_rounding_of_times_does_not_change_the_order(bench_of: Any, off: float) -> None:
    # Times are sums: the pull may end one rounding error after the event that follows it.
    bench = bench_of()
    first, pull, last = bench.plan.segments
    plan = dc.replace(bench.plan, segments=(first, dc.replace(pull, start=pull.start + off), last))
    executor = PlanExecutor(bench.driver, bench.grippers, plan)
    kinds = [type(step).__name__ for step in executor._steps]
    assert kinds == ["Segment", "GripperEvent", "Segment", "GripperEvent", "Segment"]
    assert [s.name for s in executor._steps[::2]] == ["approach", "pull", "release"]


def test_numbers_count_up_from_the_drivers(bench_of: Any) -> None:
    bench = bench_of()
    bench.driver.status = dc.replace(bench.driver.status, command=7, completed=7)
    bench.executor = PlanExecutor(bench.driver, bench.grippers, bench.plan)
    bench.run()
    assert [call[1] for call in bench.driver.calls if call[0] == "run"] == [8, 9, 10]


def test_hold_and_resume(bench: Any) -> None:
    bench.run(bench.during("pull"))
    bench.executor.hold()
    assert bench.driver.calls[-1][0] == "hold"
    for _ in range(100):
        bench.step()
    assert bench.executor.step == "pull"
    assert bench.executor.held == "held by the operator"
    assert bench.grippers.commands == [(True, True)]
    bench.executor.resume()
    assert bench.driver.calls[-1][0] == "resume"
    bench.run()
    assert bench.executor.result is not None and bench.executor.result.outcome == DONE


def test_a_hold_between_segments_keeps_the_next_from_starting(bench: Any) -> None:
    bench.run(lambda: bench.executor.step == "closing grippers")
    bench.executor.hold()
    for _ in range(200):
        bench.step()
    assert bench.driver.runs == ["approach"]
    bench.executor.resume()
    bench.run()
    assert bench.driver.runs == ["approach", "pull", "release"]


def test_a_hold_before_the_motion_began_begins_it_anew(bench: Any) -> None:
    bench.executor.poll(bench.now)
    assert bench.driver.status.state == "starting"
    bench.executor.hold()
    for _ in range(10):
        bench.step()
    bench.executor.resume()
    bench.run()
    assert bench.executor.result.outcome == DONE
    assert bench.driver.runs == ["approach", "approach", "pull", "release"]


def test_a_hold_of_the_drivers_own_waits_for_the_operator(bench: Any) -> None:
    bench.run(bench.during("pull"))
    bench.driver.status = dc.replace(bench.driver.status, state=HELD, reason="feedback is old")
    for _ in range(50):
        bench.step()
    assert bench.executor.held == "feedback is old"
    bench.executor.resume()
    bench.run()
    assert bench.executor.result.outcome == DONE


def test_what_cannot_be_resumed_stays_held_and_says_why(bench: Any) -> None:
    bench.run(bench.during("pull"))
    bench.executor.hold()
    bench.step()
    bench.driver.refuses = "the robot stands off"
    bench.executor.resume()
    bench.step()
    assert bench.executor.held == "resume refused: the robot stands off"
    assert bench.driver.status.state == HELD


def test_a_motion_that_ends_elsewhere_is_not_done(bench: Any) -> None:
    bench.run(bench.during("approach"))
    here = bench.driver.feedback
    bench.run(lambda: bench.driver.status.completed == 1)
    bench.driver.feedback = dc.replace(here, positions=here.positions + 0.01)
    bench.run()
    assert "away from its last point" in bench.executor.result.reason
    assert bench.grippers.commands == []


def test_stop_ends_it_and_leaves_the_grippers(bench: Any) -> None:
    bench.run(bench.during("pull"))
    bench.executor.stop("enough")
    bench.run()
    assert bench.executor.result is not None
    assert (bench.executor.result.outcome, bench.executor.result.reason) == (STOPPED, "enough")
    assert bench.executor.result.finished == ("approach",)
    assert bench.grippers.commands == [(True, True)]
    assert bench.driver.runs == ["approach", "pull"]


def test_a_fault_of_the_driver_ends_it_with_its_reason(bench: Any) -> None:
    bench.run(bench.during("approach"))
    bench.driver.fail("an emergency stop is pressed")
    bench.run()
    assert bench.executor.result is not None
    assert bench.executor.result.outcome == FAILED
    assert bench.executor.result.reason == "an emergency stop is pressed"
    assert bench.driver.runs == ["approach"] and bench.grippers.commands == []


def test_a_refused_segment_ends_it(bench: Any) -> None:
    bench.run(lambda: bench.executor.step == "closing grippers")
    bench.driver.refuses = "the robot stands 3 mrad off"
    bench.run()
    assert bench.executor.result is not None
    assert bench.executor.result.reason == "pull: the robot stands 3 mrad off"
    assert bench.executor.result.outcome == FAILED


def test_a_driver_that_does_not_listen_ends_it(bench: Any) -> None:
    bench.driver.deaf = True
    bench.run()
    assert bench.executor.result is not None
    assert "did not accept approach" in bench.executor.result.reason


def test_a_grasp_that_missed_opens_and_stops(bench: Any) -> None:
    bench.grippers.holding = (True, False)
    bench.run()
    assert bench.executor.result is not None
    assert "the left gripper closed without cloth" in bench.executor.result.reason
    assert "both grippers are open" in bench.executor.result.reason
    assert bench.grippers.commands == [(True, True), (False, False)]
    assert bench.driver.runs == ["approach"]


def test_a_gripper_that_does_not_answer_opens_and_stops(bench: Any) -> None:
    bench.grippers.lost = "the right gripper does not answer"
    bench.run()
    assert bench.executor.result is not None
    assert bench.executor.result.reason.startswith("the right gripper does not answer; both")
    assert bench.grippers.commands == [(True, True), (False, False)]
    assert bench.driver.runs == ["approach"]


def test_grippers_that_stay_dead_do_not_keep_it_from_ending(bench: Any) -> None:
    bench.grippers.lost = "the grippers do not answer"
    bench.grippers.poll = lambda now: setattr(
        bench.grippers,
        "status",
        dc.replace(bench.grippers.status, reason=bench.grippers.lost if now > 2.0 else ""),
    )
    bench.run()
    assert bench.executor.result is not None
    assert "did not open" in bench.executor.result.reason


def test_cloth_lost_in_the_pull_stops_it(bench: Any) -> None:
    bench.run(bench.during("pull"))
    bench.grippers.status = dc.replace(bench.grippers.status, holding=(False, True))
    bench.grippers.poll = lambda now: None
    bench.run()
    assert bench.executor.result is not None
    assert "the right gripper lost the cloth" in bench.executor.result.reason
    assert bench.driver.runs == ["approach", "pull"]


def test_without_grippers_events_are_pauses(bench_of: Any) -> None:
    bench = bench_of()
    bench.executor = PlanExecutor(bench.driver, None, bench.plan)
    bench.run()
    assert bench.executor.result is not None and bench.executor.result.outcome == DONE
    assert bench.now > bench.plan.segments[-1].end


@pytest.mark.parametrize("speed", [0.0, -0.1, 1.01, float("nan"), 0.6])
def test_a_speed_beyond_what_is_allowed_is_refused(bench_of: Any, speed: float) -> None:
    bench = bench_of(speed=0.2, most_speed=0.5)
    with pytest.raises(InputError, match="speed is"):
        bench.executor.set_speed(speed)
    assert bench.executor.speed == 0.2
    assert [call for call in bench.driver.calls if call[0] == "override"] == [("override", 0.2)]


def test_motion_waits_for_the_dead_man_key_and_holds_without_it(bench_of: Any) -> None:
    bench = bench_of(dead_man=True)
    for _ in range(100):
        bench.step()
    assert bench.driver.runs == []
    while not bench.during("approach")():
        bench.executor.alive(bench.now)
        bench.step()
    released = bench.now
    bench.run(lambda: bench.driver.status.state == HELD, most=2.0)
    assert bench.now - released <= 0.7 + 3 * STEP
    assert bench.executor.held == "dead-man key released"
    for _ in range(50):
        bench.step()
    assert bench.driver.status.state == HELD
    while bench.executor.result is None and bench.now < 60.0:
        bench.executor.alive(bench.now)
        bench.step()
    assert bench.executor.result is not None and bench.executor.result.outcome == DONE


def test_a_dead_man_key_does_not_undo_the_operators_hold(bench_of: Any) -> None:
    bench = bench_of(dead_man=True)
    while not bench.during("approach")():
        bench.executor.alive(bench.now)
        bench.step()
    bench.executor.hold()
    for _ in range(100):
        bench.executor.alive(bench.now)
        bench.step()
    assert bench.driver.status.state == HELD


class FullDisk(NoLog):
    """Log that fails from the start of the pull."""

    def event(self, now: float, kind: str, text: str, **data: object) -> None:
        if text == "pull":
            raise OSError("No space left on device")


def test_a_full_disk_ends_it_at_rest(bench_of: Any) -> None:
    bench = bench_of(log=FullDisk())
    bench.run()
    assert bench.executor.result is not None
    assert bench.executor.result.outcome == FAILED
    assert "No space left" in bench.executor.result.reason
    assert bench.driver.calls[-1][0] == "stop"
