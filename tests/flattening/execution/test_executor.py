"""The executor on plain values: order, operator, reactions, and every way to end."""

import dataclasses as dc
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from unwrinkle.flattening.execution import executor
from unwrinkle.flattening.execution.executor import DEAD_MAN_RELEASED
from unwrinkle.flattening.execution.settings import ExecutionSettings, LostCloth
from unwrinkle.flattening.execution.state import Outcome
from unwrinkle.models.errors import InputError
from unwrinkle.models.site import loopback_site
from unwrinkle.planning.arrival import ARRIVED_POSITION_RAD, ARRIVED_SPEED_RAD_S
from unwrinkle.planning.motion_mode import MotionMode

PLAN = ["approach", "pull", "release"]
OPEN, CLOSED = (False, False), (True, True)


def outcome(run: Any) -> str:
    assert run.state.result is not None
    return str(run.state.result.outcome)


def reason(run: Any) -> str:
    assert run.state.result is not None
    return str(run.state.result.reason)


# ---------------------------------------------------------------- order


def test_segments_and_strokes_in_order(looped: Any) -> None:
    looped.until()
    assert outcome(looped) == Outcome.DONE and looped.state.result.finished == tuple(PLAN)
    assert looped.robot.runs == PLAN and looped.robot.strokes == [CLOSED, OPEN]
    names = [record.name for record in looped.state.records]
    assert names == ["approach", "close", "pull", "open", "release"]
    for before, after in zip(looped.state.records, looped.state.records[1:], strict=False):
        assert before.finished - before.sent >= 0.2 and after.sent >= before.finished
    assert looped.robot.kinds == ["run", "run", "run"]  # the controller stays in its mode


def test_an_attended_execution_leaves_trajectory_mode(attended: Any) -> None:
    attended.until()
    assert outcome(attended) == Outcome.DONE
    assert attended.robot.kinds == ["run", "run", "run", "stop"]
    wanted = ["segment", "gripper", "segment", "gripper", "segment", "end", "result"]
    assert attended.events == wanted


def test_numbers_go_on_in_the_next_plan(looped: Any) -> None:
    looped.until()
    first = looped.state
    again = executor.begin(first, looped.plan, looped.time)
    assert again.result is None and again.records == ()
    looped.state = again
    looped.until()
    assert [motion.number for motion in looped.robot.motions] == [1, 2, 3, 4, 5, 6]
    assert looped.state.gripper.number == 4


def test_without_grippers_strokes_are_pauses(run_of: Callable[..., Any]) -> None:
    run = run_of(ExecutionSettings(), grippers=False)
    run.until()
    assert outcome(run) == Outcome.DONE and run.robot.runs == PLAN
    assert run.time >= 3 * 0.5 + 2 * 0.2


@pytest.mark.parametrize("name", ["positions", "velocities"])
def test_nothing_is_sent_away_from_the_start_or_in_motion(looped: Any, name: str) -> None:
    setattr(looped.robot, name, getattr(looped.robot, name) + 0.01)
    looped.until()
    assert outcome(looped) == Outcome.FAILED and "was not sent" in reason(looped)
    assert looped.robot.motions == []
    assert looped.time >= ExecutionSettings().rest


def test_arms_that_come_to_rest_late_are_waited_for(looped: Any) -> None:
    looped.robot.velocities = np.full(13, 2 * ARRIVED_SPEED_RAD_S)
    looped.steps(20)
    assert looped.robot.motions == []
    looped.robot.velocities = np.zeros(13)
    looped.until()
    assert outcome(looped) == Outcome.DONE


def test_unknown_feedback_is_not_rest(looped: Any) -> None:
    looped.robot.age = float("inf")
    looped.until()
    assert outcome(looped) == Outcome.FAILED and looped.robot.motions == []


# ---------------------------------------------------------------- the controller


@pytest.mark.parametrize(
    ("fault", "text"),
    [
        ({"refuses": "3 mrad off"}, "approach: the controller refused the motion: 3 mrad off"),
        ({"deaf": True}, "approach: the controller did not answer"),
        ({"hangs": True}, "approach: not finished after"),
    ],
)
def test_a_controller_that_does_not_move(looped: Any, fault: dict[str, Any], text: str) -> None:
    for name, value in fault.items():
        setattr(looped.robot, name, value)
    looped.until()
    assert outcome(looped) == Outcome.FAILED and text in reason(looped)
    assert looped.robot.runs == ["approach"] and looped.robot.strokes == []
    assert looped.robot.kinds.count("stop") == ("refuses" not in fault or 1)
    assert looped.time < 5.0


