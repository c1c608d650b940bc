"""Search and planner: freedoms that are needed, single-arm fallback, reasons of failure, start
states.
"""

import dataclasses as dc

import numpy as np
import pytest

from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import load_cell
from unwrinkle.planning.robot.collision import CollisionModel
from unwrinkle.planning.robot.kinematics import Kinematics
from unwrinkle.planning.search.motion_search import MotionSearch, natural_assignment, suggested_arm
from unwrinkle.planning.search.planner import FlatteningPlanner
from unwrinkle.planning.search.settings import PlannerSettings, Stage


def narrow(**freedoms) -> PlannerSettings:
    """A planner with one stage only; angles in degrees."""
    radians = {k: tuple(np.radians(v)) if k != "swap" else v for k, v in freedoms.items()}
    return dc.replace(PlannerSettings(), stages=(Stage(**radians),))


def test_arms_take_their_own_side(make_target):
    assert natural_assignment(make_target(phi=0.0)) == (0, 1)
    assert natural_assignment(make_target(phi=np.pi)) == (1, 0)


def test_prefers_the_straight_choice(planner, make_target):
    plan = planner.plan(make_target(phi=0.0)).plan
    assert plan is not None and plan.dual
    assert plan.turntable == 0.0
    assert [arm.offset for arm in plan.arms] == [0.0, 0.0]
    assert all(
        np.degrees(arm.tilt) == pytest.approx(45) or np.degrees(arm.tilt) == pytest.approx(60)
        for arm in plan.arms
    )


@pytest.mark.parametrize("phi", [-90, -60, -30, 0, 30, 60, 90])
@pytest.mark.parametrize("y", [-1.10, -1.15])
def test_every_direction_is_planned_with_both_arms(planner, make_target, phi, y):
    result = planner.plan(make_target((0.0, y), np.radians(phi)))
    assert result.plan is not None and result.plan.dual
    assert result.failure is None
    if abs(phi) == 90:
        assert result.plan.turntable != 0.0


def test_lateral_wrinkle_needs_the_turn_table(cell, make_target):
    """Measured for the cell: phi 90 deg at (0, -1.2) has no plan with the turn-table at 0 and tilts
    to 75 deg.
    """
    target = make_target((0.0, -1.2), np.pi / 2)
    fixed = FlatteningPlanner(cell, narrow(tilts=(45, 60, 30, 75), turntable=(0,), offsets=(0,)))
    result = fixed.plan(target, arms="dual")
    assert result.plan is None
    assert result.failure.cause == "far-reach"
    assert 0.0 < result.failure.missing < 0.3
    assert "mm of reach" in result.failure.message
    vertical = dc.replace(
        cell.scenario, gripper=dc.replace(cell.scenario.gripper, tilt_upper=np.pi / 2)
    )
    turned = FlatteningPlanner(
        load_cell(vertical), narrow(tilts=(45, 90), turntable=(30, -30), offsets=(0,))
    )
    assert turned.plan(target, arms="dual").plan is not None


def test_tilt_window_of_the_gripper_is_kept(cell, make_target):
    gripper = dc.replace(
        cell.scenario.gripper, tilt_lower=np.radians(40), tilt_upper=np.radians(50)
    )
    planner = FlatteningPlanner(load_cell(dc.replace(cell.scenario, gripper=gripper)))
    for phi in (0.0, 0.8, -0.8):
        plan = planner.plan(make_target(phi=phi)).plan
        assert plan is not None
        assert all(arm is None or np.degrees(arm.tilt) == pytest.approx(45) for arm in plan.arms)


def test_falls_back_to_one_arm_with_the_reason(cell, make_target):
    settings = narrow(tilts=(45, 60, 30), turntable=(0,), offsets=(0,))
    result = FlatteningPlanner(cell, settings).plan(make_target((0.0, -1.2), np.pi / 2))
    assert result.plan is not None and not result.plan.dual
    assert result.failure.cause == "far-reach"
    assert "no dual-arm motion" in result.plan.note
    idle = next(i for i, arm in enumerate(result.plan.arms) if arm is None)
    for segment in result.plan.segments:
        still = segment.trajectory.positions[:, 1 + 6 * idle : 7 + 6 * idle]
        assert np.array_equal(still, np.zeros_like(still))
        assert not segment.closed[idle]


