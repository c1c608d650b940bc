import json

import numpy as np
import pytest

from unwrinkle.models.errors import InputError
from unwrinkle.perception.target import (
    STRETCH_LIMIT,
    STRETCH_MARGIN,
    FlatteningTarget,
    HandTarget,
)


def hand(sign=1.0, pull=0.01, **changes):
    fields = {
        "p_WG": [0.0, -1.1 + sign * 0.2, 0.7],
        "grasp_direction": [0.0, -sign],
        "pull_direction": [0.0, sign],
        "pull_distance": pull,
    }
    return HandTarget(**{**fields, **changes})


def target(**changes):
    fields = {
        "hands": (hand(-1.0), hand(1.0)),
        "p_WC": [0.0, -1.1, 0.72],
        "wrinkle_direction": [1.0, 0.0],
        "geodesic_distance": 0.42,
        "mode": "foot",
    }
    return FlatteningTarget(**{**fields, **changes})


def test_json_round_trip():
    first = target()
    again = FlatteningTarget.from_json(json.loads(json.dumps(first.to_json())))
    assert again.to_json() == first.to_json()
    assert not again.hands[0].p_WG.flags.writeable


@pytest.mark.parametrize(
    "changes",
    [
        {"grasp_direction": [0.0, 0.5]},
        {"pull_direction": [0.0, 0.0]},
        {"pull_distance": -0.001},
        {"pull_distance": float("nan")},
        {"p_WG": [0.0, float("inf"), 0.7]},
        {"p_WG": [0.0, 0.0]},
    ],
)
def test_a_hand_that_no_planner_may_see_is_refused(changes):
    with pytest.raises(InputError):
        hand(**changes)


@pytest.mark.parametrize(
    "changes",
    [
        {"mode": "feet"},
        {"geodesic_distance": 0.0},
        {"wrinkle_direction": [1.0, 1.0]},
        {"hands": (hand(),)},
    ],
)
def test_a_wrong_target_is_refused(changes):
    with pytest.raises(InputError):
        target(**changes)


def test_overstretching_is_refused_at_the_limit():
    pull = 0.5 * (STRETCH_LIMIT * 0.42 - 0.4)
    good = target(hands=(hand(-1.0, pull), hand(1.0, pull)))
    assert good.final_grip_distance == pytest.approx(STRETCH_LIMIT * 0.42)
    with pytest.raises(InputError, match="limit"):
        target(hands=(hand(-1.0, pull + 1e-4), hand(1.0, pull)))


def test_unknown_and_missing_fields_are_named():
    data = target().to_json()
    with pytest.raises(InputError, match="colour"):
        FlatteningTarget.from_json({**data, "colour": 1})
    del data["mode"]
    with pytest.raises(InputError, match="mode"):
        FlatteningTarget.from_json(data)
    with pytest.raises(InputError):
        FlatteningTarget.from_json(np.zeros(3))


def test_pulling_further_adds_to_both_hands_alike():
    further = target().pulled_further(1.2, 0.001)
    assert [h.pull_distance for h in further.hands] == pytest.approx([0.013, 0.013])
    assert target().pulled_further(1.0, 0.0).to_json() == target().to_json()


def test_pulling_further_stops_at_the_stretch_limit():
    further = target().pulled_further(3.0, 0.05)
    longest = STRETCH_LIMIT * 0.42 - STRETCH_MARGIN
    assert further.final_grip_distance == pytest.approx(longest, abs=1e-9)
    assert further.hands[0].pull_distance == pytest.approx(further.hands[1].pull_distance)
    assert target(geodesic_distance=0.42 / STRETCH_LIMIT).pulled_further(2.0, 0.01).hands[
        0
    ].pull_distance == pytest.approx(0.01)


@pytest.mark.parametrize("how", [(0.9, 0.0), (1.0, -0.001), (float("nan"), 0.0)])
def test_pulling_less_far_is_refused(how):
    with pytest.raises(InputError, match="gain"):
        target().pulled_further(*how)
