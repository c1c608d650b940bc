"""What the wire carries of a trajectory."""

import struct

import numpy as np
import pytest

from unwrinkle.models.errors import InputError
from unwrinkle.planning.sent_samples import LONGEST, as_sent, whole_milliseconds
from unwrinkle.planning.trajectory import AXES, Trajectory


def motion(times: np.ndarray, seed: int = 0) -> Trajectory:
    """A smooth motion from rest to rest, sampled at the times."""
    rng = np.random.default_rng(seed)
    start, way = rng.uniform(-2.5, 2.5, AXES), rng.uniform(-0.5, 0.5, AXES)
    x = (times / times[-1])[:, None]
    s, rate = 10 * x**3 - 15 * x**4 + 6 * x**5, 30 * x**2 * (1 - x) ** 2 / times[-1]
    return Trajectory(times, start + s * way, rate * way)


CLOCKS = {
    "whole": np.arange(150) * 0.008,
    "8.5 ms": np.arange(150) * 0.0085,
    "uneven": np.concatenate([[0.0], np.sort(np.random.default_rng(3).uniform(1e-5, 1.2, 200))]),
    "crowded": np.linspace(0.0, 0.05, 2000),
    "short": np.array([0.0, 3e-4]),
}


@pytest.mark.parametrize("clock", CLOCKS.values(), ids=CLOCKS)
def test_times_are_whole_and_numbers_are_float32(clock: np.ndarray) -> None:
    sent = as_sent(motion(clock))
    assert np.array_equal(sent.times, np.rint(sent.times * 1000.0) / 1000.0)
    for values in (sent.positions, sent.velocities):
        assert np.array_equal(values, values.astype(np.float32).astype(float))
    assert clock[-1] - 1e-9 <= sent.duration < clock[-1] + 1e-3


@pytest.mark.parametrize("clock", CLOCKS.values(), ids=CLOCKS)
def test_twice_is_once(clock: np.ndarray) -> None:
    once = as_sent(motion(clock))
    twice = as_sent(once)
    for name in ("times", "positions", "velocities"):
        assert np.array_equal(getattr(once, name), getattr(twice, name))


@pytest.mark.parametrize("clock", CLOCKS.values(), ids=CLOCKS)
def test_ends_stay_at_rest_where_they_were(clock: np.ndarray) -> None:
    planned = motion(clock)
    sent = as_sent(planned)
    assert not sent.velocities[[0, -1]].any()
    ends = planned.positions[[0, -1]].astype(np.float32).astype(float)
    assert np.array_equal(sent.positions[[0, -1]], ends)


def test_whole_milliseconds_keep_their_samples() -> None:
    """Times that are sums of steps are off by rounding; they count as whole."""
    planned = motion(np.cumsum(np.full(400, 0.008)) - 0.008)
    sent = as_sent(planned)
    assert np.array_equal(sent.times, whole_milliseconds(planned.times))
    assert np.array_equal(sent.positions, planned.positions.astype(np.float32).astype(float))


def test_other_times_get_the_positions_of_those_times() -> None:
    planned = motion(CLOCKS["uneven"])
    sent = as_sent(planned)
    expected = planned.interpolant()(sent.times[:-1])
    assert np.abs(sent.positions[:-1] - expected).max() < 2e-7
    # Not those of the times before rounding, which are up to half a millisecond of motion away.
    before = [planned.positions[np.abs(planned.times - t).argmin()] for t in sent.times[:-1]]
    assert np.abs(sent.positions[:-1] - before).max() > 1e-4


def test_a_controller_that_cuts_times_gets_the_whole_milliseconds() -> None:
    for clock in (CLOCKS["whole"], np.arange(1, 3000) * 2.667, [LONGEST]):
        ms = np.rint(np.asarray(clock) * 1000.0).astype(int)
        for k in ms[::17]:
            (carried,) = struct.unpack("<f", struct.pack("<f", (k + 0.4) / 1000.0))
            assert int(np.float32(carried) * np.float32(1000.0)) == k
            assert int(carried * 1000.0) == k


def test_what_cannot_be_carried_is_refused() -> None:
    with pytest.raises(InputError, match="clock"):
        as_sent(motion(np.array([0.0, 1.0, LONGEST + 1.0])))
    good = motion(CLOCKS["whole"])
    velocities = good.velocities.copy()
    velocities[5, 3] = 1e308
    with pytest.raises(InputError, match="float32"):
        as_sent(Trajectory(good.times, good.positions, velocities))
    with pytest.raises(InputError, match=r"float32|finite"):
        as_sent(Trajectory(good.times * 1.0625, good.positions, velocities))
