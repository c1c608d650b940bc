"""Transitions between states that all parts of the state machine share."""

import logging
from dataclasses import replace

import numpy as np

from unwrinkle.flattening.policy import PolicyState, Stop
from unwrinkle.flattening.state import (
    Action,
    Feedback,
    Mode,
    RunStatus,
    SupervisorSettings,
    SupervisorState,
)
from unwrinkle.flattening.station_messages import TrajectoryCommand

_log = logging.getLogger(__name__)


def at_rest(feedback: Feedback, settings: SupervisorSettings) -> bool:
    """Return whether every axis is slower than `settings.rest_speed`."""
    return bool(np.abs(feedback.velocities()).max() < settings.rest_speed)


def entered(now: SupervisorState, mode: Mode, feedback: Feedback) -> SupervisorState:
    """Enter `mode`; its command has not been sent."""
    return replace(now, mode=mode, since=feedback.time, sent=False)


def held(now: SupervisorState) -> SupervisorState:
    """Command a hold if a motion may be running."""
    if not now.moving:
        return now
    return replace(now, trajectory=TrajectoryCommand(now.trajectory.number + 1, None, "hold"))


def ended(
    now: SupervisorState, mode: Mode, status: RunStatus, reason: str, feedback: Feedback
) -> SupervisorState:
    """End the run and its present action."""
    action = replace(
        now.action,
        outcome=now.action.outcome or status,
        reason=now.action.reason or reason,
        policy_state=now.policy_state,
        ended=feedback.time,
    )
    now = replace(now, status=status, reason=reason, action=action, steps=())
    return entered(now, mode, feedback)


def fault(now: SupervisorState, reason: str, feedback: Feedback) -> SupervisorState:
    """Enter the fault state, which has no exit, and hold a running motion."""
    _log.error(reason)
    return ended(held(now), Mode.FAULT, RunStatus.FAULTED, reason, feedback)


def stopped(now: SupervisorState, stop: Stop, feedback: Feedback) -> SupervisorState:
    """End the run by a decision of the policy."""
    now = replace(now, action=replace(now.action, stop=stop, pull=None))
    status = RunStatus.FLAT if stop.flat else RunStatus.STOPPED
    return ended(now, Mode.DONE, status, stop.reason, feedback)


def finished(
    now: SupervisorState, policy_state: PolicyState, outcome: str, reason: str, feedback: Feedback
) -> SupervisorState:
    """End the action and look again."""
    action = replace(
        now.action, outcome=outcome, reason=reason, policy_state=policy_state, ended=feedback.time
    )
    following = Action(look=action.look + 1, began=feedback.time, policy_state=policy_state)
    now = replace(now, policy_state=policy_state, action=following, finished=action, steps=())
    return entered(now, Mode.LOOK, feedback)
