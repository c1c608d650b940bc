"""Transitions between states that all parts of the state machine share."""

import logging
from dataclasses import replace

from unwrinkle.flattening.policy import PolicyState, Stop
from unwrinkle.flattening.state import Action, Feedback, Mode, RunStatus, SupervisorState

_log = logging.getLogger(__name__)


def entered(now: SupervisorState, mode: Mode, feedback: Feedback) -> SupervisorState:
    """Enter `mode`; its command has not been sent."""
    return replace(now, mode=mode, since=feedback.time, sent=False)


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
    now = replace(now, status=status, reason=reason, action=action)
    return entered(now, mode, feedback)


def fault(now: SupervisorState, reason: str, feedback: Feedback) -> SupervisorState:
    """Enter the fault state, which has no exit; the arms are at rest."""
    _log.error(reason)
    return ended(now, Mode.FAULT, RunStatus.FAULTED, reason, feedback)


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
    now = replace(now, policy_state=policy_state, action=following, finished=action)
    return entered(now, Mode.LOOK, feedback)
