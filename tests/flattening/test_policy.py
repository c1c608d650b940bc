"""The loop's judgement, a pure function of what was seen and what is remembered."""

import dataclasses as dc
import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from unwrinkle.flattening.policy import (
    Memory,
    Pull,
    Pulled,
    SeenWrinkle,
    Sight,
    Stop,
    Tried,
    blinded,
    carried_out,
    decide,
    looked,
    unplannable,
)
from unwrinkle.models.errors import InputError
from unwrinkle.models.scenario import LoopSettings

RULES = LoopSettings(actions=10, arms="any", halting_height=0.004, least_gain=0.1, grasp_attempts=2)
A = SeenWrinkle(0, (0.10, -1.1), 0.3, 50_000.0, 0.020, 0.012)
B = SeenWrinkle(1, (-0.10, -1.1), 0.3, 20_000.0, 0.010, 0.008)
LOW = SeenWrinkle(2, (0.0, -1.2), 1.0, 900.0, 0.001, 0.002)
SIGHT = Sight((A, B, LOW))


def pull(sight: Sight, memory: Memory, rules: LoopSettings = RULES) -> tuple[int, str]:
    decision = decide(sight, memory, rules)
    assert isinstance(decision, Pull), decision
    return decision.wrinkle.index, decision.arms


def stop(sight: Sight, memory: Memory, rules: LoopSettings = RULES) -> Stop:
    decision = decide(sight, memory, rules)
    assert isinstance(decision, Stop), decision
    return decision


def acted(sight: Sight, memory: Memory, *, missed: bool = False) -> Memory:
    decision = decide(sight, memory, RULES)
    assert isinstance(decision, Pull), decision
    return carried_out(memory, decision, sight, RULES, missed=missed)


def test_largest_first_with_two_arms() -> None:
    assert pull(SIGHT, Memory()) == (0, "dual")
    assert pull(SIGHT, Memory(), dc.replace(RULES, arms="single")) == (0, "single")


@pytest.mark.parametrize(
    ("asks", "height", "flat"),
    [(0.0049, 0.0039, True), (0.005, 0.001, False), (0.001, 0.0041, False), (0.0, 0.004, True)],
)
def test_flat_needs_small_pulls_and_low_ridges(asks: float, height: float, flat: bool) -> None:
    sight = Sight((dc.replace(A, pull=asks, height=height),))
    decision = decide(sight, Memory(), RULES)
    assert (isinstance(decision, Stop) and decision.flat) == flat


def test_flat_before_the_action_limit() -> None:
    full = Memory(actions=10)
    assert stop(Sight((LOW,)), full).flat
    ended = stop(SIGHT, full)
    assert not ended.flat and "after 10 actions" in ended.reason and "20.0 mm" in ended.reason
    assert stop(SIGHT, Memory(), dc.replace(RULES, actions=0)).reason.startswith("not flat after 0")


def test_garment_beyond_the_table() -> None:
    assert "beyond the table" in stop(dc.replace(SIGHT, beyond=0.7), Memory()).reason


def test_no_motion_next_wrinkle_then_one_arm_then_the_reasons() -> None:
    memory, seen = Memory(), []
    for reason in ("far", "near", "far alone", "near alone"):
        decision = decide(SIGHT, memory, RULES)
        assert isinstance(decision, Pull)
        seen.append((decision.wrinkle.index, decision.arms))
        memory = unplannable(memory, decision, reason)
    assert seen == [(0, "dual"), (1, "dual"), (0, "single"), (1, "single")]
    assert all(word in stop(SIGHT, memory).reason for word in ("far", "near alone"))


def test_left_aside_counts_again_after_a_change() -> None:
    first = decide(SIGHT, Memory(), RULES)
    assert isinstance(first, Pull)
    memory = acted(SIGHT, unplannable(Memory(), first, "far"))
    changed = Sight((A, LOW))  # the largest is as it was, the other one went
    memory = looked(memory, changed, RULES)
    assert memory.tried == () and memory.idle == 0
    assert pull(changed, memory) == (0, "dual")


def test_a_wrinkle_that_moved_a_little_is_the_same() -> None:
    memory = Memory(tried=(Tried(A.centre, A.angle + 3.14159, "dual", "far"),))
    near = dc.replace(A, centre=(0.12, -1.08), angle=A.angle + 0.3)
    assert pull(Sight((near, B)), memory) == (1, "dual")
    turned = dc.replace(A, angle=A.angle + 1.2)
    assert pull(Sight((turned, B)), memory) == (0, "dual")


