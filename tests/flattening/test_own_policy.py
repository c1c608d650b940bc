"""A policy of one's own decides in the place of the rules."""

import pytest

import unwrinkle as uw
from unwrinkle.flattening import policy
from unwrinkle.flattening.flattener import NoChoice, choose
from unwrinkle.flattening.observation import GarmentFeatures, WrinkleFeatures
from unwrinkle.flattening.policy import PolicyState, PullDecision, Stop
from unwrinkle.models.scenario import LoopSettings
from unwrinkle.perception.target import NoTarget

TOWEL = uw.model_file("captures/towel.npz")


class Longest:
    """The longest wrinkle that was not abandoned, with one arm."""

    def __init__(self) -> None:
        self.asked: list[PolicyState] = []

    def decide(
        self, features: GarmentFeatures, state: PolicyState, rules: LoopSettings
    ) -> PullDecision | Stop:
        self.asked.append(state)
        tried = {item.centre for item in state.tried}
        left = [each for each in features.wrinkles if each.centre not in tried]
        if not left:
            return Stop(False, "all were tried")
        return PullDecision(max(left, key=lambda each: each.length), "single")


class Stubborn(Longest):
    """The longest wrinkle, again and again."""

    def decide(
        self, features: GarmentFeatures, state: PolicyState, rules: LoopSettings
    ) -> PullDecision | Stop:
        return super().decide(features, PolicyState(), rules)


@pytest.fixture(scope="module")
def seen() -> uw.Observation:
    return uw.Flattener(uw.load_cell()).observe(uw.load_capture(TOWEL))


def test_its_wrinkle_is_planned_and_verified(seen: uw.Observation) -> None:
    proposal = uw.Flattener(uw.load_cell(), policy=Longest()).propose(seen)
    assert proposal.plan is not None and proposal.verdict is not None
    assert proposal.verdict.passed and not proposal.plan.dual
    chosen = proposal.choice.decision.wrinkle
    refused = {refusal.wrinkle for refusal in proposal.refusals}
    left = [each for each in seen.features.wrinkles if each.index not in refused]
    assert chosen.length == max(each.length for each in left)


class Unreachable:
    """An observation of two wrinkles without a target."""

    features = GarmentFeatures(
        tuple(WrinkleFeatures(k, (0.2 * k, -1.1), 0.0, 100.0 - k, 0.02, 0.01) for k in range(2))
    )

    class Analysis:
        def target_for(self, index: int) -> NoTarget:
            return NoTarget(f"no target {index}")

    analysis = Analysis()


def test_it_is_told_what_was_refused_and_its_reason_to_stop_is_the_answer() -> None:
    own = Longest()
    chosen = choose(Unreachable(), PolicyState(), LoopSettings(), by=own)
    assert isinstance(chosen, NoChoice) and chosen.stop == Stop(False, "all were tried")
    assert {refusal.wrinkle for refusal in chosen.refusals} == {0, 1}
    assert [len(state.tried) for state in own.asked] == [0, 1, 2]


def test_what_was_refused_is_not_tried_without_end() -> None:
    with pytest.raises(uw.InputError):
        choose(Unreachable(), PolicyState(), LoopSettings(), by=Stubborn())


def test_arms_that_the_caller_excludes_and_other_answers_are_refused(seen: uw.Observation) -> None:
    with pytest.raises(uw.InputError):
        uw.Flattener(uw.load_cell(), policy=Longest()).propose(seen, arms="dual")

    class Silent:
        def decide(self, *_: object) -> PullDecision:
            return None  # type: ignore[return-value]

    with pytest.raises(uw.InputError):
        uw.Flattener(uw.load_cell(), policy=Silent()).choose(seen)


@pytest.mark.parametrize("wrinkle", [1, None, "largest"])
def test_a_decision_on_what_is_no_wrinkle_is_refused(seen: uw.Observation, wrinkle: object) -> None:
    class Wrong:
        def decide(self, *_: object) -> PullDecision:
            return PullDecision(wrinkle, "dual")  # type: ignore[arg-type]

    with pytest.raises(uw.InputError, match=r"features\.wrinkles"):
        uw.Flattener(uw.load_cell(), policy=Wrong()).choose(seen)


@pytest.mark.parametrize("wrong", [object(), Longest, None])
def test_what_cannot_decide_is_refused_at_once(wrong: object) -> None:
    with pytest.raises(uw.InputError, match="decide"):
        uw.Flattener(uw.load_cell(), policy=wrong)  # type: ignore[arg-type]


def test_the_rules_are_the_policy_that_is_left_out(seen: uw.Observation) -> None:
    cell = uw.load_cell()
    left_out, given = (
        each.choose(seen) for each in (uw.Flattener(cell), uw.Flattener(cell, policy=policy))
    )
    assert left_out.state == given.state and type(left_out) is type(given)
