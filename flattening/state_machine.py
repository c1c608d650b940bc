"""The state machine of the closed loop.

The next supervisor state from the present one and the station's feedback.
"""

import logging
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from unwrinkle.flattening import policy
from unwrinkle.flattening.execution import executor
from unwrinkle.flattening.execution.state import (
    ExecutionFeedback,
    OperatorWishes,
    Outcome,
    Phase,
)
from unwrinkle.flattening.flattener import NoChoice, Refusal, choose
from unwrinkle.flattening.messages import PlanRequest
from unwrinkle.flattening.state import (
    Feedback,
    Mode,
    RunStatus,
    SupervisorSettings,
    SupervisorState,
)
from unwrinkle.flattening.station_messages import HeadCommand
from unwrinkle.flattening.transitions import ended, entered, fault, finished, stopped
from unwrinkle.models.errors import InputError
from unwrinkle.models.scenario import LoopSettings
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.stereo.head import Gaze
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.verification.verdict import Verdict

#: Gaze at a point (3,) of the world with the turn-table at an angle (rad); InputError where no eye
#: can look there.
GazeAt = Callable[[np.ndarray, float], Gaze]
#: Asks the operator about a verified plan; returns why it must not be executed, or an empty text.
Approve = Callable[[FlatteningPlan, Verdict], str]

_log = logging.getLogger(__name__)


