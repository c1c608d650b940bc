"""Fixture: ray-traced stereo pair of a towel on the table."""

import pytest

from unwrinkle.simulation.rendering.synthetic_towel import Ridge, Towel
from unwrinkle.testing.traced_pair import TracedPair, traced_pair


@pytest.fixture(scope="session")
def seen_towel() -> TracedPair:
    """A towel with two ridges, seen by the head at a quarter of its resolution, with noise."""
    return traced_pair(
        Towel(
            ridges=(
                Ridge((-0.05, -1.10), 1.3, 0.022, 0.016, 0.30),
                Ridge((0.12, -1.12), 1.8, 0.018, 0.014, 0.20),
            )
        )
    )
