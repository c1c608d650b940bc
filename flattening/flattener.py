"""The pipeline as one object.

Capture to observation, observation to a verified plan or the reason why there is none.
"""

import dataclasses as dc
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from unwrinkle.flattening import policy
from unwrinkle.flattening.capture_to_observation import StereoCapture, map_of, observation_of
from unwrinkle.flattening.observation import Observation, WrinkleFeatures
from unwrinkle.flattening.policy import Policy, PolicyState, PullDecision, Stop
from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell
from unwrinkle.models.scenario import LoopSettings
from unwrinkle.models.shared import Shared
from unwrinkle.perception.depth.capture import Capture
from unwrinkle.perception.folds.garment_state import GarmentState
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.sensor import NoiseProfile
from unwrinkle.perception.target import FlatteningTarget, NoTarget
from unwrinkle.planning.plan import FlatteningPlan, GarmentSurface
from unwrinkle.planning.verification.verdict import Verdict

if TYPE_CHECKING:
    from unwrinkle.flattening.verified_planning import VerifiedResult
    from unwrinkle.planning.search.planner import FlatteningPlanner
    from unwrinkle.planning.search.settings import PlannerSettings

#: Greatest difference of the table that is seen from the cell's at which a plan is made, m; a grasp
#: that is further above the table is refused by the verification.
_TABLE_TOLERANCE = 8e-3


@dataclass(frozen=True)
class Refusal(Shared):
    """A wrinkle that could not be pulled.

    Attributes:
        wrinkle: index in the analysis, largest first.
        arms: `dual` or `single`.
        reason: why there is no target, or no verified motion.
    """

    wrinkle: int
    arms: str
    reason: str


@dataclass(frozen=True, eq=False)
class Choice(Shared):
    """The wrinkle to pull next, and how.

    Attributes:
        decision: of the policy.
        target: for the hands.
        state: of the policy, with the wrinkles abandoned on the way.
        refusals: wrinkles that came first but have no target.
    """

    decision: PullDecision
    target: FlatteningTarget
    state: PolicyState
    refusals: tuple[Refusal, ...] = ()


@dataclass(frozen=True, eq=False)
class NoChoice(Shared):
    """Nothing is to be pulled.

    Attributes:
        stop: why.
        state: of the policy, with the wrinkles abandoned on the way.
        refusals: wrinkles without a target.
    """

    stop: Stop
    state: PolicyState
    refusals: tuple[Refusal, ...] = ()


@dataclass(frozen=True, eq=False)
class Proposal:
    """A motion to execute.

    Attributes:
        plan: that passed its verification.
        verdict: of the plan.
        choice: wrinkle and target of the plan.
        planned: answer of planner and verification, with timings and refused plans.
        refusals: wrinkles that came first but could not be pulled, in order.
    """

    plan: FlatteningPlan
    verdict: Verdict
    choice: Choice
    planned: "VerifiedResult"
    refusals: tuple[Refusal, ...] = ()

    @property
    def refused(self) -> tuple[str, ...]:
        """Texts of the refusals, each once."""
        return _texts(self.refusals)


@dataclass(frozen=True, eq=False)
class NoProposal:
    """Nothing to execute: the garment is flat, or nothing can be done.

    Attributes:
        stop: why.
        refusals: wrinkles that could not be pulled, in order.
        state: of the policy, with the abandoned wrinkles.
        plan, verdict: None.
    """

    stop: Stop
    refusals: tuple[Refusal, ...] = ()
    state: PolicyState = dc.field(default_factory=PolicyState)
    plan: None = dc.field(default=None, init=False)
    verdict: None = dc.field(default=None, init=False)

    @property
    def flat(self) -> bool:
        """Whether the garment is flat."""
        return self.stop.flat

    @property
    def refused(self) -> tuple[str, ...]:
        """Texts of the refusals, each once."""
        return _texts(self.refusals)

    @property
    def reason(self) -> str:
        """Why there is no plan."""
        return self.stop.reason if self.flat or not self.refusals else "; ".join(self.refused)


def _texts(refusals: tuple[Refusal, ...]) -> tuple[str, ...]:
    """Return wrinkles and reasons; a reason for both numbers of arms stands once."""
    return tuple(dict.fromkeys(f"wrinkle {item.wrinkle + 1}: {item.reason}" for item in refusals))


def choose(
    observation: Observation,
    state: PolicyState,
    rules: LoopSettings,
    *,
    by: Policy = policy,
    refused: tuple[Refusal, ...] = (),
) -> Choice | NoChoice:
    """Choose the next wrinkle that has a target; wrinkles without one are abandoned.

    Args:
        observation: of the garment.
        state: of the policy.
        rules: of the closed loop.
        by: policy that decides; the one of `unwrinkle.flattening.policy` if left out.
        refused: wrinkles of this observation that were refused before.

    Raises:
        InputError: the policy chose what was refused, or no wrinkle of the observation; or it
            calls a garment flat that is not.
    """
    refusals: list[Refusal] = []
    while True:
        decision = by.decide(observation.features, state, rules)
        if isinstance(decision, Stop):
            _check_stop(decision, observation)
            return NoChoice(decision, state, tuple(refusals))
        _check_decision(decision, observation, rules, (*refused, *refusals))
        target = target_for(observation, decision, rules)
        if isinstance(target, FlatteningTarget):
            return Choice(decision, target, state, tuple(refusals))
        refusals.append(Refusal(decision.wrinkle.index, decision.arms, target.reason))
        state = policy.after_refusal(state, decision, target.reason)