@pytest.mark.parametrize("when", ["approach", "closing grippers", "pull"])
def test_a_fault_of_the_controller_ends_it_in_any_step(looped: Any, when: str) -> None:
    looped.until(lambda: looped.state.activity == when)
    begun = list(looped.robot.runs)
    looped.robot.fail("an emergency stop is pressed")
    looped.until()
    assert outcome(looped) == Outcome.FAILED
    assert "an emergency stop is pressed" in reason(looped)
    assert looped.robot.runs == begun


def test_a_robot_in_fault_is_followed_to_rest(looped: Any) -> None:
    looped.until(looped.during("approach"))
    looped.robot.fail("an emergency stop is pressed")
    looped.robot.velocities = np.full(13, 0.1)
    looped.steps(20)
    assert looped.state.result is None
    looped.robot.velocities = np.zeros(13)
    looped.step()
    assert outcome(looped) == Outcome.FAILED


def test_a_fault_at_the_end_is_not_done(attended: Any) -> None:
    attended.until(lambda: attended.state.ending is not None)
    attended.robot.fail("an alarm")
    attended.until()
    assert (outcome(attended), reason(attended)) == (Outcome.FAILED, "an alarm")


def test_a_motion_that_ends_elsewhere_is_not_done(looped: Any) -> None:
    looped.until(lambda: looped.robot.status.completed == 1)
    looped.robot.positions = looped.robot.positions + 2 * ARRIVED_POSITION_RAD
    looped.until()
    assert "away from its last point" in reason(looped) and looped.robot.strokes == []


def test_a_stop_that_does_not_come_to_rest_is_said(looped: Any) -> None:
    looped.until(looped.during("pull"))
    looped.robot.deaf = looped.robot.hangs = True
    looped.step(stop="enough")
    since = looped.time
    looped.until()
    assert outcome(looped) == Outcome.FAILED and "did not come to rest" in reason(looped)
    assert looped.time - since == pytest.approx(looped.settings.brake, abs=0.1)


def test_a_stop_ends_once_the_arms_are_at_rest(looped: Any) -> None:
    looped.until(looped.during("pull"))
    looped.step(stop="enough")
    looped.robot.velocities = np.full(13, 0.1)
    looped.steps(20)
    assert looped.robot.status.state == MotionMode.IDLE and looped.state.result is None
    looped.robot.velocities = np.zeros(13)
    looped.step()
    assert outcome(looped) == Outcome.STOPPED


def test_a_motion_reported_as_done_at_its_start_is_not_begun_again(looped: Any) -> None:
    start = looped.robot.positions
    looped.until(lambda: looped.robot.status.completed == 1)
    looped.robot.positions = start
    looped.until()
    assert outcome(looped) == Outcome.FAILED and looped.robot.runs == ["approach"]


# ---------------------------------------------------------------- holds


def test_hold_and_resume(attended: Any) -> None:
    attended.until(attended.during("pull"))
    attended.step(hold="held by the operator")
    assert attended.robot.kinds[-1] == "hold"
    attended.steps(400)  # no deadline runs meanwhile
    assert attended.state.activity == "pull" and attended.state.held == "held by the operator"
    attended.step(resume=True)
    assert attended.robot.kinds[-1] == "resume"
    attended.until()
    assert outcome(attended) == Outcome.DONE and attended.robot.strokes == [CLOSED, OPEN]


def test_a_hold_between_segments_keeps_the_next_from_starting(attended: Any) -> None:
    attended.until(lambda: attended.state.activity == "closing grippers")
    attended.step(hold="held")
    attended.steps(200)
    assert attended.robot.runs == ["approach"]
    attended.step(resume=True)
    attended.until()
    assert attended.robot.runs == PLAN and outcome(attended) == Outcome.DONE


def test_a_hold_before_the_motion_began_begins_it_anew(attended: Any) -> None:
    attended.step()
    attended.robot.set(progress=0.0)
    attended.robot.positions = attended.state.steps[0].trajectory.positions[0]
    attended.step(hold="held")
    attended.steps(10)
    attended.step(resume=True)
    attended.until()
    assert outcome(attended) == Outcome.DONE
    assert attended.robot.runs == ["approach", *PLAN]


def test_a_hold_of_the_controllers_own_waits_for_an_operator(attended: Any) -> None:
    attended.until(attended.during("pull"))
    attended.robot.set(state=MotionMode.HELD, reason="feedback is old")
    attended.steps(50)
    assert attended.state.held == "feedback is old" and attended.robot.kinds[-1] == "run"
    attended.step(resume=True)
    attended.until()
    assert outcome(attended) == Outcome.DONE


