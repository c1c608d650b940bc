"""The way back from a missed grasp: the verified approach, run backwards."""

import dataclasses as dc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from unwrinkle.flattening.execution.retreat import retreat, reversed_in_time
from unwrinkle.models.errors import InputError
from unwrinkle.planning.plan import Segment
from unwrinkle.planning.trajectory import Trajectory


def approach(seed: int, count: int = 12) -> Segment:
    rng = np.random.default_rng(seed)
    times = np.concatenate([[0.0], np.cumsum(rng.uniform(0.004, 0.05, count - 1))])
    velocities = rng.normal(size=(count, 13))
    velocities[[0, -1]] = 0.0
    motion = Trajectory(times, rng.normal(size=(count, 13)), velocities)
    return Segment("approach", 0.0, motion, (False, False), (), (0.0, 0.0))


@settings(max_examples=30)
@given(st.integers(0, 1000), st.floats(0.0, 1.0))
def test_same_places_mirrored_in_time(seed: int, share: float) -> None:
    there = approach(seed).trajectory
    back = retreat(approach(seed))
    assert back.duration == there.duration
    t = share * there.duration
    for order, sign in ((0, 1.0), (1, -1.0)):
        forward = there.interpolant()(there.duration - t, order)
        np.testing.assert_allclose(
            back.interpolant()(t, order), sign * forward, atol=1e-6, rtol=1e-6
        )
    np.testing.assert_array_equal(back.positions[-1], there.positions[0])


def test_reversing_twice_gives_the_motion() -> None:
    there = approach(3).trajectory
    again = reversed_in_time(reversed_in_time(there))
    np.testing.assert_allclose(again.times, there.times, atol=1e-15)
    np.testing.assert_array_equal(again.velocities, there.velocities)


def test_only_an_open_rest_to_rest_approach() -> None:
    segment = approach(1)
    with pytest.raises(InputError, match="open grippers"):
        retreat(dc.replace(segment, closed=(True, False)))
    velocities = segment.trajectory.velocities.copy()
    velocities[0] = 0.1
    moving = dc.replace(segment.trajectory, velocities=velocities)
    with pytest.raises(InputError, match="rest to rest"):
        retreat(dc.replace(segment, trajectory=moving))
