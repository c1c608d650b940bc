"""The checker of what was sent.

It sees what is beyond a limit, and forgives the wire's rounding alone.
"""

import numpy as np
import pytest

from tests.robustness.rig.driver_rig import swing
from tests.robustness.rig.sent_limits import SentPoints, limit_violations
from unwrinkle.testing.cells import cell

pytestmark = pytest.mark.alone

LIMITS = cell().limits
ALL = np.arange(13)


def sent(scale: float = 1.0, faster: float = 1.0, *, single: bool = True) -> SentPoints:
    motion = swing(np.zeros(13), scale * np.full(13, 0.2))
    kind = np.float32 if single else np.float64
    return SentPoints(
        ALL,
        motion.times,
        (motion.times / faster).astype(kind).astype(float),
        motion.positions.astype(kind).astype(float),
        (faster * motion.velocities).astype(kind).astype(float),
    )


@pytest.mark.parametrize("single", [False, True])
def test_the_standard_motion_is_within_all_limits(single: bool) -> None:
    assert limit_violations([sent(single=single)], LIMITS) == []


@pytest.mark.parametrize(
    ("faster", "kinds"), [(2.5, {"jerk"}), (9.0, {"jerk", "acceleration", "velocity"})]
)
def test_a_motion_that_is_too_fast_is_seen(faster: float, kinds: set[str]) -> None:
    found = limit_violations([sent(faster=faster)], LIMITS)
    assert kinds <= {text.split()[0] for text in found}


def test_positions_between_points_count() -> None:
    axis = 3
    edge = LIMITS.upper[axis]
    positions = np.full((2, 1), edge - 1e-4)
    velocities = np.array([[0.1], [-0.1]])
    stream = SentPoints(np.array([axis]), np.zeros(2), np.array([0.0, 0.1]), positions, velocities)
    assert any("position of axis 3" in text for text in limit_violations([stream], LIMITS))


def test_a_wrong_velocity_of_one_point_is_a_jerk() -> None:
    stream = sent()
    velocities = stream.velocities.copy()
    velocities[60, 5] += 0.05
    spoilt = SentPoints(ALL, stream.clock, stream.times, stream.positions, velocities)
    assert any("jerk of axis 5" in text for text in limit_violations([spoilt], LIMITS))


def test_what_is_no_number_or_no_time_is_a_violation() -> None:
    stream = sent()
    positions = stream.positions.copy()
    positions[7, 2] = np.nan
    spoilt = SentPoints(ALL, stream.clock, stream.times, positions, stream.velocities)
    assert "not finite" in limit_violations([spoilt], LIMITS)[0]
    back = SentPoints(ALL, stream.clock, stream.times[::-1], stream.positions, stream.velocities)
    assert "does not increase" in limit_violations([back], LIMITS)[0]