def target_for(
    observation: Observation, decision: PullDecision, rules: LoopSettings
) -> FlatteningTarget | NoTarget:
    """Compute the hands' target of a decision.

    Eq. 5's pull, increased by the gain and the extra of the rules.
    """
    try:
        target = observation.analysis.target_for(decision.wrinkle.index)
        if isinstance(target, NoTarget):
            return target
        return target.pulled_further(rules.pull_gain, rules.pull_extra)
    except InputError as error:
        return NoTarget(" ".join(str(error).split()))


def analysis_report(
    observation: Observation,
    *,
    target: FlatteningTarget | None = None,
    wrinkle: int | None = None,
    stop: Stop | None = None,
    points: bool = False,
) -> dict[str, Any]:
    """Return an observation and what was decided on it as plain data.

    Args:
        observation: of the garment.
        target, wrinkle: that was chosen, and the index of its wrinkle.
        stop: decision to stop.
        points: include the wrinkles' point lists.
    """
    report = observation.analysis.to_json(points=points)
    for wrinkle_report, kind in zip(report["wrinkles"], observation.folds.kinds, strict=True):
        wrinkle_report["kind"] = kind.value
    report["garment"] = {
        **observation.folds.to_json(),
        "table_height": observation.analysis.range_map.table_height,
    }
    report["flat"] = stop is not None and stop.flat
    if target is not None:
        report["target"] = {**target.to_json(), "wrinkle": wrinkle}
    elif stop is not None:
        report["target"] = {"none": stop.reason, "flat": stop.flat}
    return report


class Flattener:
    """Observes a garment and proposes what to do about it, by the rules of the cell's scenario.

    The command line, the closed loop and the benchmarks call it; so a proposal for a capture is the
    motion that the closed loop would execute after that look.
    """

    def __init__(
        self,
        cell: Cell,
        *,
        rules: LoopSettings | None = None,
        profile: NoiseProfile | None = None,
        settings: "PlannerSettings | None" = None,
        policy: Policy = policy,
    ) -> None:
        """Keep the cell; the planner's models are built when the first plan is asked for (about a
        second).

        Args:
            cell: the robot in its cell.
            rules: of the closed loop; the scenario's `loop` if left out.
            profile: of the sensor's noise; None for each capture's own.
            settings: of the planner.
            policy: that decides which wrinkle is pulled next; by the rules if left out.
        """
        _check_type(cell, Cell, "Flattener", "a cell, as `load_cell` returns it")
        self.cell = cell
        if isinstance(policy, type) or not callable(getattr(policy, "decide", None)):
            given = policy.__name__ if isinstance(policy, type) else type(policy).__name__
            raise InputError(
                f"Flattener: the policy {given} cannot be asked; give an object with the method "
                "`decide(features, state, rules)`"
            )
        self.rules = cell.scenario.loop if rules is None else rules
        self._profile, self._settings, self._policy = profile, settings, policy

    @cached_property
    def planner(self) -> "FlatteningPlanner":
        """The planner, with its models of the cell."""
        from unwrinkle.planning.search.planner import FlatteningPlanner  # slow to import

        return FlatteningPlanner(self.cell, self._settings)

    def observe(
        self, capture: Capture | StereoCapture | RangeMap, *, yaw: float = 0.0, seed: int = 0
    ) -> Observation:
        """Find the garment and its wrinkles.

        Args:
            capture: depth image, pair of images, or a range map made of either.
            yaw: turn of a garment without a camera pose about the vertical, rad.
            seed: of perception's random choices.

        Raises:
            InputError: there is no garment, or not enough of it in view.
        """
        if not isinstance(capture, RangeMap):
            wanted = (
                "a capture, as `load_capture` or `load_stereo_capture` returns it, or a range map"
            )
            _check_type(capture, (Capture, StereoCapture), "observe", wanted)
            capture = map_of(capture, self.cell, profile=self._profile, yaw=yaw, seed=seed)
        return observation_of(capture, self.cell, rules=self.rules, profile=self._profile)

    def choose(
        self, observation: Observation, state: PolicyState | None = None
    ) -> Choice | NoChoice:
        """Choose the next wrinkle that has a target, without planning; see `choose`."""
        return choose(observation, state or PolicyState(), self.rules, by=self._policy)

    def plan(
        self,
        target: FlatteningTarget,
        *,
        start: Array | None = None,
        arms: str = "any",
        garment: GarmentSurface | None = None,
    ) -> "VerifiedResult":
        """Plan a motion for a target that passes its verification; see `plan_verified`."""
        from unwrinkle.flattening.verified_planning import plan_verified  # slow to import

        _check_type(target, FlatteningTarget, "plan", "a `FlatteningTarget`")
        return plan_verified(
            self.planner, self.cell, target, start=start, garment=garment, arms=arms
        )

    def propose(
        self,
        observation: Observation,
        *,
        start: Array | str | None = None,
        arms: str | None = None,
        state: PolicyState | None = None,
    ) -> Proposal | NoProposal:
        """Plan and verify a motion for the first wrinkle that has one.

        Args:
            observation: of the garment.
            start: configuration (axes,) that the robot rests in, rad, or the name of one of the
                robot's states; home if left out.
            arms: `any`, `dual` or `single`; the rules' own if left out.
            state: of the policy after earlier looks and actions.

        Raises:
            InputError: the start is no configuration, `arms` is none of the three, the garment
                lies on a table of another height than the cell's, or the policy chose what was
                refused.
        """
        _check_type(observation, Observation, "propose", "an observation, as `observe` returns it")
        if isinstance(start, str):
            if start not in self.cell.robot.named_states:
                known = ", ".join(self.cell.robot.named_states)
                raise InputError(f"start {start!r} is no state of the robot; known: {known}")
            start = np.array(self.cell.robot.named_states[start], dtype=float)
        rules = self.rules
        if arms is not None:
            if arms not in policy.ARMS:
                raise InputError(f"arms must be one of {', '.join(policy.ARMS)}, got {arms!r}")
            rules = dc.replace(rules, arms=arms)
        _check_table(observation, self.cell)
        state = state or PolicyState()
        refusals: tuple[Refusal, ...] = ()
        while True:
            choice = choose(observation, state, rules, by=self._policy, refused=refusals)
            refusals += choice.refusals
            if isinstance(choice, NoChoice):
                return NoProposal(choice.stop, refusals, choice.state)
            decision = choice.decision
            garment = observation.garment(decision.wrinkle.index)
            found = self.plan(choice.target, start=start, arms=decision.arms, garment=garment)
            if found.plan is not None and found.verdict is not None:
                return Proposal(found.plan, found.verdict, choice, found, refusals)
            reason = found.reason
            refusals += (Refusal(decision.wrinkle.index, decision.arms, reason),)
            state = policy.after_refusal(choice.state, decision, reason)


