"""Pinches from above: where the tips stand, that the arm gets there, and the reason when it does
not.
"""

import numpy as np
import pytest

from unwrinkle.models.blades import load_blades
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell
from unwrinkle.planning.primitives.pinch import (
    NoPinch,
    PinchPlan,
    PinchPlanner,
    PinchSettings,
    level_tilt,
    pinch_pose,
)
from unwrinkle.planning.robot.kinematics import Kinematics

OPENING = 0.030
TABLE = 0.70


@pytest.fixture(scope="module")
def pinches(cell: Cell) -> PinchPlanner:
    return PinchPlanner(cell)


def _tips(X_WT: np.ndarray) -> np.ndarray:
    """World places of both tips' middles."""
    blades = load_blades()
    half = 0.5 * blades.thickness
    ends = [[0.0, half, blades.lower_end], [0.0, 3.0 * half + OPENING, blades.upper_end]]
    return np.asarray(np.array(ends) @ X_WT[:3, :3].T + X_WT[:3, 3])


def test_level_tips_stand_astride_the_crest() -> None:
    blades = load_blades()
    crest, direction = np.array([0.1, -1.1, TABLE + 0.025]), np.array([0.6, 0.8])
    X_WT = pinch_pose(crest, direction, level_tilt(blades, OPENING), TABLE + 0.005, blades, OPENING)
    lower, upper = _tips(X_WT)
    assert lower[2] == pytest.approx(upper[2])
    assert upper[:2] - lower[:2] == pytest.approx(float(np.hypot(*(upper - lower)[:2])) * direction)
    corners = np.array([[0, y, z] for y, z in ((0, 0), (0.003, 0), (0.033, -0.01), (0.036, -0.01))])
    heights = (corners @ X_WT[:3, :3].T + X_WT[:3, 3])[:, 2]
    assert heights.min() == pytest.approx(TABLE + 0.005)
    # The middle line passes half way up the fold.
    middle = 0.5 * (lower + upper)
    s = (TABLE + 0.015 - middle[2]) / X_WT[2, 2]
    assert (middle + s * X_WT[:3, 2])[:2] == pytest.approx(crest[:2])
    assert X_WT[:3, :3] @ X_WT[:3, :3].T == pytest.approx(np.eye(3))


def test_a_plan_goes_straight_down_and_up(pinches: PinchPlanner, kinematics: Kinematics) -> None:
    crest = np.array([0.05, -1.10, TABLE + 0.022])
    plan = pinches.plan(crest, np.array([1.0, 0.0]))
    assert isinstance(plan, PinchPlan)
    arm = slice(1 + 6 * plan.arm, 7 + 6 * plan.arm)
    X = kinematics.tcp(plan.arm, plan.path[:, 0], plan.path[:, arm])
    down = X[plan.pinch_index]
    assert down == pytest.approx(plan.X_WT, abs=1e-6)
    assert _tips(down)[:, 2].min() > TABLE
    assert X[:, :3, :3] == pytest.approx(np.tile(down[:3, :3], (len(X), 1, 1)), abs=1e-6)
    way = X[: plan.pinch_index + 1, :3, 3] - down[:3, 3]
    assert np.linalg.norm(np.cross(way, down[:3, 2]), axis=1).max() < 1e-6
    assert np.linalg.norm(way[0]) == pytest.approx(pinches.settings.approach)
    up = X[plan.pinch_index :, :3, 3] - down[:3, 3]
    assert np.abs(up[:, :2]).max() < 1e-6
    assert up[-1, 2] == pytest.approx(pinches.settings.lift)
    assert plan.transit[-1] == pytest.approx(plan.path[0])
    other = slice(7 - 6 * plan.arm, 13 - 6 * plan.arm)
    assert np.ptp(plan.path[:, other], axis=0).max() == 0.0


def test_the_crest_of_a_heap_is_not_pinched_at_the_table(pinches: PinchPlanner) -> None:
    assert pinches.tip_height(TABLE + 0.010) == pytest.approx(TABLE + 0.003)
    assert pinches.tip_height(TABLE + 0.080) == pytest.approx(TABLE + 0.060)


def test_out_of_reach_says_by_how_much(pinches: PinchPlanner) -> None:
    away = pinches.plan(np.array([0.0, -3.0, TABLE + 0.02]), np.array([1.0, 0.0]))
    assert isinstance(away, NoPinch) and away.cause == "far-reach" and "m beyond" in away.reason


def test_a_place_in_the_robot_itself_is_refused(pinches: PinchPlanner) -> None:
    inside = pinches.plan(np.array([0.0, 0.0, 0.75]), np.array([0.0, 1.0]))
    assert isinstance(inside, NoPinch) and inside.cause in {"limits", "collision", "transit"}


def test_below_the_table_every_posture_collides(cell: Cell) -> None:
    sunk = PinchPlanner(cell, PinchSettings(table_gap=-0.10, depth=0.2, most=4))
    found = sunk.plan(np.array([0.0, -1.10, TABLE]), np.array([1.0, 0.0]))
    assert isinstance(found, NoPinch) and found.cause == "collision" and "t2" in found.reason


@pytest.mark.parametrize(
    ("point", "across"),
    [((0.0, np.nan, 0.7), (1.0, 0.0)), ((0.0, -1.1, 0.72), (1.0, 1.0))],
)
def test_bad_input_is_refused(
    pinches: PinchPlanner, point: tuple[float, ...], across: tuple[float, ...]
) -> None:
    with pytest.raises(InputError, match="pinch"):
        pinches.plan(np.array(point), np.array(across))
