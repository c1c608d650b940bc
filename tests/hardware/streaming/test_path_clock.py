"""The path clock keeps limits and path through every change of rate."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from unwrinkle.hardware.streaming.path_clock import HIGHEST_REDUCED_RATE, PathClock, Sample
from unwrinkle.hardware.streaming.sent_cubics import CubicPath, StreamLimits
from unwrinkle.models.errors import InputError
from unwrinkle.planning.trajectory import AXES, Trajectory, rate_extremes

TrajectoryMaker = Callable[..., Trajectory]

_PERIOD = 0.004
#: Of a float32 position below 2 rad, rad.
ROUNDING = 6e-8


def arrays(samples: list[Sample]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return (
        np.array([sample.time for sample in samples]),
        np.array([sample.positions for sample in samples]),
        np.array([sample.velocities for sample in samples]),
    )


def greatest_use(samples: list[Sample], trajectory: Trajectory, limits: StreamLimits) -> float:
    """Largest share of a limit, or of what the trajectory itself uses."""
    own = rate_extremes(trajectory.times, trajectory.positions, trajectory.velocities)
    bound = limits.widened(own)
    used = rate_extremes(*arrays(samples))
    bounds = (bound.velocity, bound.acceleration, bound.jerk)
    return float(max((a / b).max() for a, b in zip(used, bounds, strict=True)))


def distance_from_path(samples: list[Sample], trajectory: Trajectory) -> float:
    """Of the points sent, at their own s, and of the cubics between them, wherever s may be.

    Rad.
    """
    curve = trajectory.interpolant()
    sent = max(np.abs(curve(sample.s) - sample.positions).max() for sample in samples)
    assert sent <= ROUNDING
    times, positions, velocities = arrays(samples)
    s = np.array([sample.s for sample in samples])
    halves = 0.5 * (times[1:] + times[:-1])
    run = Trajectory(times - times[0], positions, velocities).interpolant()(halves - times[0])
    slope = curve.derivative()
    nearest = 0.5 * (s[1:] + s[:-1])
    for _ in range(20):  # Gauss-Newton on s
        along = slope(nearest)
        move = ((run - curve(nearest)) * along).sum(axis=1) / ((along**2).sum(axis=1) + 1e-12)
        nearest = np.clip(nearest + move, s[:-1], s[1:])
    return float(max(sent, np.abs(curve(nearest) - run).max()))


def test_rate_one_is_the_trajectory_bit_for_bit(
    make_trajectory: TrajectoryMaker, stream_limits: StreamLimits
) -> None:
    trajectory = make_trajectory(1)
    clock = PathClock(trajectory, stream_limits)
    points: list[Sample] = []
    for time in np.arange(0.0, trajectory.duration + 0.1, 0.0037):
        points += clock.next_until(float(time))
    times, positions, velocities = arrays(points)
    assert np.array_equal(times, trajectory.times)
    assert np.array_equal(positions, trajectory.positions)
    assert np.array_equal(velocities, trajectory.velocities)
    assert clock.done and clock.at_rest


@pytest.mark.parametrize("rate", [0.5, 0.2, 0.1, 0.013])
def test_constant_rate_is_the_same_curve(
    make_trajectory: TrajectoryMaker, stream_limits: StreamLimits, rate: float
) -> None:
    trajectory = make_trajectory(2)
    points = PathClock(trajectory, stream_limits, rate=rate).next_until(np.inf)
    times, positions, velocities = arrays(points)
    assert np.diff(times).max() <= 0.04 + 1e-9
    assert 0.0 <= times[-1] - trajectory.duration / rate < 1e-3
    run = Trajectory(times, positions, velocities).interpolant()
    t = np.linspace(0.0, times[-2], 2001)
    assert np.abs(run(t) - trajectory.interpolant()(t * rate)).max() < ROUNDING
    own = [
        rate ** (k + 1) * value
        for k, value in enumerate(
            rate_extremes(trajectory.times, trajectory.positions, trajectory.velocities)
        )
    ]
    step = np.diff(times).min()
    for order, (value, scaled) in enumerate(
        zip(rate_extremes(times, positions, velocities), own, strict=True), start=1
    ):
        assert (value <= scaled * (1.0 + 1e-6) + 25.0 * ROUNDING / step**order).all()


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    changes=st.lists(
        st.tuples(st.floats(0.0, 1.0), st.sampled_from([0.0, 0.0, 0.05, 0.2, 0.5, 1.0, 0.77])),
        min_size=1,
        max_size=6,
    ),
    first=st.sampled_from([1.0, 0.5, 0.1]),
)
def test_limits_and_path_are_kept_through_any_changes(
    make_trajectory: TrajectoryMaker,
    stream_limits: StreamLimits,
    seed: int,
    changes: list[tuple[float, float]],
    first: float,
) -> None:
    trajectory = make_trajectory(seed)
    clock = PathClock(trajectory, stream_limits, rate=first)
    orders = sorted((share * trajectory.duration / first, rate) for share, rate in changes)
    points: list[Sample] = []
    time = 0.0
    for _ in range(200_000):
        while orders and orders[0][0] <= time:
            clock.set_rate(orders.pop(0)[1])
        points += clock.next_until(time)
        time += _PERIOD
        if clock.done:
            break
        if clock.at_rest and not orders:  # time stands still: go on at full speed
            clock.set_rate(1.0)
            time = points[-1].time
    assert clock.done
    times, positions, _ = arrays(points)
    rates = np.array([point.rate for point in points])
    assert rates.min() >= 0.0 and rates.max() <= 1.0
    assert np.diff(times).min() > 1e-3 - 1e-9
    assert np.diff(times).max() <= 0.04 + 1e-9
    assert np.abs(1e3 * times - np.round(1e3 * times)).max() < 1e-6
    for point in points:
        for values in (point.positions, point.velocities):
            assert np.array_equal(values, values.astype(np.float32))
    assert (np.diff([point.s for point in points]) > 0.0).all()
    assert np.array_equal(positions[-1], trajectory.positions[-1])
    assert greatest_use(points, trajectory, stream_limits) <= 1.0 + 2e-6
    assert distance_from_path(points, trajectory) < 1e-5


@pytest.mark.parametrize("rate", [1.0, 0.2])
def test_a_hold_ends_at_rest_and_what_remains_starts_there(
    make_trajectory: TrajectoryMaker, stream_limits: StreamLimits, rate: float
) -> None:
    trajectory = make_trajectory(5)
    clock = PathClock(trajectory, stream_limits, rate=rate)
    before = clock.next_until(0.5 * trajectory.duration / rate)
    clock.set_rate(0.0)
    assert not clock.at_rest
    after = clock.next_until(np.inf)
    assert clock.at_rest and not clock.done and clock.last is not None
    assert after[-1].time - before[-1].time < 0.8
    assert np.array_equal(after[-1].velocities, np.zeros(AXES))
    assert greatest_use(before + after, trajectory, stream_limits) <= 1.0 + 2e-6
    assert clock.next_until(np.inf) == []
    rest = clock.remaining()
    assert np.array_equal(rest.positions[0], after[-1].positions)
    assert np.array_equal(rest.positions[-1], trajectory.positions[-1])
    assert np.array_equal(rest.velocities[0], np.zeros(AXES))
    used = rate_extremes(rest.times, rest.positions, rest.velocities)
    assert (used[2] <= stream_limits.jerk * (1.0 + 2e-6)).all()
    clock.set_rate(rate)
    resumed = clock.next_until(np.inf)
    assert clock.done
    assert greatest_use(before + after + resumed, trajectory, stream_limits) <= 1.0 + 2e-6


def test_a_hold_at_the_end_runs_to_the_end(
    make_trajectory: TrajectoryMaker, stream_limits: StreamLimits
) -> None:
    trajectory = make_trajectory(7)
    clock = PathClock(trajectory, stream_limits)
    points = clock.next_until(trajectory.duration - 0.02)
    clock.set_rate(0.0)
    points += clock.next_until(np.inf)
    assert clock.at_rest
    assert greatest_use(points, trajectory, stream_limits) <= 1.0 + 2e-6


def test_before_the_start_any_rate_begins_at_once(
    make_trajectory: TrajectoryMaker, stream_limits: StreamLimits
) -> None:
    trajectory = make_trajectory(8)
    clock = PathClock(trajectory, stream_limits)
    clock.set_rate(0.0)
    points = clock.next_until(1.0)
    assert len(points) == 1 and clock.at_rest
    clock.set_rate(1.0)
    points += clock.next_until(np.inf)
    assert np.array_equal(arrays(points)[1], trajectory.positions)


def test_more_than_it_can_be_is_refused(
    make_trajectory: TrajectoryMaker, stream_limits: StreamLimits
) -> None:
    trajectory = make_trajectory(9)
    clock = PathClock(trajectory, stream_limits)
    for rate in (float("nan"), -0.1, 1.1):
        with pytest.raises(InputError, match="give 0 to 1"):
            clock.set_rate(rate)
    moving = Trajectory(
        trajectory.times[:20], trajectory.positions[:20], trajectory.velocities[20:40]
    )
    with pytest.raises(InputError, match="at rest"):
        PathClock(moving, stream_limits)
    with pytest.raises(InputError, match="jerk"):
        StreamLimits(np.ones(AXES), np.ones(AXES), np.full(AXES, np.nan))
    assert clock.target == 1.0


def test_extremes_are_those_of_the_cubics(make_trajectory: TrajectoryMaker) -> None:
    trajectory = make_trajectory(3)
    curve = trajectory.interpolant()
    dense = np.linspace(0.0, trajectory.duration, 20_001)
    found = rate_extremes(trajectory.times, trajectory.positions, trajectory.velocities)
    for order, value in enumerate(found, start=1):
        seen = np.abs(curve.derivative(order)(dense)).max(axis=0)
        assert (seen <= value * (1.0 + 1e-9) + 1e-9).all()
        assert (seen >= value * 0.98 - 1e-9).all()


def test_derivatives_of_the_path_fit(make_trajectory: TrajectoryMaker) -> None:
    trajectory = make_trajectory(4)
    path, curve = CubicPath(trajectory), trajectory.interpolant()
    s = np.linspace(0.001, trajectory.duration - 0.001, 77)
    for order, value in enumerate(path.curve.derivatives(s), start=1):
        assert np.allclose(value, curve.derivative(order)(s), atol=1e-8)
    assert np.allclose(path.curve.at(s)[0], curve(s), atol=1e-14)


@pytest.mark.slow
@pytest.mark.parametrize(("rate", "longest"), [(1.0, 0.9), (0.2, 0.3)])
def test_a_hold_anywhere_in_a_real_plan_is_short(
    stream_limits: StreamLimits, rate: float, longest: float
) -> None:
    from unwrinkle.models.robot import load_cell
    from unwrinkle.planning.search.planner import FlatteningPlanner
    from unwrinkle.testing.targets import flattening_task

    plan = FlatteningPlanner(load_cell()).plan(flattening_task((0.0, -1.10), 0.4)).plan
    assert plan is not None
    took = []
    for segment in plan.segments:
        trajectory = segment.trajectory
        for time in np.arange(0.05, trajectory.duration / rate, 0.07 / rate):
            clock = PathClock(trajectory, stream_limits, rate=rate)
            points = clock.next_until(float(time))
            begin = points[-1].time
            clock.set_rate(0.0)
            points += clock.next_until(np.inf)
            took.append(points[-1].time - begin)
            assert clock.at_rest
            assert greatest_use(points, trajectory, stream_limits) <= 1.0 + 2e-6
            assert distance_from_path(points, trajectory) < 1e-5
    assert max(took) < longest and np.median(took) < 0.6 * longest


def test_after_a_change_the_full_rate_is_the_trajectorys_own_samples_again(
    make_trajectory: TrajectoryMaker, stream_limits: StreamLimits
) -> None:
    trajectory = make_trajectory(5)
    own = {row.tobytes() for row in trajectory.positions}
    for low in (0.0, 0.3, 0.8):
        clock = PathClock(trajectory, stream_limits)
        points = clock.next_until(0.3 * trajectory.duration)
        clock.set_rate(low)
        points += clock.next_until(points[-1].time + 0.2)
        clock.set_rate(1.0)
        after = clock.next_until(np.inf)
        full = [point for point in after if point.rate == 1.0]
        assert len(full) > 20 and full[-1].s == trajectory.duration
        assert {point.positions.tobytes() for point in full} <= own


def test_rates_just_below_one_are_run_a_little_slower(
    make_trajectory: TrajectoryMaker, stream_limits: StreamLimits
) -> None:
    for wanted, run in (
        (0.999, HIGHEST_REDUCED_RATE),
        (HIGHEST_REDUCED_RATE, HIGHEST_REDUCED_RATE),
        (0.9, 0.9),
        (1.0, 1.0),
    ):
        clock = PathClock(make_trajectory(5), stream_limits, rate=wanted)
        assert clock.target == run
        points = clock.next_until(np.inf)
        assert greatest_use(points, clock.trajectory, stream_limits) <= 1.0 + 2e-6


@pytest.mark.slow
@pytest.mark.parametrize("speed", [1.0, 0.2, 0.1])
def test_limits_of_a_real_plan_are_kept_through_holds_and_resumes(speed: float) -> None:
    from unwrinkle.models.robot import load_cell
    from unwrinkle.models.scenario import load_scenario
    from unwrinkle.planning.search.planner import FlatteningPlanner
    from unwrinkle.planning.sent_samples import as_sent
    from unwrinkle.testing.targets import flattening_task

    scenario = load_scenario()
    scenario.speed = speed
    cell = load_cell(scenario)
    plan = FlatteningPlanner(cell).plan(flattening_task((0.0, -1.10), 0.2)).plan
    assert plan is not None
    limits, rng = StreamLimits.of(cell.limits), np.random.default_rng(1)
    for segment in plan.segments:
        trajectory = as_sent(segment.trajectory)
        for low in (0.0, 0.0, 0.5, 0.8, 0.99):
            clock = PathClock(trajectory, limits)
            points = clock.next_until(rng.uniform(0.1, 0.9) * trajectory.duration)
            clock.set_rate(low)
            points += clock.next_until(points[-1].time + rng.uniform(0.1, 0.8))
            clock.set_rate(1.0)
            points += clock.next_until(np.inf)
            used = rate_extremes(*arrays(points))
            bounds = (limits.velocity, limits.acceleration, limits.jerk)
            assert max((a / b).max() for a, b in zip(used, bounds, strict=True)) <= 1.0 + 1e-6
