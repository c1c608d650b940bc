"""Short plans: what they promise to what carries plans out."""

import numpy as np
import pytest

from unwrinkle.testing.plans import short_plan, verdict_of

HOME = np.linspace(-0.3, 0.4, 13)


def test_segments_follow_each_other_at_rest() -> None:
    plan = short_plan(HOME)
    motions = [segment.trajectory for segment in plan.segments]
    for motion, following in zip(motions, [*motions[1:], motions[0]], strict=True):
        np.testing.assert_allclose(motion.positions[-1], following.positions[0], atol=1e-12)
        np.testing.assert_allclose(motion.velocities[[0, -1]], 0.0, atol=1e-12)
    for event, segment in zip(plan.events, plan.segments, strict=False):
        assert event.time == pytest.approx(segment.end)


def test_velocities_are_the_derivative_of_the_positions() -> None:
    motion = short_plan(HOME).segments[0].trajectory.interpolant()
    rate = (motion(0.25 + 1e-6) - motion(0.25 - 1e-6)) / 2e-6
    np.testing.assert_allclose(motion(0.25, 1), rate, rtol=1e-6)


def test_names_make_hashes_and_problems_make_failures() -> None:
    assert short_plan(HOME, "a").content_hash != short_plan(HOME, "b").content_hash
    assert verdict_of("x").passed and not verdict_of("x", "too near").passed
