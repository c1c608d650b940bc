"""The seven poses and the smooth pieces between them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from unwrinkle.planning.search.key_poses import (
    PIECES,
    Freedom,
    approach_direction,
    piece,
    piece_counts,
    pieces,
    seven_positions,
    tool_rotation,
)
from unwrinkle.planning.search.settings import NORMAL_STROKE, SHORT_STROKE

POINTS = st.lists(st.floats(-0.3, 0.3), min_size=9, max_size=9)


def test_poses_are_where_the_names_say(make_target):
    hand = make_target(phi=0.3, pull=0.02).hands[1]
    p = seven_positions(hand, Freedom(0.0, 0.8), NORMAL_STROKE)
    table = hand.p_WG[2]
    assert np.allclose(p[:, 2] - table, [0.123, 0.003, 0.003, 0.018, 0.003, 0.003, 0.123])
    assert np.allclose(p[2, :2], hand.p_WG[:2])
    assert np.allclose(p[4, :2], hand.p_WG[:2] + 0.02 * hand.pull_direction)
    outward = -hand.grasp_direction
    assert np.linalg.norm(p[1, :2] - p[2, :2]) == pytest.approx(NORMAL_STROKE.touch_distance)
    for later, earlier in ((1, 0), (2, 1)):  # approaches inwards, leaves outwards
        assert (p[later] - p[earlier])[:2] @ outward < 0
    assert (p[5] - p[4])[:2] @ outward > 0 and (p[6] - p[5])[:2] @ outward > 0


def test_offset_turns_the_approach_and_share_the_pull(make_target):
    hand = make_target().hands[0]
    turned = approach_direction(hand, 0.5)
    assert np.arccos(turned @ hand.grasp_direction) == pytest.approx(0.5)
    p = seven_positions(hand, Freedom(0.5, 0.8, share=2.0), SHORT_STROKE)
    assert np.linalg.norm((p[4] - p[2])[:2]) == pytest.approx(2.0 * hand.pull_distance)


@given(yaw=st.floats(-3.0, 3.0), tilt=st.floats(0.1, 1.5))
def test_tool_is_a_rotation_that_points_down_by_the_tilt(yaw, tilt):
    R = tool_rotation(np.array([np.cos(yaw), np.sin(yaw)]), tilt)
    assert np.allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)
    assert R[2, 2] == pytest.approx(-np.sin(tilt))  # approach
    assert abs(R[2, 0]) < 1e-12  # blades level
    assert R[2, 1] > 0  # the upper blade is above


@settings(max_examples=100, deadline=None)
@given(values=POINTS, radius=st.floats(0.002, 0.05), count=st.integers(8, 60))
def test_piece_starts_and_ends_at_its_poses_and_stays_near_the_legs(values, radius, count):
    a, b, c = np.array(values).reshape(3, 3)
    if min(np.linalg.norm(b - a), np.linalg.norm(c - b)) < 1e-3:
        return
    p = piece(np.array([a, b, c]), radius, count)
    assert len(p) == count + 1
    assert np.allclose(p[0], a) and np.allclose(p[-1], c, atol=1e-9)
    step = np.linalg.norm(np.diff(p, axis=0), axis=1)
    total = np.linalg.norm(b - a) + np.linalg.norm(c - b)
    assert step.max() <= total / count + 1e-9

    def to_leg(x, u, v):
        s = np.clip((x - u) @ (v - u) / np.sum((v - u) ** 2), 0.0, 1.0)
        return np.linalg.norm(x - u - s[:, None] * (v - u), axis=1)

    assert np.minimum(to_leg(p, a, b), to_leg(p, b, c)).max() <= radius


def test_a_leg_of_no_length_is_a_straight_piece():
    a, c = np.zeros(3), np.array([0.1, 0.0, 0.0])
    p = piece(np.array([a, a, c]), 0.03, 10)
    assert np.allclose(p, np.linspace(a, c, 11))


def test_pieces_meet_and_never_dip_below_the_table_gap(make_target):
    hand = make_target(phi=-0.7, pull=0.01).hands[0]
    p = seven_positions(hand, Freedom(0.2, 0.8), NORMAL_STROKE)
    counts = piece_counts([p, p], 0.01)
    parts = pieces(p, NORMAL_STROKE.blend, counts)
    assert [len(part) - 1 for part in parts] == counts
    assert np.allclose(parts[0][-1], parts[1][0]) and np.allclose(parts[1][-1], parts[2][0])
    assert min(part[:, 2].min() for part in parts) >= p[:, 2].min() - 1e-12
    for part, (_, _, last) in zip(parts, PIECES, strict=True):
        assert np.allclose(part[-1], p[last])


@pytest.mark.parametrize("pull", [0.005, 0.015, 0.03])
def test_the_pull_pose_is_met(make_target, pull):
    """Regression: the rounded corner passed the pull pose 8 mm below."""
    hand = make_target(pull=pull).hands[0]
    p = seven_positions(hand, Freedom(0.0, 0.8), NORMAL_STROKE)
    path = pieces(p, NORMAL_STROKE.blend, [40, 80, 40])[1]
    assert np.linalg.norm(path - p[3], axis=1).min() < 1.5e-3
    assert path[:, 2].max() - p[2, 2] < NORMAL_STROKE.lift + 2e-3
