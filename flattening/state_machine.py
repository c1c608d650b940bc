"""The state machine of the loop, as a pure function: what follows from a situation and the station's feedback."""

import logging
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from unwrinkle.flattening import policy
from unwrinkle.flattening import state as states
from unwrinkle.flattening.execution import Execution
from unwrinkle.flattening.messages import PlanRequest
from unwrinkle.flattening.state import (
    Feedback,
    Refusal,
    Situation,
    SupervisorSettings,
)
from unwrinkle.flattening.station_messages import HeadCommand
from unwrinkle.flattening.transitions import at_rest, ended, entered, fault, finished, held, stopped
from unwrinkle.models.errors import InputError
from unwrinkle.models.scenario import LoopSettings
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.stereo.head import Gaze

#: Gaze at a point (3,) of the world with the turn-table at an angle (rad); InputError where no eye can look there.
GazeAt = Callable[[np.ndarray, float], Gaze]

_log = logging.getLogger(__name__)


class Procedure:
    """Look, perceive, decide, plan, confirm, carry out, and look again."""

    def __init__(self, rules: LoopSettings, settings: SupervisorSettings, gaze_at: GazeAt) -> None:
        """Take what does not change in a run.

        Args:
            rules: of the judgement.
            settings: deadlines and tolerances.
            gaze_at: where the head has to look to see a point.
        """
        self._rules, self._settings, self._gaze_at = rules, settings, gaze_at
        self._execution = Execution(settings)
        self._states = {
            states.LOOK: self._look,
            states.PERCEIVE: self._perceive,
            states.DECIDE: self._decide,
            states.PLAN: self._plan,
            states.CONFIRM: self._confirm,
            states.MOVE: self._carry_out,
            states.RETREAT: self._carry_out,
            states.GRIP: self._carry_out,
            states.HOLD: self._hold,
        }

    def next(self, now: Situation, feedback: Feedback) -> Situation:
        """Return the situation one feedback period on; the same object where nothing has changed."""
        if now.over:
            return now
        if feedback.interrupted and now.mode != states.HOLD:
            return self._interrupt(now, feedback)
        return self._states[now.mode](now, feedback)

    def _look(self, now: Situation, feedback: Feedback) -> Situation:
        if not now.sent:
            if not at_rest(feedback, self._settings):
                if feedback.time - now.since > self._settings.rest:
                    return fault(now, "the arms did not come to rest for a look", feedback)
                return now
            ext_axis = float(feedback.positions()[0])
            try:
                gaze = self._gaze_at(np.array(now.centre), ext_axis)
            except InputError as error:
                if now.head.number == 0:
                    return fault(now, f"nothing to look at: {error}", feedback)
                gaze = replace(now.head.gaze, ext_axis=ext_axis)
            head = HeadCommand(now.head.number + 1, gaze)
            return replace(now, head=head, sent=True, since=feedback.time)
        if feedback.exposed() == now.head.number:
            return entered(now, states.PERCEIVE, feedback)
        waited = feedback.time - now.since
        if waited > self._settings.look:
            return self._blind(now, feedback, f"no camera answered within {waited:.0f} s")
        return now

    def _perceive(self, now: Situation, feedback: Feedback) -> Situation:
        action = now.action
        if action.perceived is None:
            perceived = feedback.perceived()
            if perceived.number != now.head.number:
                return self._late(now, feedback, "perception")
            now = replace(now, action=replace(action, perceived=perceived), since=feedback.time)
            if perceived.range_map is None:
                reason = ("no garment on the table: " if perceived.empty else "") + perceived.reason
                return self._blind(now, feedback, reason)
            return now
        analysed = feedback.analysed()
        if analysed.number != now.head.number:
            return self._late(now, feedback, "the analysis")
        action = replace(action, analysed=analysed)
        now = replace(now, action=action)
        if analysed.analysis is None:
            return self._blind(now, feedback, analysed.reason)
        sight = policy.sight_of(analysed.analysis)
        memory = policy.looked(now.memory, sight, self._rules)
        centre = garment_centre(analysed.analysis.range_map)
        now = replace(
            now, memory=memory, centre=centre, action=replace(action, sight=sight), replans=0
        )
        return entered(now, states.DECIDE, feedback)

    def _decide(self, now: Situation, feedback: Feedback) -> Situation:
        assert now.action.sight is not None
        decision = policy.decide(now.action.sight, now.memory, self._rules)
        if isinstance(decision, policy.Stop):
            return stopped(now, decision, feedback)
        _log.info("wrinkle %d, %s", decision.wrinkle.index + 1, decision.arms)
        return self._request(replace(now, action=replace(now.action, pull=decision)), feedback)

    def _request(self, now: Situation, feedback: Feedback) -> Situation:
        pull = now.action.pull
        assert pull is not None
        request = PlanRequest(
            now.request.number + 1,
            now.action.look,
            pull.wrinkle.index,
            pull.arms,
            feedback.positions(),
        )
        return entered(replace(now, request=request), states.PLAN, feedback)

    def _plan(self, now: Situation, feedback: Feedback) -> Situation:
        planned = feedback.planned()
        if planned.number != now.request.number:
            return self._late(now, feedback, "planning")
        now = replace(now, action=replace(now.action, planned=planned))
        if planned.result is None or planned.result.plan is None:
            return self._refused(now, feedback, planned.reason)
        return entered(now, states.CONFIRM, feedback)

    def _confirm(self, now: Situation, feedback: Feedback) -> Situation:
        """Send nothing without a passing verdict on this very plan, from where the robot stands."""
        planned = now.action.planned
        assert planned is not None and planned.result is not None
        plan = planned.result.plan
        assert plan is not None
        verified = feedback.verified()
        if verified.number != now.request.number:
            return self._late(now, feedback, "verification")
        now = replace(now, action=replace(now.action, verified=verified))
        if verified.verdict is None:
            return self._refused(now, feedback, f"not verified: {verified.reason}")
        content = plan.content_hash
        for of in (verified.plan_hash, verified.verdict.plan_hash):
            if of != content:
                was = of[:12] or "(none)"
                reason = f"the verdict is of plan {was}, not of {content[:12]}; nothing was sent"
                return fault(now, reason, feedback)
        if not verified.verdict.passed:
            reason = f"not verified: {verified.verdict.violations[0].message}"
            return self._refused(now, feedback, reason)
        off = float(np.abs(feedback.positions() - plan.segments[0].trajectory.positions[0]).max())
        if off > self._settings.start:
            if now.replans >= self._settings.replans:
                return fault(
                    now,
                    f"the robot is {off:.4f} rad off the start of the plan, after {now.replans} "
                    "new plans still; what moves it?",
                    feedback,
                )
            return self._request(replace(now, replans=now.replans + 1), feedback)
        return self._execution.begin(now, feedback, plan)

    def _carry_out(self, now: Situation, feedback: Feedback) -> Situation:
        now = self._execution.next(now, feedback)
        if now.mode != states.LOOK:
            return now
        action = now.action
        assert action.pull is not None and action.sight is not None
        missed = action.outcome == "missed"
        memory = policy.carried_out(
            now.memory, action.pull, action.sight, self._rules, missed=missed
        )
        return finished(now, memory, action.outcome or "done", action.reason, feedback)

    def _refused(self, now: Situation, feedback: Feedback, reason: str) -> Situation:
        """Leave a wrinkle without a verified motion aside, and decide again."""
        pull = now.action.pull
        assert pull is not None
        _log.info("wrinkle %d, %s: %s", pull.wrinkle.index + 1, pull.arms, reason)
        refusal = Refusal(pull.wrinkle.index, pull.arms, reason)
        action = replace(
            now.action,
            refusals=(*now.action.refusals, refusal),
            pull=None,
            planned=None,
            verified=None,
        )
        memory = policy.unplannable(now.memory, pull, reason)
        now = replace(now, action=action, memory=memory, replans=0)
        return entered(now, states.DECIDE, feedback)

    def _blind(self, now: Situation, feedback: Feedback, reason: str) -> Situation:
        perceived = now.action.perceived
        empty, unseen = (False, 0.0) if perceived is None else (perceived.empty, perceived.unseen)
        memory, stop = policy.blinded(now.memory, reason, empty=empty, unseen=unseen)
        now = replace(now, memory=memory)
        if stop is not None:
            return stopped(now, stop, feedback)
        return finished(now, memory, "blind", reason, feedback)

    def _late(self, now: Situation, feedback: Feedback, who: str) -> Situation:
        if feedback.time - now.since <= self._settings.answer:
            return now
        return fault(now, f"{who} did not answer within {self._settings.answer:g} s", feedback)

    def _interrupt(self, now: Situation, feedback: Feedback) -> Situation:
        """Hold what moves; the rest of the action is dropped."""
        moved = now.moving
        return replace(entered(held(now), states.HOLD, feedback), sent=moved, steps=())

    def _hold(self, now: Situation, feedback: Feedback) -> Situation:
        waited = feedback.time - now.since
        least = self._settings.answer if now.sent else 0.0  # so long a hold may take to arrive
        if waited < least:
            return now
        reason = "interrupted; the arms are at rest"
        if not at_rest(feedback, self._settings):
            if waited < least + self._settings.rest:
                return now
            reason = "interrupted; the arms did not come to rest in time"
        return ended(now, states.DONE, states.INTERRUPTED, reason, feedback)


def garment_centre(range_map: RangeMap) -> tuple[float, float, float]:
    """Centroid (3,) of the garment in the world, on the table, m."""
    rows, columns = np.nonzero(range_map.garment)
    x, y = range_map.world_from_cell(np.array([columns.mean(), rows.mean()]))
    return float(x), float(y), range_map.table_height
