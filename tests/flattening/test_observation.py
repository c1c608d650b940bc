"""What the judgement sees of an analysis."""

import dataclasses as dc

import numpy as np
import pytest

from unwrinkle.flattening.observation import GarmentFeatures, Observation, WrinkleFeatures
from unwrinkle.models.scenario import LoopSettings
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.wrinkles.analysis import analyse
from unwrinkle.simulation.rendering.synthetic_towel import Ridge, Towel
from unwrinkle.testing.table import TABLE


def test_a_ridge_that_rises_towards_the_rim_is_as_high_as_at_its_highest():
    ridge = Ridge(centre=(0.10, -1.10), angle=0.0, height=0.006, sigma=0.009, length=0.24)
    towel = Towel(ridges=(ridge,), waviness=0.0)
    x, y = np.meshgrid(-0.3 + 0.001 * np.arange(601), -1.4 + 0.001 * np.arange(601))
    bare = dc.replace(towel, ridges=()).height(x, y)
    rising = np.clip((x + 0.02) / 0.26, 0.1, 1.0)
    seen = RangeMap(
        height=(bare + rising * (towel.height(x, y) - bare)).astype(np.float32),
        valid=np.ones(x.shape, bool),
        garment=towel.edge_distance(x, y) > 0.0,
        resolution=0.001,
        origin=np.array([-0.3, -1.4]),
        table_height=0.7,
        sensor="stereo-head",
    )
    analysis = analyse(seen, table=TABLE)
    sight = Observation.of(analysis).features
    assert analysis.wrinkles[0].peak_height < 0.004
    assert 0.0043 < sight.wrinkles[0].height < 0.0062
    assert sight.worth_pulling(LoopSettings(halting_height=0.004))[0].index == 0


@pytest.mark.parametrize(("noise", "worth"), [(0.0003, 1), (0.0030, 0)])
def test_heights_within_the_noise_are_no_reason_to_pull(noise: float, worth: int):
    low = WrinkleFeatures(
        index=0, centre=(0, -1.1), angle=0.0, volume=9.0, pull=0.001, height=0.005
    )
    assert LoopSettings().noise_multiple * 0.0030 > 0.005
    assert (
        len(GarmentFeatures((low,), 0.005, noise).worth_pulling(LoopSettings(halting_height=0.004)))
        == worth
    )