class StateMachine:
    """Look, perceive, decide, plan, confirm, carry out, and look again."""

    def __init__(
        self,
        rules: LoopSettings,
        settings: SupervisorSettings,
        gaze_at: GazeAt,
        approve: Approve | None = None,
    ) -> None:
        """Keep what does not change in a run.

        Args:
            rules: of the policy.
            settings: deadlines and tolerances.
            gaze_at: gaze of the head at a point.
            approve: asked about each verified plan before it is executed; None approves.
        """
        self._rules, self._settings, self._gaze_at = rules, settings, gaze_at
        self._approve = approve
        self._states = {
            Mode.LOOK: self._look,
            Mode.PERCEIVE: self._perceive,
            Mode.DECIDE: self._decide,
            Mode.PLAN: self._plan,
            Mode.CONFIRM: self._confirm,
            Mode.APPROVE: self._ask,
            Mode.HOLD: self._hold,
        }

    def next(self, now: SupervisorState, feedback: Feedback) -> SupervisorState:
        """Return the state one feedback period later; the same object where nothing has changed."""
        if now.over:
            return now
        if now.execution.running:
            return self._carry_out(now, feedback)
        if feedback.interrupted and now.mode != Mode.HOLD:
            return entered(now, Mode.HOLD, feedback)
        return self._states[now.mode](now, feedback)

    def _look(self, now: SupervisorState, feedback: Feedback) -> SupervisorState:
        if not now.sent:
            if not self._settings.execution.at_rest(_of_arms(feedback)):
                if feedback.time - now.since > self._settings.execution.rest:
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
            return entered(now, Mode.PERCEIVE, feedback)
        waited = feedback.time - now.since
        if waited > self._settings.look:
            return self._blind(now, feedback, f"no camera answered within {waited:.0f} s")
        return now

    def _perceive(self, now: SupervisorState, feedback: Feedback) -> SupervisorState:
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
        if analysed.observation is None:
            return self._blind(now, feedback, analysed.reason)
        observation = analysed.observation
        policy_state = policy.after_observation(now.policy_state, observation.features, self._rules)
        now = replace(
            now,
            policy_state=policy_state,
            centre=garment_centre(observation.analysis.range_map),
            action=replace(action, observation=observation),
            replans=0,
        )
        return entered(now, Mode.DECIDE, feedback)

    def _decide(self, now: SupervisorState, feedback: Feedback) -> SupervisorState:
        """Choose a wrinkle with a target, and request a plan for it."""
        observation = now.action.observation
        assert observation is not None
        chosen = choose(observation, now.policy_state, self._rules)
        refusals = (*now.action.refusals, *chosen.refusals)
        now = replace(now, policy_state=chosen.state, action=replace(now.action, refusals=refusals))
        if isinstance(chosen, NoChoice):
            return stopped(now, chosen.stop, feedback)
        decision = chosen.decision
        _log.info("wrinkle %d, %s", decision.wrinkle.index + 1, decision.arms)
        now = replace(now, action=replace(now.action, pull=decision))
        garment = observation.garment(decision.wrinkle.index)
        request = PlanRequest(0, chosen.target, decision.arms, garment=garment)
        return self._request(now, request, feedback)

    def _request(
        self, now: SupervisorState, request: PlanRequest, feedback: Feedback
    ) -> SupervisorState:
        """Send a request under a new number, from where the robot stands."""
        request = replace(request, number=now.request.number + 1, start=feedback.positions())
        return entered(replace(now, request=request), Mode.PLAN, feedback)

    def _plan(self, now: SupervisorState, feedback: Feedback) -> SupervisorState:
        planned = feedback.planned()
        if planned.number != now.request.number:
            return self._late(now, feedback, "planning")
        now = replace(now, action=replace(now.action, planned=planned))
        if planned.result is None or planned.result.plan is None:
            return self._refused(now, feedback, planned.reason)
        return entered(now, Mode.CONFIRM, feedback)

    def _confirm(self, now: SupervisorState, feedback: Feedback) -> SupervisorState:
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
        start = plan.segments[0].trajectory.positions[0]
        if not self._settings.execution.at(_of_arms(feedback), start):
            off = float(np.abs(feedback.positions() - start).max())
            if now.replans >= self._settings.replans:
                return fault(
                    now,
                    f"the robot is {off:.4f} rad off the start of the plan, after {now.replans} "
                    "new plans still; what moves it?",
                    feedback,
                )
            now = replace(now, replans=now.replans + 1)
            return self._request(now, now.request, feedback)
        if self._approve is not None and now.mode != Mode.APPROVE:
            return entered(now, Mode.APPROVE, feedback)
        return self._begin(now, feedback, plan)

    def _ask(self, now: SupervisorState, feedback: Feedback) -> SupervisorState:
        """Ask the operator about the verified plan; confirm it again after the answer."""
        planned, verified = now.action.planned, now.action.verified
        assert planned is not None and planned.result is not None and self._approve is not None
        assert verified is not None and verified.verdict is not None
        plan = planned.result.plan
        assert plan is not None
        refusal = self._approve(plan, verified.verdict)
        if refusal:
            return self._refused(now, feedback, f"not approved: {refusal}")
        return self._confirm(now, feedback)

    def _begin(
        self, now: SupervisorState, feedback: Feedback, plan: FlatteningPlan
    ) -> SupervisorState:
        """Enter the first step of a confirmed plan."""
        execution = executor.begin(now.execution, plan, feedback.time)
        return entered(replace(now, execution=execution), Mode.MOVE, feedback)

    def _carry_out(self, now: SupervisorState, feedback: Feedback) -> SupervisorState:
        """Step the executor; at its end, look again or end the run."""
        wishes = OperatorWishes(stop="interrupted" if feedback.interrupted else "")
        settings = self._settings.execution
        execution = executor.step(settings, now.execution, _of_arms(feedback), wishes)
        if execution is now.execution:
            return now
        if execution.records is not now.execution.records:
            now = replace(now, action=replace(now.action, steps=execution.records))
        now = replace(now, execution=execution)
        result = execution.result
        if result is None:
            stopping = execution.phase in (Phase.STOPPING, Phase.OPENING)
            mode = Mode.HOLD if stopping else Mode(execution.steps[0].kind)
            return now if mode == now.mode else entered(now, mode, feedback)
        if result.outcome == Outcome.FAILED:
            return fault(now, result.reason, feedback)
        if result.outcome == Outcome.STOPPED:
            return self._interrupted(now, feedback)
        action, missed = now.action, result.outcome == Outcome.MISSED
        assert action.pull is not None and action.observation is not None
        policy_state = policy.after_action(
            now.policy_state,
            action.pull,
            action.observation.features,
            self._rules,
            missed=missed,
        )
        return finished(now, policy_state, result.outcome, result.reason, feedback)

    def _refused(self, now: SupervisorState, feedback: Feedback, reason: str) -> SupervisorState:
        """Leave a wrinkle without a safe motion aside, and decide again."""
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
        policy_state = policy.after_refusal(now.policy_state, pull, reason)
        now = replace(now, action=action, policy_state=policy_state, replans=0)
        return entered(now, Mode.DECIDE, feedback)

    def _blind(self, now: SupervisorState, feedback: Feedback, reason: str) -> SupervisorState:
        perceived = now.action.perceived
        empty, unseen = (False, 0.0) if perceived is None else (perceived.empty, perceived.unseen)
        policy_state, stop = policy.after_blind_look(
            now.policy_state, reason, self._rules, empty=empty, unseen=unseen
        )
        now = replace(now, policy_state=policy_state)
        if stop is not None:
            return stopped(now, stop, feedback)
        return finished(now, policy_state, "blind", reason, feedback)

    def _late(self, now: SupervisorState, feedback: Feedback, who: str) -> SupervisorState:
        if feedback.time - now.since <= self._settings.answer:
            return now
        return fault(now, f"{who} did not answer within {self._settings.answer:g} s", feedback)

    def _hold(self, now: SupervisorState, feedback: Feedback) -> SupervisorState:
        """End an interrupted run once the arms are at rest; no motion is under way."""
        rests = self._settings.execution.at_rest(_of_arms(feedback))
        if not rests and feedback.time - now.since <= self._settings.execution.rest:
            return now
        return self._interrupted(now, feedback, rests=rests)

    def _interrupted(
        self, now: SupervisorState, feedback: Feedback, *, rests: bool = True
    ) -> SupervisorState:
        text = "the arms are at rest" if rests else "the arms did not come to rest in time"
        status, reason = RunStatus.INTERRUPTED, f"interrupted; {text}"
        return ended(now, Mode.DONE, status, reason, feedback)


def _of_arms(feedback: Feedback) -> ExecutionFeedback:
    """Return what the executor reads of the station."""
    return ExecutionFeedback(
        feedback.time,
        feedback.positions(),
        feedback.velocities(),
        feedback.controller(),
        feedback.grippers(),
    )


def garment_centre(range_map: RangeMap) -> tuple[float, float, float]:
    """Centroid (3,) of the garment in the world, on the table, m."""
    rows, columns = np.nonzero(range_map.garment)
    x, y = range_map.world_from_cell(np.array([columns.mean(), rows.mean()]))
    return float(x), float(y), range_map.table_height
