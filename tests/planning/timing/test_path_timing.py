"""The jerk-limited law along a path: within limits, near the optimum, exactly on the path."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicHermiteSpline

from unwrinkle.models.errors import InputError, NoVerifiedPlanError
from unwrinkle.models.robot import load_cell
from unwrinkle.planning.sent_samples import as_sent
from unwrinkle.planning.timing.joint_path import JointPath, PathLimits
from unwrinkle.planning.timing.path_timing import time_paths
from unwrinkle.planning.timing.sampling import sampling_period, sent_ratios
from unwrinkle.planning.timing.straight_lines import time_line
from unwrinkle.planning.trajectory import Trajectory
from unwrinkle.testing.toppra_bound import jerk_free_line_time, jerk_free_time

LIMITS = load_cell().limits
FULL = PathLimits(LIMITS.velocity, LIMITS.acceleration, LIMITS.jerk)


def hermite_ratios(t, q, v):
    """Velocity, acceleration and jerk of the cubics between samples over the limits."""
    h = np.diff(t)[:, None]
    d = np.diff(q, axis=0)
    first = 6 * d / h**2 - (4 * v[:-1] + 2 * v[1:]) / h
    last = -6 * d / h**2 + (2 * v[:-1] + 4 * v[1:]) / h
    jerk = 6 * (v[:-1] + v[1:]) / h**2 - 12 * d / h**3
    a = np.maximum(np.abs(first), np.abs(last))
    return (
        (np.abs(v) / LIMITS.velocity).max(),
        (a / LIMITS.acceleration).max(),
        (np.abs(jerk) / LIMITS.jerk).max(),
    )


def curve(seed: int, size: float, points: int = 24):
    rng = np.random.default_rng(seed)
    s = np.linspace(0.0, 1.0, points)[:, None]
    a, b, c = rng.uniform(-size, size, (3, 13))
    return a + b * s + c * np.sin(np.pi * s) ** 2


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10_000), size=st.floats(0.01, 1.0))
def test_limits_hold_between_samples_and_the_path_is_kept(seed, size):
    path = JointPath.through(curve(seed, size))
    (timed,) = time_paths([path], [FULL])
    t, q, v = timed.sample(0.004)
    assert np.all(np.diff(t) > 0)
    assert np.array_equal(v[0], np.zeros(13)) and np.array_equal(v[-1], np.zeros(13))
    assert np.allclose(q[0], path.spline(0.0), atol=1e-12)
    assert np.allclose(q[-1], path.spline(1.0), atol=1e-12)
    speed, acceleration, jerk = hermite_ratios(t, q, v)
    assert speed <= 1.0
    assert acceleration <= 1.01  # the cubic's own overshoot at a 4 ms period
    assert jerk <= 1.001
    dense = path.spline(np.linspace(0.0, 1.0, 4001))
    gaps = np.abs(q[:, None, :] - dense[None, ::10]).max(-1).min(1)
    assert gaps.max() < 0.01 * size + 1e-6


@pytest.mark.parametrize("size", [0.05, 0.3, 1.0, 2.0])
def test_straight_line_is_as_fast_as_the_optimum(size):
    """Along a straight line ruckig's rest-to-rest motion is optimal.

    The law may be at most 1 % slower.
    """
    rng = np.random.default_rng(4)
    start, goal = rng.uniform(-0.5, 0.5, 13), rng.uniform(-0.5, 0.5, 13)
    goal = start + size * (goal - start)
    optimal = time_line(start, goal, LIMITS, 0.0, 0.004)[3]
    (timed,) = time_paths([JointPath.through(np.linspace(start, goal, 20))], [FULL])
    assert optimal <= timed.duration * (1.0 + 1e-6)
    assert timed.duration <= 1.01 * optimal


def test_is_slower_than_without_a_jerk_limit_and_not_by_much():
    paths = [JointPath.through(curve(seed, 0.5)) for seed in range(5)]
    for path, timed in zip(paths, time_paths(paths, [FULL] * 5), strict=True):
        assert 1.0 < timed.duration / jerk_free_time(path, LIMITS) < 1.6


def test_time_scales_with_the_limits():
    """Velocity x 1/k, acceleration x 1/k^2, jerk x 1/k^3 is the same motion k times slower."""
    path = JointPath.through(curve(7, 0.5))
    slow = PathLimits(LIMITS.velocity / 2, LIMITS.acceleration / 4, LIMITS.jerk / 8)
    fast_law, slow_law = time_paths([path, path], [FULL, slow])
    assert slow_law.duration == pytest.approx(2 * fast_law.duration, rel=2e-3)


def test_tip_speed_is_capped():
    points = curve(3, 0.3)
    tips = np.stack([points[:, 1:4], points[:, 7:10]], axis=1)  # any smooth curves of 3 coordinates
    path = JointPath.through(points, tips)
    (timed,) = time_paths([path], [PathLimits(*3 * [np.full(13, 1e4)], tip_speed=0.25)])
    t, q, _ = timed.sample(0.002)
    moving = np.linalg.norm(np.diff(np.stack([q[:, 1:4], q[:, 7:10]], 1), axis=0), axis=2)
    speeds = moving.max(1) / np.diff(t)
    assert speeds.max() <= 0.2505
    assert speeds.max() > 0.24


@pytest.mark.parametrize("speed", [0.1, 0.2, 0.5, 1.0])
def test_joint_lines_keep_to_the_line_and_their_limits_as_sent(speed):
    """400 random lines, every other one short.

    At lower speeds other axes' limits decide than at full speed.
    """
    rng, limits, period = (
        np.random.default_rng(5),
        LIMITS.scaled(speed),
        sampling_period(0.008, speed),
    )
    worst, off = np.zeros(3), 0.0
    for i in range(400):
        start, goal = rng.uniform(limits.lower, limits.upper, (2, 13))
        goal = goal if i % 2 else start + 0.1 * (goal - start)
        t, q, v, duration = time_line(start, goal, limits, 0.015, period)
        along = (q - start) @ (goal - start) / np.sum((goal - start) ** 2)
        off = max(off, np.abs(q - start - along[:, None] * (goal - start)).max())
        assert np.all(np.diff(along) >= 0.0)
        assert np.array_equal(q[[0, -1]], [start, goal]) and not v[[0, -1]].any()
        sent = as_sent(Trajectory(t, q, v))
        assert np.array_equal(np.rint(1000.0 * t) / 1000.0, sent.times)
        worst = np.maximum(worst, sent_ratios(sent.times, sent.positions, sent.velocities, limits))
        assert jerk_free_line_time(start, goal, limits) < duration <= t[-1] < 1.05 * duration
    assert off < 1e-9
    assert np.all(worst <= 1.0)


def test_the_measured_ratios_are_those_of_the_cubics():
    rng = np.random.default_rng(2)
    t = np.cumsum(rng.uniform(0.005, 0.02, 30))
    q, v = rng.uniform(-1.0, 1.0, (2, 30, 13))
    velocity, acceleration, jerk = sent_ratios(t, q, v, LIMITS)
    _, a, j = hermite_ratios(t, q, v)
    assert (acceleration, jerk) == (pytest.approx(a), pytest.approx(j))
    dense = CubicHermiteSpline(t, q, v)(np.linspace(t[0], t[-1], 200_001), nu=1)
    assert velocity == pytest.approx((np.abs(dense) / LIMITS.velocity).max(), rel=1e-4)


def test_limits_that_rounding_alone_breaks_are_refused():
    low = LIMITS.scaled(1e-4)
    with pytest.raises(NoVerifiedPlanError, match="rounding"):
        time_line(np.zeros(13), np.full(13, 1e-3), low, 0.015, 0.002)


@pytest.mark.parametrize(
    ("speed", "period"), [(1.0, 0.008), (0.5, 0.016), (0.2, 0.016), (0.1, 0.024)]
)
def test_slower_plans_have_longer_periods_on_the_controllers_clock(speed, period):
    assert sampling_period(0.008, speed) == period


def test_joint_line_of_no_length_takes_no_time():
    t, q, v, duration = time_line(np.ones(13), np.ones(13), LIMITS, 0.015, 0.008)
    assert duration == 0.0 and len(t) == len(q) == len(v) == 1


def test_impossible_limits_are_refused_with_a_reason():
    import dataclasses as dc

    broken = dc.replace(LIMITS, jerk=np.zeros(13))
    with pytest.raises(NoVerifiedPlanError, match="jerk-limited"):
        time_line(np.zeros(13), np.ones(13), broken, 0.0, 0.008)


def test_ruckigs_cloud_features_are_never_used(repository):
    """Intermediate waypoints and per-section limits make ruckig call a server."""
    for path in [
        p for f in ("planning", "hardware", "systems") for p in (repository / f).glob("*.py")
    ]:
        text = path.read_text()
        assert ".intermediate_positions" not in text and ".per_section" not in text, path


@pytest.mark.parametrize("size", [1e-7, 1e-5, 1e-3, 3.0])
def test_motions_of_any_size_are_timed(size):
    path = JointPath.through(curve(11, 1.0) * size)
    (timed,) = time_paths([path], [FULL])
    assert np.isfinite(timed.duration) and timed.duration > 0.0
    t, q, v = timed.sample(timed.duration / 200)
    assert max(hermite_ratios(t, q, v)) <= 1.01


def test_repeated_points_and_reversals_are_timed():
    line = np.linspace(0.0, 1.0, 20)[:, None] * np.ones(13)
    waits, returns = line.copy(), line.copy()
    waits[8:12] = line[8]
    returns[10:] = line[9::-1]
    for points in (waits, returns):
        (timed,) = time_paths([JointPath.through(points)], [FULL])
        t, q, v = timed.sample(0.004)
        assert max(hermite_ratios(t, q, v)) <= 1.01


def test_a_path_of_no_length_is_refused():
    with pytest.raises(InputError, match="no length"):
        JointPath.through(np.ones((20, 13)))
