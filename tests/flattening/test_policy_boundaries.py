"""The policy at its thresholds, and the counts of its state."""

import dataclasses as dc
import math

import pytest

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
    decide,
)
from unwrinkle.models.scenario import LoopSettings
from unwrinkle.perception.folds.garment_state import GarmentState

RULES = LoopSettings(least_gain=0.5, halting_height=0.004)
A = WrinkleFeatures(0, (0.10, -1.1), 0.3, 50_000.0, 0.020, 0.012)
B = WrinkleFeatures(1, (-0.10, -1.1), 0.3, 20_000.0, 0.010, 0.008)
LOW = WrinkleFeatures(2, (0.0, -1.2), 1.0, 900.0, 0.001, 0.002)
BOTH = GarmentFeatures((A, B))
TRIED = AbandonedWrinkle(B.centre, B.angle, "dual", "no motion")


def _state(**changes: object) -> PolicyState:
    """Return a state after a pull of A, whose effect has not been observed."""
    last = LastAction(A.centre, A.angle, "dual", 50_000.0, 70_000.0)
    return dc.replace(PolicyState(last=last), **changes)


def _with_volumes(a: float, b: float) -> GarmentFeatures:
    return GarmentFeatures((dc.replace(A, volume=a), dc.replace(B, volume=b)))


def test_every_observation_counts_and_ends_a_blind_series() -> None:
    state = after_observation(PolicyState(looks=6, blind=1), BOTH, RULES)
    assert (state.looks, state.blind) == (7, 0)


@pytest.mark.parametrize(
    ("volumes", "effect"),
    [
        ((25_000.0, 24_000.0), True),  # the largest at the threshold
        ((25_001.0, 24_000.0), False),
        ((30_000.0, 5_000.0), True),  # the sum at the threshold
        ((30_000.0, 5_001.0), False),
    ],
)
def test_an_effect_is_a_loss_of_at_least_the_least_gain(
    volumes: tuple[float, float], effect: bool
) -> None:
    before = _state(idle=1, misses=1, tried=(TRIED,))
    after = after_observation(before, _with_volumes(*volumes), RULES)
    if effect:
        assert (after.idle, after.misses, after.tried) == (0, 0, ())
    else:
        assert after.idle == 2
        assert after.tried[0] == TRIED
        abandoned = after.tried[1]
        assert (abandoned.centre, abandoned.angle, abandoned.arms) == (A.centre, A.angle, "dual")
        assert "2 actions" in abandoned.reason


def test_idle_actions_before_the_threshold_abandon_nothing() -> None:
    assert after_observation(_state(), BOTH, RULES).tried == ()


@pytest.mark.parametrize(
    ("unseen", "told"), [(RULES.thickest_layer, False), (RULES.thickest_layer + 1e-6, True)]
)
def test_an_empty_table_may_be_flat_only_for_a_sensor_blind_to_a_layer(
    unseen: float, told: bool
) -> None:
    _, ended = after_blind_look(_state(blind=1), "no garment", RULES, empty=True, unseen=unseen)
    assert ended is not None and not ended.flat
    assert (ended.state is GarmentState.UNSEEN) is told


def test_an_empty_table_is_not_flat_where_the_sensor_is_not_said_to_be_blind() -> None:
    _, ended = after_blind_look(_state(blind=1), "no garment", RULES, empty=True)
    assert ended is not None and ended.flat is False


@pytest.mark.parametrize(
    ("change", "ends_flat"),
    [
        ({"beyond": RULES.most_beyond_table}, True),
        ({"beyond": RULES.most_beyond_table + 0.01}, False),
        ({"along_edge": RULES.most_along_edge}, True),
        ({"along_edge": RULES.most_along_edge + 0.01}, False),
    ],
)
def test_a_garment_off_the_table_is_not_flat(change: dict[str, float], ends_flat: bool) -> None:
    low = dc.replace(GarmentFeatures((LOW,)), **change)
    decision = decide(low, PolicyState(), RULES)
    assert isinstance(decision, Stop) and decision.flat is ends_flat
    wrinkled = decide(dc.replace(BOTH, **change), PolicyState(), RULES)
    if "along_edge" in change or ends_flat:
        assert isinstance(wrinkled, PullDecision)
    else:
        assert isinstance(wrinkled, Stop) and wrinkled.flat is False


def test_a_garment_without_a_wrinkle_is_flat() -> None:
    decision = decide(GarmentFeatures(()), PolicyState(), RULES)
    assert isinstance(decision, Stop) and decision.flat is True


