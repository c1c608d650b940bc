"""Range map of the true shape: position, height and noise."""

import numpy as np
import pytest

from unwrinkle.flattening.observation import Observation
from unwrinkle.flattening.policy import PolicyState, Stop, decide
from unwrinkle.models.cloth import load_material
from unwrinkle.models.errors import InputError
from unwrinkle.models.scenario import LoopSettings
from unwrinkle.models.table import Table
from unwrinkle.perception.sensor import noise_profile
from unwrinkle.perception.wrinkles.analysis import analyse
from unwrinkle.simulation.cloth.cloth import Cloth
from unwrinkle.simulation.cloth.outlines import outline
from unwrinkle.systems.perception.true_range_map import true_range_map

TABLE = Table((0.0, -1.10), (0.8, 0.8), 0.70)


def _towel(spread: tuple[float, float] = TABLE.size) -> Cloth:
    table = Table(TABLE.centre, spread, TABLE.height)
    return Cloth(outline("towel", 40), load_material("terry"), table)


def test_a_flat_towel_lies_where_it_is_and_is_as_thick_as_it_is() -> None:
    cloth = _towel()
    state = cloth.flat((0.05, -1.12))
    seen = true_range_map(cloth, state, seed=3)
    noise = noise_profile("stereo-head").depth_noise
    rows, columns = np.nonzero(seen.garment)
    middle = seen.world_from_cell(np.array([columns.mean(), rows.mean()]))
    assert np.allclose(middle, (0.05, -1.12), atol=1e-3)
    assert seen.garment.sum() * seen.resolution**2 == pytest.approx(cloth.outline.area, rel=0.01)
    on, off = seen.height[seen.garment], seen.height[~seen.garment]
    assert on.mean() == pytest.approx(cloth.material.thickness, abs=0.1 * noise)
    assert off.mean() == pytest.approx(0.0, abs=0.1 * noise)
    assert on.std() == pytest.approx(noise, rel=0.05)
    assert seen.valid.all() and seen.table_height == 0.70
    steps = np.diff(off[:2000])
    assert steps.std() < 0.5 * noise  # alike from cell to cell
    found = analyse(seen, table=TABLE)
    decision = decide(Observation.of(found).features, PolicyState(), LoopSettings())
    assert isinstance(decision, Stop) and decision.flat


def test_same_seed_same_map_and_another_noise_for_another_seed() -> None:
    cloth = _towel()
    state = cloth.flat(TABLE.centre)
    one, same, other = (true_range_map(cloth, state, seed) for seed in (1, 1, 2))
    assert np.array_equal(one.height, same.height)
    assert not np.array_equal(one.height, other.height)


def test_cells_beside_the_table_are_not_valid() -> None:
    cloth = _towel((0.5, 0.5))
    seen = true_range_map(cloth, cloth.flat(TABLE.centre), 0)
    assert not seen.valid[0].any() and not seen.valid[:, -1].any()
    assert seen.valid[seen.garment].all()


@pytest.mark.parametrize(("sensor", "seed"), [("xtion", 0), ("stereo-head", -1)])
def test_bad_input_is_refused(sensor: str, seed: int) -> None:
    cloth = _towel()
    with pytest.raises(InputError, match="range map of the true cloth"):
        true_range_map(cloth, cloth.flat(TABLE.centre), seed, sensor=sensor)