def test_out_of_reach_of_both_arms_is_a_value_not_an_exception(cell, make_target):
    long = dc.replace(cell.scenario, table=dc.replace(cell.scenario.table, size=[0.8, 4.0]))
    result = FlatteningPlanner(load_cell(long)).plan(make_target((0.0, -2.6)))
    assert result.plan is None
    assert result.failure.cause == "far-reach"
    assert result.failure.missing > 0.3


def test_starts_from_any_free_configuration(planner, make_target):
    start = np.zeros(13)
    start[[0, 1, 7]] = [0.2, 0.3, -0.3]
    plan = planner.plan(make_target(), start=start).plan
    assert np.array_equal(plan.segments[0].trajectory.positions[0], start)
    assert np.array_equal(plan.segments[-1].trajectory.positions[-1], np.zeros(13))


def test_same_target_same_plan(planner, make_target):
    a, b = (planner.plan(make_target(phi=0.7)).plan for _ in range(2))
    assert a.content_hash == b.content_hash


def test_slower_cell_gives_slower_plans_within_its_limits(cell, make_target):
    slow = cell.with_speed(0.2)
    fast = FlatteningPlanner(cell).plan(make_target()).plan
    plan = FlatteningPlanner(slow).plan(make_target()).plan
    assert plan.speed == 0.2 and plan.limits_hash == slow.limits_hash
    assert 1.7 < plan.motion_time / fast.motion_time < 5.0
    for segment in plan.segments:
        assert np.all(np.abs(segment.trajectory.velocities) <= slow.limits.velocity)


def test_a_start_in_collision_or_beyond_the_limits_is_refused(planner, make_target):
    start = np.zeros(13)
    start[3] = 2.0
    failure = planner.plan(make_target(), start=start).failure
    assert failure.cause == "start" and "r1::joint_u" in failure.message
    start = np.zeros(13)
    start[[1, 2, 7, 8]] = [0.4, 0.5, -0.4, 0.5]
    failure = planner.plan(make_target(), start=start).failure
    assert failure.cause == "start" and "too close" in failure.message
    with pytest.raises(InputError, match="13 finite angles"):
        planner.plan(make_target(), start=np.full(13, np.nan))
    with pytest.raises(InputError, match="arms must be one of"):
        planner.plan(make_target(), arms="three")


@pytest.mark.parametrize(("y", "pull"), [(-0.79, 0.01), (-0.82, 0.03)])
def test_targets_beyond_the_edge_of_the_table_are_refused_by_name(planner, make_target, y, pull):
    """Once the grasp point lies beside the table, once the pull ends there.

    The table ends at y = -0.80.
    """
    target = make_target((0.0, y - 0.24), np.pi / 2, pull=pull)
    for arms in ("any", "dual", "single"):
        result = planner.plan(target, arms=arms)
        assert result.plan is None and result.failure.cause == "off-table"
        assert result.failure.missing == pytest.approx(0.01, abs=1e-6)
        assert "beyond the edge of the working table" in result.failure.message
    assert planner.plan(make_target((0.0, -0.84 - 0.24), np.pi / 2, pull=pull)).plan is not None


def test_the_table_may_stand_turned(cell):
    X = np.eye(4)
    X[:2, :2], X[:2, 3] = [[0.0, -1.0], [1.0, 0.0]], [1.0, 0.5]
    other = load_cell(
        dc.replace(cell.scenario, table=dc.replace(cell.scenario.table, size=[0.8, 0.4]))
    )
    other.__dict__["table_pose"] = X
    places = np.array([[1.0, 0.9], [1.0, 0.95], [1.2, 0.5], [1.25, 0.5]])
    assert other.beyond_table(places) == pytest.approx([0.0, 0.05, 0.0, 0.05])


def test_a_refused_plan_is_followed_by_the_next_motion(planner, make_target):
    offered = []

    def third(plan):
        offered.append(plan)
        return "" if len(offered) == 3 else "bad luck"

    result = planner.plan(make_target(), arms="dual", approve=third)
    assert result.plan is offered[2]
    choices = {(plan.arms, plan.turntable) for plan in offered}
    assert (
        len(choices) == 3
        and offered[0].content_hash == planner.plan(make_target()).plan.content_hash
    )


