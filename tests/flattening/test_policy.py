"""The loop's judgement, a pure function of what was seen and what is remembered."""

import dataclasses as dc
import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from unwrinkle.flattening.observation import GarmentFeatures, WrinkleFeatures
from unwrinkle.flattening.policy import (
    AbandonedWrinkle,
    LastAction,
    PolicyState,
    PullDecision,
    Stop,
    after_action,
    after_blind_look,
    after_observation,
    after_refusal,
    decide,
)
from unwrinkle.models.errors import InputError
from unwrinkle.models.scenario import LoopSettings
from unwrinkle.perception.folds.garment_state import GarmentState

RULES = LoopSettings(actions=10, arms="any", halting_height=0.004, least_gain=0.1, grasp_attempts=2)
A = WrinkleFeatures(0, (0.10, -1.1), 0.3, 50_000.0, 0.020, 0.012)
B = WrinkleFeatures(1, (-0.10, -1.1), 0.3, 20_000.0, 0.010, 0.008)
LOW = WrinkleFeatures(2, (0.0, -1.2), 1.0, 900.0, 0.001, 0.002)
SIGHT = GarmentFeatures((A, B, LOW))


def pull(
    sight: GarmentFeatures, memory: PolicyState, rules: LoopSettings = RULES
) -> tuple[int, str]:
    decision = decide(sight, memory, rules)
    assert isinstance(decision, PullDecision), decision
    return decision.wrinkle.index, decision.arms


def stop(sight: GarmentFeatures, memory: PolicyState, rules: LoopSettings = RULES) -> Stop:
    decision = decide(sight, memory, rules)
    assert isinstance(decision, Stop), decision
    return decision


def acted(sight: GarmentFeatures, memory: PolicyState, *, missed: bool = False) -> PolicyState:
    decision = decide(sight, memory, RULES)
    assert isinstance(decision, PullDecision), decision
    return after_action(memory, decision, sight, RULES, missed=missed)


def test_largest_first_with_two_arms() -> None:
    assert pull(SIGHT, PolicyState()) == (0, "dual")
    assert pull(SIGHT, PolicyState(), dc.replace(RULES, arms="single")) == (0, "single")


@pytest.mark.parametrize(
    ("asks", "height", "flat"),
    [(0.0049, 0.0039, True), (0.005, 0.001, False), (0.001, 0.0041, False), (0.0, 0.004, True)],
)
def test_flat_needs_small_pulls_and_low_ridges(asks: float, height: float, flat: bool) -> None:
    sight = GarmentFeatures((dc.replace(A, pull=asks, height=height),))
    decision = decide(sight, PolicyState(), RULES)
    assert (isinstance(decision, Stop) and decision.flat) == flat


def test_flat_before_the_action_limit() -> None:
    full = PolicyState(actions=10)
    assert stop(GarmentFeatures((LOW,)), full).flat
    ended = stop(SIGHT, full)
    assert not ended.flat and "after 10 actions" in ended.reason and "20.0 mm" in ended.reason
    assert stop(SIGHT, PolicyState(), dc.replace(RULES, actions=0)).reason.startswith(
        "not flat after 0"
    )


def test_garment_beyond_the_table() -> None:
    assert "beyond the table" in stop(dc.replace(SIGHT, beyond=0.7), PolicyState()).reason


def test_no_motion_next_wrinkle_then_one_arm_then_the_reasons() -> None:
    memory, seen = PolicyState(), []
    for reason in ("far", "near", "far alone", "near alone"):
        decision = decide(SIGHT, memory, RULES)
        assert isinstance(decision, PullDecision)
        seen.append((decision.wrinkle.index, decision.arms))
        memory = after_refusal(memory, decision, reason)
    assert seen == [(0, "dual"), (1, "dual"), (0, "single"), (1, "single")]
    assert all(word in stop(SIGHT, memory).reason for word in ("far", "near alone"))


def test_left_aside_counts_again_after_a_change() -> None:
    first = decide(SIGHT, PolicyState(), RULES)
    assert isinstance(first, PullDecision)
    memory = acted(SIGHT, after_refusal(PolicyState(), first, "far"))
    changed = GarmentFeatures((A, LOW))  # the largest is as it was, the other one went
    memory = after_observation(memory, changed, RULES)
    assert memory.tried == () and memory.idle == 0
    assert pull(changed, memory) == (0, "dual")


def test_a_wrinkle_that_moved_a_little_is_the_same() -> None:
    memory = PolicyState(tried=(AbandonedWrinkle(A.centre, A.angle + 3.14159, "dual", "far"),))
    near = dc.replace(A, centre=(0.12, -1.08), angle=A.angle + 0.3)
    assert pull(GarmentFeatures((near, B)), memory) == (1, "dual")
    turned = dc.replace(A, angle=A.angle + 1.2)
    assert pull(GarmentFeatures((turned, B)), memory) == (0, "dual")


