"""Transitions that every part of the state machine shares."""

import logging
from dataclasses import replace

import numpy as np

from unwrinkle.flattening import state as states
from unwrinkle.flattening.policy import Memory, Stop
from unwrinkle.flattening.state import Action, Feedback, Situation, SupervisorSettings
from unwrinkle.flattening.station_messages import TrajectoryCommand

_log = logging.getLogger(__name__)


def at_rest(feedback: Feedback, settings: SupervisorSettings) -> bool:
    """Whether every axis is slower than the settings call rest."""
    return bool(np.abs(feedback.velocities()).max() < settings.rest_speed)


def entered(now: Situation, mode: str, feedback: Feedback) -> Situation:
    """A state begins; its command is not given yet."""
    return replace(now, mode=mode, since=feedback.time, sent=False)


def held(now: Situation) -> Situation:
    """Command a hold if a motion may be under way."""
    if not now.moving:
        return now
    return replace(now, trajectory=TrajectoryCommand(now.trajectory.number + 1, None, "hold"))


def ended(now: Situation, mode: str, status: str, reason: str, feedback: Feedback) -> Situation:
    """The run ends, and with it the action."""
    action = replace(
        now.action,
        outcome=now.action.outcome or status,
        reason=now.action.reason or reason,
        memory=now.memory,
        ended=feedback.time,
    )
    now = replace(now, status=status, reason=reason, action=action, steps=())
    return entered(now, mode, feedback)


def fault(now: Situation, reason: str, feedback: Feedback) -> Situation:
    """A fault latches; what moves is held."""
    _log.error(reason)
    return ended(held(now), states.FAULT, states.FAULTED, reason, feedback)


def stopped(now: Situation, stop: Stop, feedback: Feedback) -> Situation:
    """The judgement ends the run."""
    now = replace(now, action=replace(now.action, stop=stop, pull=None))
    status = states.FLAT if stop.flat else states.STOPPED
    return ended(now, states.DONE, status, stop.reason, feedback)


def finished(
    now: Situation, memory: Memory, outcome: str, reason: str, feedback: Feedback
) -> Situation:
    """An action ends; look again."""
    action = replace(now.action, outcome=outcome, reason=reason, memory=memory, ended=feedback.time)
    following = Action(look=action.look + 1, began=feedback.time, memory=memory)
    now = replace(now, memory=memory, action=following, finished=action, steps=())
    return entered(now, states.LOOK, feedback)
