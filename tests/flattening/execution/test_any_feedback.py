"""Whatever the robot reports and the operator wishes, the executor keeps its promises."""

import dataclasses as dc
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from unwrinkle.flattening.execution import executor
from unwrinkle.flattening.execution.settings import ExecutionSettings, LostCloth
from unwrinkle.flattening.execution.state import (
    ExecutionFeedback,
    ExecutionState,
    MotionKind,
    OperatorWishes,
    Outcome,
    Phase,
)
from unwrinkle.flattening.station_messages import ControllerStatus, GripperStatus
from unwrinkle.planning.arrival import ARRIVED_POSITION_RAD
from unwrinkle.planning.motion_mode import MotionMode


@dc.dataclass(frozen=True)
class Report:
    """What the robot reports in one period, relative to what it was commanded."""

    place: str  # where the arms are: start or end of the present motion, or elsewhere
    speed: float
    state: MotionMode
    answered: bool
    completed: bool
    stroked: bool
    holding: tuple[bool, bool]
    trouble: str
    age: float
    gap: float


def mostly(usual: Any, *others: Any) -> st.SearchStrategy[Any]:
    """Draw the usual value three times of four."""
    return st.sampled_from([usual] * 3 * len(others) + list(others))


REPORTS = st.builds(
    Report,
    place=st.sampled_from(["start", "start", "end", "end", "end", "elsewhere"]),
    speed=mostly(0.0, 4e-3, 6e-3, 0.3, float("nan")),
    state=mostly(
        MotionMode.IDLE,
        MotionMode.RUNNING,
        MotionMode.RUNNING,
        MotionMode.HOLDING,
        MotionMode.HELD,
        MotionMode.FAULT,
    ),
    answered=mostly(True, False),
    completed=mostly(True, False),
    stroked=mostly(True, False),
    holding=mostly((True, True), (True, False), (False, False)),
    trouble=mostly("", "", "", "no air"),
    age=mostly(0.0, 0.5, float("inf")),
    gap=mostly(0.25, 0.02, 1.0, 12.0),
)
WISHES = mostly(
    OperatorWishes(alive=True),
    OperatorWishes(),
    OperatorWishes(hold="held"),
    OperatorWishes(resume=True, alive=True),
    OperatorWishes(hold="held", resume=True),
    OperatorWishes(speed=0.3, alive=True),
    OperatorWishes(stop="enough"),
    OperatorWishes(fail="the disk is full"),
)
SETTINGS = st.builds(
    ExecutionSettings,
    dead_man=st.booleans(),
    attended=st.booleans(),
    leave_mode=st.booleans(),
    lost_cloth=st.sampled_from(LostCloth),
)


def feedback_of(report: Report, now: ExecutionState, time: float) -> ExecutionFeedback:
    motions = [step.trajectory for step in now.steps if step.trajectory is not None]
    positions = np.zeros(13)
    if motions and report.place != "elsewhere":
        positions = motions[0].positions[0 if report.place == "start" else -1]
    elif motions:
        positions = motions[0].positions[0] + 2 * ARRIVED_POSITION_RAD
    command = now.motion.number if report.answered else now.motion.number - 1
    completed = command if report.completed else 0
    stroke = now.gripper.number if report.stroked else now.gripper.number - 1
    right, left = now.gripper.closed
    holding = (right and report.holding[0], left and report.holding[1])
    grip = GripperStatus(stroke, (0.0, 0.0), now.gripper.closed, holding, report.trouble)
    status = ControllerStatus(report.state, command, completed, 0.0, "")
    velocities = np.full(13, report.speed)
    return ExecutionFeedback(time, positions, velocities, status, grip, report.age)


def check(
    before: ExecutionState, now: ExecutionState, feedback: ExecutionFeedback, rules: Any
) -> None:
    """Check the promises for one step."""
    rests = feedback.age <= rules.settle and np.abs(feedback.velocities).max() <= rules.rest_speed
    motion, commanded = now.motion, now.motion.number > before.motion.number
    if commanded and motion.kind == MotionKind.RUN:
        assert rests, "a segment is sent at rest"
        off = np.abs(feedback.positions - motion.trajectory.positions[0]).max()
        assert off <= rules.position_tolerance, "from its start"
        assert not now.held, "a hold keeps segments back"
        assert not rules.dead_man or feedback.time - now.alive_at <= rules.dead_man_timeout
    if commanded and motion.kind == MotionKind.RESUME:
        assert before.held and not now.held, "only a hold is resumed"
    if now.ending is not None:
        assert not commanded or motion.kind == MotionKind.STOP, "no motion follows an end"
    if now.gripper.number > before.gripper.number:
        assert rests, "no stroke during motion"
        assert before.phase in (Phase.WAITING, Phase.STOPPING)
        assert now.ending is None or now.gripper.closed == (False, False)
    assert now.motion.number >= before.motion.number
    if now.result is not None:
        if now.result.outcome == Outcome.DONE:
            assert now.result.finished == ("approach", "pull", "release")
            assert now.result.reason == ""
        else:
            assert now.result.reason


@settings(
    max_examples=200, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(SETTINGS, st.lists(st.tuples(REPORTS, WISHES), min_size=5, max_size=40))
def test_promises_hold(
    run_of: Callable[..., Any], rules: ExecutionSettings, period: list[tuple[Report, Any]]
) -> None:
    run = run_of(rules)
    time = 0.0
    for report, wishes in period:
        time += report.gap
        before = run.state
        feedback = feedback_of(report, before, time)
        run.state = executor.step(rules, before, feedback, wishes)
        check(before, run.state, feedback, rules)
        if before.result is not None:
            assert run.state is before, "nothing follows the end"


@pytest.mark.parametrize("seed", range(3))
def test_random_sequences_reach_every_phase_and_outcome(
    run_of: Callable[..., Any], seed: int
) -> None:
    """The property above is not empty: ideal reports with rare faults reach every phase."""
    rng = np.random.default_rng(seed)
    phases: set[str] = set()
    outcomes: set[str] = set()
    for _ in range(300):
        rules = ExecutionSettings(
            lost_cloth=LostCloth.STOP if rng.random() < 0.5 else LostCloth.FINISH,
            leave_mode=bool(rng.random() < 0.5),
        )
        run, time = run_of(rules), 0.0
        for _ in range(40):
            time += 0.25
            fault = rng.random() < 0.04
            report = Report(
                place="start" if run.state.phase == Phase.WAITING else "end",
                speed=0.0,
                state=MotionMode.FAULT if fault else MotionMode.IDLE,
                answered=True,
                completed=True,
                stroked=True,
                holding=(True, bool(rng.random() > 0.1)),
                trouble="",
                age=0.0,
                gap=0.25,
            )
            wishes = OperatorWishes(stop="enough" if rng.random() < 0.02 else "")
            before, feedback = run.state, feedback_of(report, run.state, time)
            run.state = executor.step(rules, before, feedback, wishes)
            check(before, run.state, feedback, rules)
            phases.add(run.state.phase)
        outcomes.add(run.state.result.outcome)
    assert phases == set(Phase)
    assert outcomes == set(Outcome)