def test_without_an_operator_it_is_a_fault(looped: Any) -> None:
    looped.until(looped.during("pull"))
    looped.robot.set(state=MotionMode.HOLDING, reason="feedback is old")
    looped.until()
    assert outcome(looped) == Outcome.FAILED and "feedback is old" in reason(looped)


def test_what_cannot_be_resumed_stays_held_and_says_why(attended: Any) -> None:
    attended.until(attended.during("pull"))
    attended.step(hold="held")
    attended.robot.refuses = "the robot stands off"
    attended.step(resume=True)
    attended.step()
    assert attended.state.held == "the robot stands off"
    assert attended.robot.status.state == MotionMode.HELD


def test_stop_ends_it_and_leaves_the_grippers(attended: Any) -> None:
    attended.until(attended.during("pull"))
    attended.step(stop="enough", hold="held", resume=True)
    attended.until()
    assert (outcome(attended), reason(attended)) == (Outcome.STOPPED, "enough")
    assert attended.state.result.finished == ("approach",)
    assert attended.robot.strokes == [CLOSED] and attended.robot.kinds[-1] == "stop"


def test_the_first_reason_is_kept(attended: Any) -> None:
    attended.until(attended.during("pull"))
    attended.robot.deaf = True
    attended.step(stop="enough")
    attended.steps(3, stop="more than enough", fail="the disk is full")
    attended.robot.deaf = False
    attended.until()
    assert reason(attended).startswith("enough")


# ---------------------------------------------------------------- speed and dead-man key


@pytest.mark.parametrize("speed", [0.0, -0.1, 1.01, float("nan"), 0.6])
def test_a_speed_beyond_what_is_allowed_is_refused(attended: Any, speed: float) -> None:
    with pytest.raises(InputError):
        attended.step(speed=speed)
    assert attended.step(speed=0.5).speed == 0.5


def test_a_slower_motion_has_more_time(looped: Any) -> None:
    looped.robot.hangs = True
    looped.step(speed=0.1)
    looped.until()
    least = 1.5 * 0.5 / 0.1
    assert least < looped.time < least + 2.0 + 4 * 0.025 + 0.1


def test_motion_waits_for_the_dead_man_key_and_holds_without_it(with_key: Any) -> None:
    run = with_key
    run.steps(200)
    assert run.robot.motions == [] and run.state.result is None
    run.until(run.during("approach"), alive=True)
    run.robot.hangs = True
    released = run.time
    run.until(lambda: bool(run.state.held))
    assert run.state.held == DEAD_MAN_RELEASED
    assert run.time - released <= 0.7 + 0.05 and run.robot.kinds[-1] == "hold"
    run.robot.hangs = False
    run.steps(50)
    assert run.robot.status.state == MotionMode.HELD
    run.until(alive=True)
    assert outcome(run) == Outcome.DONE


@pytest.mark.parametrize("pressed_first", [True, False])
def test_a_dead_man_key_does_not_undo_the_operators_hold(
    with_key: Any, pressed_first: bool
) -> None:
    run = with_key
    run.until(run.during("approach"), alive=True)
    if not pressed_first:  # the release holds it before the operator does
        run.robot.hangs = True
        run.until(lambda: bool(run.state.held))
        run.robot.hangs = False
    run.step(hold="held by the operator")
    run.steps(100, alive=True)
    assert run.robot.status.state == MotionMode.HELD
    assert run.state.held == "held by the operator"


# ---------------------------------------------------------------- grippers


@pytest.mark.parametrize("settings", ["looped", "attended"])
def test_a_grasp_on_nothing_opens_and_retreats(
    settings: str, request: pytest.FixtureRequest
) -> None:
    run = request.getfixturevalue(settings)
    start = run.robot.positions.copy()
    run.robot.holding = (True, False)
    run.until()
    assert outcome(run) == Outcome.MISSED
    assert reason(run) == "the left gripper closed on nothing"
    assert run.robot.strokes == [CLOSED, OPEN] and run.robot.runs == ["approach", "retreat"]
    np.testing.assert_allclose(run.robot.positions, start, atol=1e-12)


def test_a_hand_that_takes_no_part_may_close_on_nothing(looped: Any) -> None:
    looped.state = dc.replace(looped.state, arms=(True, False))
    looped.robot.holding = (True, False)
    looped.until()
    assert outcome(looped) == Outcome.DONE