def test_two_idle_actions_next_a_third_one_arm_a_fourth_ends() -> None:
    memory, seen = PolicyState(), []
    for _ in range(4):
        seen.append(pull(SIGHT, memory))
        memory = after_observation(acted(SIGHT, memory), SIGHT, RULES)
    assert seen == [(0, "dual"), (0, "dual"), (1, "dual"), (0, "single")]
    assert "4 actions in a row changed nothing" in stop(SIGHT, memory).reason


def test_with_two_arms_only_a_third_idle_action_ends() -> None:
    rules, memory = dc.replace(RULES, arms="dual"), PolicyState()
    for _ in range(3):
        memory = after_observation(acted(SIGHT, memory), SIGHT, rules)
    assert "3 actions in a row" in stop(SIGHT, memory, rules).reason


def test_a_change_ends_the_count() -> None:
    memory = after_observation(acted(SIGHT, PolicyState()), SIGHT, RULES)
    assert memory.idle == 1
    smaller = GarmentFeatures((dc.replace(A, volume=0.89 * A.volume), B, LOW))
    assert after_observation(acted(SIGHT, memory), smaller, RULES).idle == 0
    alike = GarmentFeatures((dc.replace(A, volume=0.95 * A.volume), B, LOW))
    assert after_observation(acted(SIGHT, memory), alike, RULES).idle == 2


def test_low_wrinkles_come_and_go_without_a_change() -> None:
    many = GarmentFeatures((A, *(dc.replace(LOW, index=k, volume=9_000.0) for k in range(1, 9))))
    memory = acted(many, PolicyState())
    assert after_observation(memory, GarmentFeatures((A,)), RULES).idle == 1


def test_an_action_is_judged_once() -> None:
    memory = after_observation(acted(SIGHT, PolicyState()), SIGHT, RULES)
    assert after_observation(memory, SIGHT, RULES).idle == 1


def test_missed_grasps_are_no_idle_actions_and_end_at_their_number() -> None:
    memory = after_observation(acted(SIGHT, PolicyState(), missed=True), SIGHT, RULES)
    assert (memory.misses, memory.idle, memory.actions) == (1, 0, 1)
    assert pull(SIGHT, memory) == (0, "dual")
    memory = after_observation(acted(SIGHT, memory, missed=True), SIGHT, RULES)
    assert pull(SIGHT, memory) == (1, "dual") and memory.misses == 0


def test_nothing_seen_twice_ends() -> None:
    memory, ended = after_blind_look(PolicyState(), "dark", RULES)
    assert ended is None and memory.looks == 1
    assert after_observation(memory, SIGHT, RULES).blind == 0
    memory, ended = after_blind_look(memory, "dark", RULES)
    assert ended is not None and "2 looks: dark" in ended.reason


@pytest.mark.parametrize(
    ("unseen", "acted_before", "told"),
    [(0.005, True, True), (0.005, False, False), (0.0012, True, False)],
)
def test_a_sensor_that_sees_no_single_layer(unseen: float, acted_before: bool, told: bool) -> None:
    memory = acted(SIGHT, PolicyState()) if acted_before else PolicyState()
    memory, _ = after_blind_look(memory, "no garment found", RULES, empty=True, unseen=unseen)
    _, ended = after_blind_look(memory, "no garment found", RULES, empty=True, unseen=unseen)
    assert ended is not None and not ended.flat
    assert (ended.state is GarmentState.UNSEEN) == told
    _, ended = after_blind_look(memory, "the camera returned nothing", RULES, unseen=unseen)
    assert ended is not None and not ended.flat


_numbers = st.floats(-2.0, 2.0)
_places = st.tuples(_numbers, _numbers)
_arms = st.sampled_from(["dual", "single"])
_counts = st.integers(0, 20)
_memories = st.builds(
    PolicyState,
    looks=_counts,
    blind=_counts,
    actions=_counts,
    idle=_counts,
    misses=_counts,
    tried=st.lists(
        st.builds(AbandonedWrinkle, _places, _numbers, _arms, st.text()), max_size=3
    ).map(tuple),
    last=st.none()
    | st.builds(
        LastAction, _places, _numbers, _arms, _numbers, _numbers, st.booleans(), st.booleans()
    ),
)


@given(_memories)
def test_memory_survives_json(memory: PolicyState) -> None:
    assert PolicyState.from_json(json.loads(json.dumps(memory.to_json()))) == memory


@pytest.mark.parametrize(
    "damage",
    [
        {"looks": -1},
        {"looks": None},
        {"tried": [{"centre": [0, 0]}]},
        {"last": {"centre": [0, float("nan")], "angle": 0, "arms": "dual"}},
        {"more": 1},
    ],
)
def test_damaged_memory_is_refused(damage: dict[str, Any]) -> None:
    with pytest.raises(InputError, match="policy is damaged"):
        PolicyState.from_json({**PolicyState().to_json(), **damage})
    with pytest.raises(InputError, match="policy is damaged"):
        PolicyState.from_json([damage])
