"""Numeric kinematics: against the plant, round trips, Drake's solver, and the measured bounds of
the reach.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from unwrinkle.models.robot import build_robot_diagram, load_cell, position_indices
from unwrinkle.planning.robot.kinematics import Kinematics
from unwrinkle.planning.search.key_poses import (
    Freedom,
    approach_direction,
    seven_positions,
    tool_poses,
    tool_rotation,
)
from unwrinkle.planning.search.settings import NORMAL_STROKE
from unwrinkle.testing.drake_ik import DrakeInverseKinematics

KINEMATICS = Kinematics(load_cell())
ANGLES = st.lists(st.floats(0.0, 1.0), min_size=6, max_size=6)


def test_agrees_with_the_plant(cell, kinematics):
    diagram = build_robot_diagram(cell)
    plant = diagram.plant()
    context = plant.CreateDefaultContext()
    axes = position_indices(cell, plant).axes
    q = plant.GetPositions(context)
    rng = np.random.default_rng(1)
    for _ in range(50):
        x = rng.uniform(cell.limits.lower, cell.limits.upper)
        q[axes] = x
        plant.SetPositions(context, q)
        for arm, own in ((0, x[1:7]), (1, x[7:13])):
            gripper = plant.GetModelInstanceByName(f"r{arm + 1}_gripper")
            for frame, pose in (("ee", kinematics.tool), ("tcp", kinematics.tcp)):
                X = plant.GetFrameByName(frame, gripper).CalcPoseInWorld(context)
                assert np.abs(X.GetAsMatrix4() - pose(arm, x[0], own)).max() < 1e-12


@settings(max_examples=200, deadline=None)
@given(fractions=ANGLES, turn=st.floats(-1.5, 1.5), arm=st.integers(0, 1))
def test_every_solution_reproduces_its_pose(fractions, turn, arm):
    k = KINEMATICS
    q = k.lower + np.array(fractions) * (k.upper - k.lower)
    X_WT = k.tcp(arm, turn, q)
    solution = k.inverse(arm, turn, X_WT[None])
    found = solution.found[0]
    assert np.all(solution.within[0] <= found)
    if found.any():
        assert np.abs(k.tcp(arm, turn, solution.q[0, found]) - X_WT).max() < 1e-7
    inside = solution.q[0, solution.within[0]]
    assert np.all(inside >= k.lower) and np.all(inside <= k.upper)
    assert (
        k.missing_reach(arm, turn, X_WT[None])[0] <= 1e-9
    )  # a pose that exists is never called out of reach


def test_recovers_the_generating_configuration(kinematics):
    rng = np.random.default_rng(2)
    q = rng.uniform(kinematics.lower, kinematics.upper, (2000, 6))
    turn = rng.uniform(-1.0, 1.0, 2000)
    solution = kinematics.inverse(1, turn, kinematics.tcp(1, turn, q))
    gap = np.abs((solution.q - q[:, None] + np.pi) % (2 * np.pi) - np.pi).max(-1)
    recovered = (np.where(solution.found, gap, np.inf).min(1) < 1e-6).mean()
    assert recovered > 0.93


def test_wrist_is_not_spherical(cell, kinematics):
    """Leaving out the 30 mm between the B and T axes would be wrong by exactly that."""
    q = np.array([0.3, 0.2, -0.1, 0.4, 0.5, -0.6])
    spherical = Kinematics(cell)
    spherical._a = kinematics._a.copy()
    spherical._a[4] = 0.0
    error = np.linalg.norm((spherical.flange(q) - kinematics.flange(q))[:3, 3])
    assert error == pytest.approx(0.030, abs=1e-12)


def test_drakes_solver_finds_one_of_our_branches(cell, kinematics):
    oracle = DrakeInverseKinematics(cell)
    rng = np.random.default_rng(3)
    gaps = []
    for _ in range(40):
        q = rng.uniform(0.8 * kinematics.lower, 0.8 * kinematics.upper)
        X_WT = kinematics.tcp(0, 0.4, q)
        theirs = oracle.solve(0, 0.4, X_WT, q + rng.normal(size=6) * 0.2)
        if (
            theirs is None or abs(np.cos(theirs[4])) < 0.2
        ):  # R and T trade off at the straight wrist
            continue
        ours = kinematics.inverse(0, 0.4, X_WT[None])
        gap = np.abs((ours.q[0] - theirs + np.pi) % (2 * np.pi) - np.pi).max(-1)
        gaps.append(np.where(ours.found[0], gap, np.inf).min())
    assert len(gaps) >= 25
    assert np.mean(np.array(gaps) < 0.02) >= 0.9  # about 5 % of the roots are known to be missed


@pytest.mark.parametrize(
    ("turn", "tilt", "farthest"),
    [(0, 45, -0.93), (0, 75, -1.16), (30, 45, -1.13), (30, 75, -1.36), (60, 60, -1.38)],
)
def test_reach_of_the_far_hand(kinematics, make_target, turn, tilt, farthest):
    """Farthest contact point of a gripper that points straight back to the robot, as measured for
    the cell.
    """

    def reachable(y: float) -> bool:
        target = make_target((0.0, y + 0.24), np.pi / 2, 0.24, 0.0)
        far = min(target.hands, key=lambda hand: hand.p_WG[1])
        positions = seven_positions(far, Freedom(0.0, np.radians(tilt)), NORMAL_STROKE)
        rotation = tool_rotation(approach_direction(far, 0.0), np.radians(tilt))
        X_WT = tool_poses(positions, rotation)
        for arm, sign in ((0, 1.0), (1, -1.0)):
            for s in (sign, -sign):
                if np.all(kinematics.inverse(arm, s * np.radians(turn), X_WT).within.any(1)):
                    return True
        return False

    assert reachable(farthest + 0.04)
    assert not reachable(farthest - 0.04)
