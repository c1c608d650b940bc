"""toppra's profile: closed forms, and failures that name joint and place."""

import dataclasses as dc

import numpy as np
import pytest

from unwrinkle.models.robot import load_cell
from unwrinkle.planning.search.planner import FlatteningPlanner
from unwrinkle.planning.search.settings import PlannerSettings
from unwrinkle.planning.timing.joint_path import JointPath, PathLimits
from unwrinkle.planning.timing.path_timing import time_paths
from unwrinkle.planning.timing.toppra_profile import (
    PathTimingError,
    deciding_limit,
    time_optimal_profile,
)
from unwrinkle.testing.targets import flattening_task
from unwrinkle.testing.toppra_bound import jerk_free_line_time

LIMITS = load_cell().limits
FULL = PathLimits(LIMITS.velocity, LIMITS.acceleration, LIMITS.jerk)


def line(*ways: float) -> JointPath:
    """A straight path from zero, of one way per axis."""
    return JointPath.through(np.linspace(0.0, 1.0, 20)[:, None] * np.array(ways))


def limits(velocity: float, acceleration: float, tip_speed: float | None = None) -> PathLimits:
    return PathLimits(*(np.full(2, x) for x in (velocity, acceleration, 1e3)), tip_speed)


@pytest.mark.parametrize(
    ("way", "velocity", "acceleration", "duration"),
    [
        (1.0, 0.5, 1.0, 2.5),  # trapezoid: way / v + v / a
        (1.0, 10.0, 1.0, 2.0),  # triangle: 2 sqrt(way / a)
        (1e-6, 10.0, 1.0, 2e-3),
    ],
)
def test_straight_path_is_run_by_the_trapezoid_of_speed(way, velocity, acceleration, duration):
    path, bounds = line(way, 0.3 * way), limits(velocity, acceleration)
    profile = time_optimal_profile(path, bounds, 400)
    assert profile.duration == pytest.approx(duration, rel=2e-3)
    assert profile.duration == pytest.approx(
        jerk_free_line_time(
            np.zeros(2),
            np.array([way, 0.3 * way]),
            dc.replace(LIMITS, velocity=bounds.velocity, acceleration=bounds.acceleration),
        ),
        rel=2e-3,
    )
    peak = min(velocity, np.sqrt(acceleration * way)) / way
    assert profile.speed.max() == pytest.approx(peak, rel=1e-2)
    assert profile.speed[0] == profile.speed[-1] == 0.0
    s = np.array([0.02, 0.5])
    exact = np.minimum(2.0 * acceleration / way * s, peak**2)
    assert profile.squared_speed(s) == pytest.approx(exact, rel=2e-2)


def test_circle_is_run_at_the_speed_of_its_centripetal_acceleration():
    """On a half circle of radius r the speed is at most sqrt(a r).

    Where one axis turns, all of its acceleration is used.
    """
    angle = np.linspace(0.0, np.pi, 60)
    path = JointPath.through(0.5 * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    profile = time_optimal_profile(path, limits(100.0, 2.0))
    middle = profile.speed[len(profile.s) // 2] * 0.5 * np.pi  # rad/s
    assert middle == pytest.approx(np.sqrt(2.0 * 0.5), rel=1e-2)


def test_speed_of_the_tools_is_capped():
    points = np.linspace(0.0, 1.0, 20)[:, None] * np.array([1.0, 0.5])
    tips = np.zeros((20, 2, 3))
    tips[:, 0, 1] = 0.4 * points[:, 0]  # m: the first tool moves 0.4 m
    path = JointPath.through(points, tips)
    profile = time_optimal_profile(path, limits(10.0, 50.0, tip_speed=0.2))
    assert 0.4 * profile.speed.max() == pytest.approx(0.2, rel=1e-6)
    assert deciding_limit(path, limits(10.0, 50.0, 0.2), profile).quantity == "tip speed"


def test_a_profile_is_the_bound_of_every_smoothing():
    rng = np.random.default_rng(3)
    s = np.linspace(0.0, 1.0, 24)[:, None]
    a, b, c = rng.uniform(-0.5, 0.5, (3, 13))
    path = JointPath.through(a + b * s + c * np.sin(np.pi * s) ** 2)
    free = time_optimal_profile(path, FULL, 400).duration
    (optimal,) = time_paths([path], [FULL])
    assert free < optimal.duration < 1.6 * free


def test_the_deciding_limit_is_that_of_the_axis_that_needs_the_time():
    path = line(*np.where(np.arange(13) == 4, 2.0, 0.1))
    slow = dc.replace(FULL, velocity=np.where(np.arange(13) == 4, 0.05, FULL.velocity))
    limit = deciding_limit(path, slow, time_optimal_profile(path, slow))
    assert (limit.quantity, limit.joint) == ("velocity", 4)
    assert limit.place == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize("quantity", ["velocity", "acceleration", "jerk"])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_limits_that_are_not_positive_are_refused_with_joint_and_place(quantity, value):
    """Axis 6 moves most at the end of its quarter of a turn."""
    points = np.linspace(0.0, 1.0, 20)[:, None] * np.ones(13)
    points[:, 5] = 1.0 - np.cos(0.5 * np.pi * points[:, 5])
    bad = getattr(FULL, quantity).copy()
    bad[5] = value
    good = JointPath.through(points[:, ::-1])
    with pytest.raises(PathTimingError) as caught:
        time_paths([good, JointPath.through(points)], [FULL, dc.replace(FULL, **{quantity: bad})])
    error = caught.value
    assert (error.path, error.limit.quantity, error.limit.joint) == (1, quantity, 5)
    assert error.limit.place == pytest.approx(1.0)


def test_a_tip_speed_of_zero_is_refused():
    points = np.linspace(0.0, 1.0, 20)[:, None] * np.ones(2)
    path = JointPath.through(points, np.zeros((20, 2, 3)))
    with pytest.raises(PathTimingError) as caught:
        time_optimal_profile(path, limits(1.0, 1.0, tip_speed=0.0))
    assert (caught.value.limit.quantity, caught.value.limit.joint) == ("tip speed", None)


def test_a_path_that_bends_without_bound_is_refused_where_it_does(monkeypatch):
    """toppra finds no speed where it gets numbers that are not finite."""
    path = line(*np.ones(13))
    whole = path.spline

    class Broken:
        c = whole.c

        def __call__(self, s, nu=0):
            values = whole(s, nu=nu)
            if nu == 2:
                values = values.copy()
                values[np.abs(s - 0.4) < 1e-9, 7] = np.nan
            return values

    with pytest.raises(PathTimingError) as caught:
        time_optimal_profile(JointPath(Broken()), FULL)
    assert caught.value.limit.place == pytest.approx(0.4, abs=0.011)
    assert caught.value.limit.joint == 7


def test_a_plan_that_takes_too_long_names_axis_and_place():
    planner = FlatteningPlanner(load_cell().with_speed(0.2), PlannerSettings(longest=0.5))
    result = planner.plan(flattening_task((0.0, -1.1), 0.2), arms="dual")
    assert result.plan is None and result.failure is not None
    assert result.failure.cause == "time"
    assert any(axis in result.failure.message for axis in load_cell().robot.axes)
    assert "% of the path" in result.failure.message