def test_a_target_all_of_whose_plans_are_refused_is_told_why(cell, make_target):
    planner = FlatteningPlanner(cell, narrow(tilts=(45, 60), turntable=(0,), offsets=(0,)))
    result = planner.plan(make_target(), approve=lambda plan: f"no {plan.dual}")
    assert result.plan is None
    assert result.failure.cause == "verification"
    assert "no True" in result.failure.message and "dual" in result.failure.message


def test_a_dual_arm_plan_refused_leaves_the_single_arm(cell, make_target):
    planner = FlatteningPlanner(cell, narrow(tilts=(45,), turntable=(0,), offsets=(0,)))
    result = planner.plan(make_target(), approve=lambda plan: "two" if plan.dual else "")
    assert result.plan is not None and not result.plan.dual
    assert result.failure.cause == "verification" and "two" in result.plan.note


@pytest.mark.parametrize("turned", [0.0, 0.2])
def test_a_fixed_turntable_stays_where_it_stands(cell, make_target, turned):
    options = dc.replace(cell.scenario.planner, turntable="fixed")
    still = FlatteningPlanner(load_cell(dc.replace(cell.scenario, planner=options)))
    start = np.zeros(13)
    start[0] = turned
    for phi in (0.0, 0.5, 1.2):
        plan = still.plan(make_target(phi=phi), start=start).plan
        assert plan is not None and plan.turntable == turned
        for segment in plan.segments:
            assert np.all(segment.trajectory.positions[:, 0] == turned)
            assert np.all(segment.trajectory.velocities[:, 0] == 0.0)
        home = plan.segments[-1].trajectory.positions[-1]
        assert np.array_equal(home, [turned, *np.zeros(12)])


def test_an_unknown_turntable_setting_is_refused(cell):
    options = dc.replace(cell.scenario.planner, turntable="loose")
    with pytest.raises(InputError, match="turntable 'loose' is unknown"):
        dc.replace(cell.scenario, planner=options).validate()


@pytest.mark.parametrize("phi", np.radians([-80, -50, -20, 0, 25, 55, 85]))
def test_the_single_arm_is_the_one_that_the_flattening_direction_suggests(
    planner, make_target, phi
):
    plan = planner.plan(make_target(phi=phi, pull=0.02), arms="single").plan
    assert plan is not None
    arm = next(i for i, choice in enumerate(plan.arms) if choice is not None)
    assert (plan.target.hands[plan.arms[arm].side].pull_direction[0] > 0.0) == (arm == 1)


def test_the_arm_of_a_pull_straight_ahead(make_target):
    """Ties: the arm on whose side the grasp point lies; on the middle line the right one."""
    for x, arm in ((-0.1, 0), (0.1, 1), (0.0, 0)):
        hand = make_target((x, -1.1), np.pi / 2).hands[0]
        straight = dc.replace(hand, p_WG=[x, -1.1, 0.7], pull_direction=[0.0, -1.0])
        assert suggested_arm(straight) == arm
    assert suggested_arm(dc.replace(straight, pull_direction=[0.6, -0.8])) == 1


def test_the_other_arm_serves_where_the_suggested_one_cannot(cell, make_target):
    """Every motion of the suggested arm is refused.

    Then come those of the other, and none before.
    """
    target = make_target(phi=0.3, half=0.10, pull=0.02)
    settings = narrow(tilts=(45, 60), turntable=(0, 15, -15), offsets=(0,))
    search = MotionSearch(cell, settings, Kinematics(cell), CollisionModel(cell, contact=True))
    order = []

    def unless_suggested(motion):
        arm = next(i for i, hand in enumerate(motion.hands) if hand is not None)
        order.append(arm == suggested_arm(target.hands[motion.hands[arm].side]))
        return not order[-1]

    motion, _ = search.single(target, unless_suggested)
    assert motion is not None
    assert order[:-1] == [True] * (len(order) - 1) and len(order) > 1 and not order[-1]