def test_two_idle_actions_next_a_third_one_arm_a_fourth_ends() -> None:
    memory, seen = Memory(), []
    for _ in range(4):
        seen.append(pull(SIGHT, memory))
        memory = looked(acted(SIGHT, memory), SIGHT, RULES)
    assert seen == [(0, "dual"), (0, "dual"), (1, "dual"), (0, "single")]
    assert "4 actions in a row changed nothing" in stop(SIGHT, memory).reason


def test_with_two_arms_only_a_third_idle_action_ends() -> None:
    rules, memory = dc.replace(RULES, arms="dual"), Memory()
    for _ in range(3):
        memory = looked(acted(SIGHT, memory), SIGHT, rules)
    assert "3 actions in a row" in stop(SIGHT, memory, rules).reason


def test_a_change_ends_the_count() -> None:
    memory = looked(acted(SIGHT, Memory()), SIGHT, RULES)
    assert memory.idle == 1
    smaller = Sight((dc.replace(A, volume=0.89 * A.volume), B, LOW))
    assert looked(acted(SIGHT, memory), smaller, RULES).idle == 0
    alike = Sight((dc.replace(A, volume=0.95 * A.volume), B, LOW))
    assert looked(acted(SIGHT, memory), alike, RULES).idle == 2


def test_low_wrinkles_come_and_go_without_a_change() -> None:
    many = Sight((A, *(dc.replace(LOW, index=k, volume=9_000.0) for k in range(1, 9))))
    memory = acted(many, Memory())
    assert looked(memory, Sight((A,)), RULES).idle == 1


def test_an_action_is_judged_once() -> None:
    memory = looked(acted(SIGHT, Memory()), SIGHT, RULES)
    assert looked(memory, SIGHT, RULES).idle == 1


def test_missed_grasps_are_no_idle_actions_and_end_at_their_number() -> None:
    memory = looked(acted(SIGHT, Memory(), missed=True), SIGHT, RULES)
    assert (memory.misses, memory.idle, memory.actions) == (1, 0, 1)
    assert pull(SIGHT, memory) == (0, "dual")
    memory = looked(acted(SIGHT, memory, missed=True), SIGHT, RULES)
    assert pull(SIGHT, memory) == (1, "dual") and memory.misses == 0


def test_nothing_seen_twice_ends() -> None:
    memory, ended = blinded(Memory(), "dark")
    assert ended is None and memory.looks == 1
    assert looked(memory, SIGHT, RULES).blind == 0
    memory, ended = blinded(memory, "dark")
    assert ended is not None and "2 looks: dark" in ended.reason


@pytest.mark.parametrize(
    ("unseen", "acted_before", "flat"),
    [(0.005, True, True), (0.005, False, False), (0.0012, True, False)],
)
def test_a_sensor_that_sees_no_single_layer(unseen: float, acted_before: bool, flat: bool) -> None:
    memory = acted(SIGHT, Memory()) if acted_before else Memory()
    memory, _ = blinded(memory, "no garment found", empty=True, unseen=unseen)
    _, ended = blinded(memory, "no garment found", empty=True, unseen=unseen)
    assert ended is not None and ended.flat == flat
    _, ended = blinded(memory, "the camera returned nothing", unseen=unseen)
    assert ended is not None and not ended.flat


_numbers = st.floats(-2.0, 2.0)
_places = st.tuples(_numbers, _numbers)
_arms = st.sampled_from(["dual", "single"])
_counts = st.integers(0, 20)
_memories = st.builds(
    Memory,
    looks=_counts,
    blind=_counts,
    actions=_counts,
    idle=_counts,
    misses=_counts,
    tried=st.lists(st.builds(Tried, _places, _numbers, _arms, st.text()), max_size=3).map(tuple),
    last=st.none()
    | st.builds(Pulled, _places, _numbers, _arms, _numbers, _numbers, st.booleans(), st.booleans()),
)


@given(_memories)
def test_memory_survives_json(memory: Memory) -> None:
    assert Memory.from_json(json.loads(json.dumps(memory.to_json()))) == memory


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
    with pytest.raises(InputError, match="memory is damaged"):
        Memory.from_json({**Memory().to_json(), **damage})
    with pytest.raises(InputError, match="memory is damaged"):
        Memory.from_json([damage])
