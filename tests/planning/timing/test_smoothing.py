"""Both smoothings: within the limits on the samples as sent, and verified as whole plans.

The start of `optimal`.
"""

import dataclasses as dc

import numpy as np
import pytest

from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import load_cell
from unwrinkle.models.scenario import Scenario, Smoothing, load_scenario
from unwrinkle.planning.search.planner import FlatteningPlanner
from unwrinkle.planning.timing.joint_path import JointPath, PathLimits
from unwrinkle.planning.timing.optimal_smoothing import smooth_optimally
from unwrinkle.planning.timing.path_timing import time_paths
from unwrinkle.planning.timing.ruckig_smoothing import smooth_by_ruckig
from unwrinkle.planning.timing.sampling import sent_ratios
from unwrinkle.planning.timing.straight_lines import time_line
from unwrinkle.planning.timing.toppra_profile import time_optimal_profile
from unwrinkle.planning.verification.verifier import verify
from unwrinkle.testing.targets import tasks

LIMITS = load_cell().limits
FULL = PathLimits(LIMITS.velocity, LIMITS.acceleration, LIMITS.jerk)


def curve(seed: int, size: float) -> JointPath:
    rng = np.random.default_rng(seed)
    s = np.linspace(0.0, 1.0, 24)[:, None]
    a, b, c = rng.uniform(-size, size, (3, 13))
    return JointPath.through(a + b * s + c * np.sin(np.pi * s) ** 2)


def cell_with(smoothing: Smoothing):
    scenario = load_scenario()
    timing = dc.replace(scenario.timing, smoothing=smoothing.value)
    return load_cell(dc.replace(scenario, timing=timing))


@pytest.fixture(scope="module")
def planners() -> dict[Smoothing, FlatteningPlanner]:
    return {smoothing: FlatteningPlanner(cell_with(smoothing)) for smoothing in Smoothing}


@pytest.mark.parametrize("size", [1e-7, 1e-3, 0.3, 3.0])
@pytest.mark.parametrize("seed", range(4))
def test_ruckig_keeps_every_limit_and_the_path(seed, size):
    path = curve(seed, size)
    (timed,) = time_paths([path], [FULL], Smoothing.RUCKIG)
    t, q, v = timed.sample(timed.duration / 400)
    assert np.array_equal(v[[0, -1]], np.zeros((2, 13)))
    assert np.allclose(q[[0, -1]], path.spline(np.array([0.0, 1.0])), rtol=0.0, atol=1e-9 * size)
    velocity, acceleration, jerk = sent_ratios(t, q, v, LIMITS)
    assert velocity <= 1.0001 and jerk <= 1.001
    assert acceleration <= 1.01  # the cubics' own overshoot between samples
    dense = path.spline(np.linspace(0.0, 1.0, 20001))
    assert all(np.abs(dense - x).max(axis=1).min() < 1e-3 * size for x in q[::20])


@pytest.mark.parametrize("seed", range(3))
def test_wild_paths_are_timed_by_ruckig_too(seed):
    """Random points: many sharp bends."""
    points = np.random.default_rng(seed).uniform(-1.0, 1.0, (20, 13))
    (timed,) = time_paths([JointPath.through(points)], [FULL], Smoothing.RUCKIG)
    t, q, v = timed.sample(0.002)
    assert max(sent_ratios(t, q, v, LIMITS)) <= 1.02


def test_ruckig_caps_the_speed_of_the_tools():
    rng = np.random.default_rng(3)
    s = np.linspace(0.0, 1.0, 24)[:, None]
    points = s * rng.uniform(0.1, 0.3, 13)
    tips = np.stack([points[:, 1:4], points[:, 7:10]], axis=1)
    path = JointPath.through(points, tips)
    (timed,) = time_paths(
        [path], [PathLimits(*3 * [np.full(13, 1e4)], tip_speed=0.25)], Smoothing.RUCKIG
    )
    t, q, _ = timed.sample(0.001)
    moving = np.linalg.norm(np.diff(np.stack([q[:, 1:4], q[:, 7:10]], 1), axis=0), axis=2)
    assert 0.24 < (moving.max(1) / np.diff(t)).max() <= 0.25001


def test_ruckig_is_optimal_on_a_straight_path():
    rng = np.random.default_rng(5)
    start, goal = rng.uniform(-0.5, 0.5, (2, 13))
    exact = time_line(start, goal, LIMITS, 0.0, 0.004)[3]
    path = JointPath.through(np.linspace(start, goal, 20))
    timed = smooth_by_ruckig(path, FULL, time_optimal_profile(path, FULL))
    assert exact * (1.0 - 1e-9) <= timed.duration <= 1.01 * exact


def test_a_path_whose_sections_do_not_settle_is_one_section(monkeypatch):
    from unwrinkle.planning.timing import ruckig_smoothing

    path = curve(1, 0.5)
    sections = smooth_by_ruckig(path, FULL, time_optimal_profile(path, FULL))
    monkeypatch.setattr(ruckig_smoothing, "_ROUNDS", 0)
    whole = smooth_by_ruckig(path, FULL, time_optimal_profile(path, FULL))
    assert sections.duration < whole.duration
    t, q, v = whole.sample(0.002)
    assert max(sent_ratios(t, q, v, LIMITS)) <= 1.01


def test_the_start_from_toppra_ends_at_the_same_optimum():
    paths = [curve(seed, 0.5) for seed in range(5)]
    limits = [FULL] * 5
    profiles = [time_optimal_profile(path, FULL) for path in paths]
    with_start = smooth_optimally(paths, limits, profiles)
    without = smooth_optimally(paths, limits)
    for a, b in zip(with_start, without, strict=True):
        assert a.duration == pytest.approx(b.duration, rel=5e-3)


@pytest.mark.parametrize("smoothing", Smoothing)
def test_plans_of_both_smoothings_are_verified(smoothing, planners):
    cell = cell_with(smoothing)
    for task in tasks(0)[::40]:
        result = planners[smoothing].plan(task.target)
        assert result.plan is not None
        verdict = verify(result.plan, cell)
        assert verdict.passed, verdict.violations


def test_ruckigs_plans_are_slower_and_of_the_same_robot(planners):
    target = tasks(0)[3].target
    a, b = (planners[smoothing].plan(target).plan for smoothing in Smoothing)
    assert a is not None and b is not None
    assert a.motion_time < b.motion_time < 1.6 * a.motion_time
    assert (a.robot_hash, a.limits_hash) == (b.robot_hash, b.limits_hash)


def test_the_default_is_optimal_and_an_unknown_smoothing_is_refused(tmp_path):
    assert Scenario().timing.smoothing == load_scenario().timing.smoothing == "optimal"
    file = tmp_path / "a.scenario.yaml"
    file.write_text("mine: {timing: {smoothing: ruckig}}\n")
    assert load_scenario(file).timing.smoothing == "ruckig"
    file.write_text("mine: {timing: {smoothing: fast}}\n")
    with pytest.raises(InputError, match="optimal, ruckig"):
        load_scenario(file)
    file.write_text("mine: {timing: {smooth: ruckig}}\n")
    with pytest.raises(InputError):
        load_scenario(file)