@pytest.mark.parametrize(
    ("idle", "arms"),
    [(RULES.idle_one_arm - 1, "dual"), (RULES.idle_one_arm, "single"), (RULES.idle_stop, None)],
)
def test_idle_actions_lead_to_one_arm_and_to_the_end(idle: int, arms: str | None) -> None:
    decision = decide(BOTH, PolicyState(idle=idle), RULES)
    if arms is None:
        assert isinstance(decision, Stop) and decision.flat is False
    else:
        assert isinstance(decision, PullDecision) and decision.arms == arms


@pytest.mark.parametrize("state", [PolicyState(actions=RULES.actions), PolicyState(idle=99)])
def test_an_end_for_another_reason_is_not_flat(state: PolicyState) -> None:
    decision = decide(BOTH, state, RULES)
    assert isinstance(decision, Stop) and decision.flat is False


def test_no_motion_for_any_wrinkle_is_not_flat() -> None:
    tried = tuple(
        AbandonedWrinkle(each.centre, each.angle, arms, "no motion")
        for each in (A, B)
        for arms in ("dual", "single")
    )
    decision = decide(BOTH, PolicyState(tried=tried), RULES)
    assert isinstance(decision, Stop) and decision.flat is False


@pytest.mark.parametrize(
    ("aside", "turn", "same"),
    [
        (0.0, 0.0, True),
        (RULES.same_wrinkle_distance, 0.0, False),
        (RULES.same_wrinkle_distance - 1e-6, 0.0, True),
        (0.0, RULES.same_wrinkle_angle + 1e-9, False),
        (0.0, RULES.same_wrinkle_angle - 1e-9, True),
        (0.0, math.pi, True),  # an axis has no sign
        (0.0, math.pi - RULES.same_wrinkle_angle - 1e-9, False),
        (0.0, 0.5 * math.pi, False),
        (0.0, -0.5 * math.pi, False),
    ],
)
def test_a_wrinkle_is_the_same_within_a_distance_and_an_angle(
    aside: float, turn: float, same: bool
) -> None:
    place = dc.replace(A, centre=(0.0, 0.0), angle=0.0)
    tried = AbandonedWrinkle((aside, 0.0), turn, "dual", "no motion")
    decision = decide(GarmentFeatures((place,)), PolicyState(tried=(tried,)), RULES)
    assert isinstance(decision, PullDecision)
    assert decision.arms == ("single" if same else "dual")


@pytest.mark.parametrize(
    ("last", "misses"),
    [
        (LastAction(A.centre, A.angle, "dual", 5e4, 7e4, missed=True), 2),
        (LastAction(A.centre, A.angle, "dual", 5e4, 7e4, missed=False), 1),
        (LastAction(B.centre, B.angle, "dual", 5e4, 7e4, missed=True), 1),
        (None, 1),
    ],
)
def test_missed_grasps_in_a_row_count_at_one_wrinkle(last: LastAction | None, misses: int) -> None:
    rules = dc.replace(RULES, grasp_attempts=5)
    before = PolicyState(actions=3, misses=1, last=last)
    after = after_action(before, PullDecision(A, "dual"), BOTH, rules, missed=True)
    assert (after.misses, after.actions) == (misses, 4)
    assert after.last == LastAction(A.centre, A.angle, "dual", 5e4, 7e4, missed=True)
    held = after_action(before, PullDecision(A, "dual"), BOTH, rules, missed=False)
    assert held.misses == 0 and held.tried == ()


def test_the_last_missed_grasp_abandons_the_wrinkle_with_a_reason() -> None:
    before = PolicyState(misses=1, last=LastAction(A.centre, A.angle, "dual", 5e4, 7e4, True))
    after = after_action(before, PullDecision(A, "dual"), BOTH, RULES, missed=True)
    assert after.misses == 0
    (abandoned,) = after.tried
    assert (abandoned.centre, abandoned.arms) == (A.centre, "dual")
    assert "2 times" in abandoned.reason


def test_a_state_read_from_json_holds_floats() -> None:
    state = _state(tried=(TRIED,)).to_json()
    state["last"].update(angle=1, largest=2, total=3)
    state["tried"][0].update(angle=1)
    again = PolicyState.from_json(state)
    assert again.last is not None
    numbers = (again.last.angle, again.last.largest, again.last.total, again.tried[0].angle)
    assert numbers == (1.0, 2.0, 3.0, 1.0)
    assert all(type(number) is float for number in numbers)