def _check_table(observation: Observation, cell: Cell) -> None:
    """Refuse a garment that lies above or below the cell's table.

    Raises:
        InputError: with both heights.
    """
    seen, own = observation.analysis.range_map.table_height, cell.table.height
    if not abs(seen - own) <= _TABLE_TOLERANCE:
        side = "above" if seen > own else "below"
        raise InputError(
            f"the table is seen {1e3 * abs(seen - own):.0f} mm {side} the cell's (at {seen:.3f} m, "
            f"the cell's at {own:.3f} m): check the camera's pose (the camera in the world, in "
            "metres), or the table of the scenario"
        )


def _check_stop(stop: Stop, observation: Observation) -> None:
    """Refuse to call a garment flat that is not.

    Raises:
        InputError: with the state of the garment.
    """
    features = observation.features
    if stop.flat and features.state is not GarmentState.FLAT:
        raise InputError(
            f"policy: calls the garment flat, which is {features.state} "
            f"({'; '.join(features.reasons)}); ask `features.state`"
        )


def _check_decision(
    decision: PullDecision,
    observation: Observation,
    rules: LoopSettings,
    refused: tuple[Refusal, ...],
) -> None:
    """Refuse a decision that cannot be carried out, or that would be refused again without end.

    Raises:
        InputError: naming the wrinkle and the arms.
    """
    if not isinstance(decision, PullDecision):
        raise InputError(
            f"policy: decided {type(decision).__name__}; give a `PullDecision` or a `Stop`"
        )
    wrinkle, arms = decision.wrinkle, decision.arms
    if wrinkle not in observation.features.wrinkles or arms not in policy.ARMS[rules.arms]:
        what = f"wrinkle {wrinkle.index + 1}" if isinstance(wrinkle, WrinkleFeatures) else wrinkle
        raise InputError(
            f"policy: decided {what!r} with arms {arms!r}; give a wrinkle of "
            f"`features.wrinkles`, and {' or '.join(policy.ARMS[rules.arms])}"
        )
    for refusal in refused:
        if (refusal.wrinkle, refusal.arms) == (wrinkle.index, arms):
            raise InputError(
                f"policy: decided wrinkle {wrinkle.index + 1} with arms {arms!r} again, which was "
                f"refused ({refusal.reason}); leave out what `state.tried` holds"
            )


def _check_type(value: object, kinds: type | tuple[type, ...], where: str, wanted: str) -> None:
    """Refuse an argument of another type.

    Raises:
        InputError: naming what was given and what is wanted.
    """
    if not isinstance(value, kinds):
        raise InputError(f"{where}: got {type(value).__name__}; give {wanted}")
