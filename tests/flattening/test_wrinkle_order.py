"""Which wrinkle comes first."""

import dataclasses as dc

import numpy as np
import pytest

from unwrinkle.flattening.observation import Observation, WrinkleFeatures
from unwrinkle.flattening.policy import (
    GarmentFeatures,
    PolicyState,
    PullDecision,
    decide,
)
from unwrinkle.flattening.wrinkle_order import flattened_together, in_order
from unwrinkle.models import scenario
from unwrinkle.models.errors import InputError
from unwrinkle.models.scenario import LoopSettings
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.wrinkles.analysis import analyse
from unwrinkle.simulation.rendering.synthetic_towel import Ridge, Towel
from unwrinkle.testing.table import TABLE

# Each is first in one order: volume, pull, height, length, together.
SEEN = tuple(
    WrinkleFeatures(k, (0.1 * k, -1.1), 0.3, *measures)
    for k, measures in enumerate(
        [
            (9e4, 0.010, 0.010, 0.20, 9e4),
            (8e4, 0.020, 0.011, 0.20, 8e4),
            (7e4, 0.012, 0.015, 0.20, 8e4),
            (6e4, 0.012, 0.010, 0.30, 7e4),
            (5e4, 0.012, 0.010, 0.20, 9.5e4),
        ]
    )
)


@pytest.mark.parametrize(("order", "first"), [(o, k) for k, o in enumerate(scenario.ORDERS)])
def test_the_order_decides_which_wrinkle_is_pulled_first(order: str, first: int) -> None:
    decision = decide(GarmentFeatures(SEEN), PolicyState(), LoopSettings(order=order))
    assert isinstance(decision, PullDecision)
    assert decision.wrinkle.index == first
    ordered = in_order(SEEN, order)
    values = [getattr(wrinkle, order) for wrinkle in ordered]
    assert values == sorted(values, reverse=True) and set(ordered) == set(SEEN)


def test_the_default_is_the_published_rule_and_alike_wrinkles_stay_in_place() -> None:
    assert LoopSettings().order == "volume" and in_order(SEEN, "volume") == list(SEEN)
    alike = [dc.replace(wrinkle, pull=0.01) for wrinkle in SEEN]
    assert in_order(alike, "pull") == alike
    with pytest.raises(InputError, match="order 'colour': must be one of volume"):
        in_order(SEEN, "colour")


def test_a_pull_works_on_the_wrinkles_that_its_section_crosses() -> None:
    """Two parallel wrinkles, and one beside them that no section of theirs crosses but whose own
    crosses neither.
    """
    ridges = (
        Ridge((-0.05, -1.17), 0.0, 0.016, 0.010, 0.2),
        Ridge((-0.05, -1.03), 0.0, 0.014, 0.010, 0.2),
        Ridge((0.15, -1.10), 0.5 * np.pi, 0.015, 0.010, 0.24),
    )
    towel = Towel(ridges=ridges, side=0.5, waviness=0.0)
    x, y = np.meshgrid(-0.3 + 0.001 * np.arange(601), -1.4 + 0.001 * np.arange(601))
    seen = RangeMap(
        height=towel.height(x, y).astype(np.float32),
        valid=np.ones(x.shape, bool),
        garment=towel.edge_distance(x, y) > 0.0,
        resolution=0.001,
        origin=np.array([-0.3, -1.4]),
        table_height=0.7,
        sensor="stereo-head",
    )
    analysis = analyse(seen, table=TABLE)
    wrinkles = analysis.wrinkles[:3]
    upright = next(k for k, w in enumerate(wrinkles) if abs(w.direction[1]) > 0.9)
    volumes = np.exp([w.volume_score for w in wrinkles])
    together = flattened_together(wrinkles)
    for k in range(3):
        whole = volumes[k] if k == upright else volumes.sum() - volumes[upright]
        assert together[k] == pytest.approx(whole, rel=0.02)
    sight = Observation.of(analysis).features
    assert sight.wrinkles[upright].together == pytest.approx(volumes[upright], rel=0.02)
    assert sight.wrinkles[upright].length == wrinkles[upright].length
    decision = decide(sight, PolicyState(), LoopSettings(order="together"))
    assert isinstance(decision, PullDecision) and decision.wrinkle.index != upright