def test_a_fault_in_the_retreat_keeps_both_reasons(looped: Any) -> None:
    looped.robot.holding = OPEN
    looped.until(looped.during("retreat"))
    looped.robot.fail("an alarm")
    looped.until()
    assert outcome(looped) == Outcome.FAILED
    assert "closed on nothing" in reason(looped) and "an alarm" in reason(looped)


def test_lost_cloth_stops_and_opens_where_an_operator_decides(attended: Any) -> None:
    attended.until(attended.during("pull"))
    attended.robot.grip = dc.replace(attended.robot.grip, holding=(False, True))
    attended.until()
    assert outcome(attended) == Outcome.FAILED
    assert "the right gripper lost the cloth" in reason(attended)
    assert "both grippers are open" in reason(attended)
    assert attended.robot.runs == ["approach", "pull"]
    assert attended.robot.strokes == [CLOSED, OPEN] and attended.robot.kinds[-1] == "stop"


def test_lost_cloth_finishes_the_verified_pull_in_the_loop(looped: Any) -> None:
    assert looped.settings.lost_cloth == LostCloth.FINISH
    looped.until(looped.during("pull"))
    looped.robot.grip = dc.replace(looped.robot.grip, holding=(False, True))
    looped.until()
    assert outcome(looped) == Outcome.MISSED and "during the pull" in reason(looped)
    assert looped.robot.runs == PLAN and looped.robot.strokes == [CLOSED, OPEN]


@pytest.mark.parametrize("settings", ["looped", "attended"])
def test_a_gripper_that_fails_in_the_pull_stops_it(
    settings: str, request: pytest.FixtureRequest
) -> None:
    run = request.getfixturevalue(settings)
    run.until(run.during("pull"))
    run.robot.grip = dc.replace(run.robot.grip, reason="the right gripper does not answer")
    run.until()
    assert outcome(run) == Outcome.FAILED and "does not answer" in reason(run)
    assert run.robot.runs == ["approach", "pull"] and run.robot.strokes == [CLOSED, OPEN]


@pytest.mark.parametrize(("deaf", "opened"), [({1}, True), ({1, 2}, False)])
def test_grippers_that_do_not_close_are_opened_at_rest(
    looped: Any, deaf: set[int], opened: bool
) -> None:
    looped.robot.jaws_deaf = frozenset(deaf)
    looped.until()
    assert outcome(looped) == Outcome.FAILED and "the grippers did not close" in reason(looped)
    assert ("both grippers are open" in reason(looped)) == opened
    assert ("the grippers did not open" in reason(looped)) != opened
    assert looped.robot.runs == ["approach"] and looped.time < 12.0


def test_grippers_stay_closed_where_rest_is_not_known(looped: Any) -> None:
    looped.until(looped.during("pull"))
    looped.robot.grip = dc.replace(looped.robot.grip, reason="no air")
    looped.step()
    looped.robot.age = float("inf")
    looped.robot.fail("the connection is lost")
    looped.until()
    assert outcome(looped) == Outcome.FAILED and "not opened" in reason(looped)
    assert looped.robot.strokes == [CLOSED]


def test_a_reason_of_the_grippers_is_not_waited_for(looped: Any) -> None:
    looped.robot.jaws_deaf = frozenset({1})
    looped.until(lambda: looped.state.activity == "closing grippers")
    since = looped.time
    looped.robot.grip = dc.replace(looped.robot.grip, reason="no air")
    looped.until()
    assert "no air" in reason(looped) and looped.time - since < 0.2


def test_grippers_that_report_another_state_end_it(looped: Any) -> None:
    looped.until(lambda: looped.state.activity == "closing grippers")
    looped.robot.grip = dc.replace(looped.robot.grip, closed=(True, False))
    looped.until()
    assert outcome(looped) == Outcome.FAILED and looped.robot.runs == ["approach"]


# ---------------------------------------------------------------- settings


def test_settings_of_a_site_agree_with_the_drivers_arrival() -> None:
    site = loopback_site()
    settings = ExecutionSettings.of_site(site)
    tolerances = np.array(settings.position_tolerance)
    assert tolerances.shape == (13,)
    assert (tolerances <= ARRIVED_POSITION_RAD).all()
    assert (tolerances <= site.controller.start_tolerances).all()
    assert settings.rest_speed == ARRIVED_SPEED_RAD_S
    assert settings.start_delay >= site.controller.start_timeout + site.controller.pause
    assert settings.gripper > site.grippers.timeout
    assert not settings.dead_man and settings.lost_cloth == LostCloth.FINISH


def test_an_execution_over_changes_nothing(looped: Any) -> None:
    looped.until()
    over = looped.state
    assert looped.steps(3, stop="enough", hold="held", speed=0.5) is over
