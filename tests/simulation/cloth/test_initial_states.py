"""Initial states: size, rest, repeatability, refused input."""

from typing import Any

import numpy as np
import pytest

from unwrinkle.models.cloth import load_material
from unwrinkle.models.errors import InputError
from unwrinkle.models.scenario import STARTS
from unwrinkle.simulation.cloth.cloth import Cloth
from unwrinkle.simulation.cloth.fingers import carry, let_go, take
from unwrinkle.simulation.cloth.initial_states import bunched, dropped, ridge, start_state
from unwrinkle.simulation.cloth.measures import coverage, largest_height, measure, overstretch
from unwrinkle.simulation.cloth.outlines import outline
from unwrinkle.testing.table import TABLE

CENTRE = (0.0, -1.1)


@pytest.fixture(scope="module")
def cloth() -> Cloth:
    return Cloth(outline("towel", 60), load_material("terry"), TABLE)


@pytest.fixture(scope="module")
def coarse() -> Cloth:
    return Cloth(outline("towel", 32), load_material("terry"), TABLE)


def test_a_ridge_takes_up_its_slack_and_stays(cloth: Cloth) -> None:
    state = ridge(cloth, CENTRE, 0.0, slack=0.025, base=0.045)
    assert state.asleep
    assert abs((1.0 - coverage(cloth, state)) * 0.48 - 0.025) < 0.002
    assert 0.020 < largest_height(cloth, state) < 0.030
    assert overstretch(cloth, state) < 0.005
    # It runs along y through the middle.
    vertices = cloth.vertices(state)
    high = vertices[vertices[:, 2] > 0.71]
    assert np.ptp(high[:, 1]) > 0.46
    assert abs(high[:, 0].mean()) < 0.005


def test_a_ridge_is_where_and_how_it_is_asked_for(cloth: Cloth) -> None:
    direction, offset = 0.6, 0.05
    state = ridge(cloth, CENTRE, direction, offset=offset)
    vertices = cloth.vertices(state)
    high = vertices[vertices[:, 2] > 0.71, :2] - CENTRE
    across = high @ [np.cos(direction), np.sin(direction)]
    assert abs(across.mean() - offset) < 0.006
    assert np.ptp(across) < 0.05


def test_more_slack_is_a_higher_ridge(coarse: Cloth) -> None:
    heights = [largest_height(coarse, ridge(coarse, CENTRE, 0.0, s)) for s in (0.015, 0.025, 0.04)]
    assert (np.diff(heights) > 0.003).all()


def test_two_hands_pull_a_ridge_flat() -> None:
    cloth = Cloth(outline("towel", 80), load_material("terry"), TABLE)
    slack = 0.025
    state = ridge(cloth, CENTRE, 0.0, slack)
    for hand, sign in enumerate((1.0, -1.0)):
        state = take(cloth, state, hand, (sign * 0.225, -1.1, 0.70))
        assert state.grips[hand] is not None
    up, pull = np.array([0.0, 0.0, 0.01]), np.array([1.1 * slack, 0.0, 0.0])
    state = carry(cloth, state, (up, up), 0.3)
    state = carry(cloth, state, (pull, -pull), 1.5)
    state = carry(cloth, state, (-up, -up), 0.3)
    state = cloth.settle(let_go(cloth, state))
    truth = measure(cloth, state)
    assert truth.height < 1.5e-3
    assert truth.coverage > 0.99


@pytest.mark.parametrize("values", [(0.0, 0.0), (0.0, np.nan), (0.0, 0.2), (np.inf, 0.02)])
def test_impossible_ridges_are_refused(coarse: Cloth, values: tuple[float, float]) -> None:
    with pytest.raises(InputError, match="ridge"):
        ridge(coarse, CENTRE, *values)


def test_a_ridge_beside_the_cloth_is_refused(coarse: Cloth) -> None:
    with pytest.raises(InputError, match="hangs over the border"):
        ridge(coarse, CENTRE, 0.0, offset=0.23)


def test_a_bunched_towel_is_wrinkled_not_folded(cloth: Cloth) -> None:
    truth = measure(cloth, bunched(cloth, CENTRE, 0))
    assert 0.015 < truth.height < 0.045
    assert 0.85 < truth.coverage < 0.99
    assert truth.above_5mm > 0.05


def test_seeds_repeat_and_differ(coarse: Cloth) -> None:
    first, again, other = (start_state(coarse, "bunched", CENTRE, seed) for seed in (3, 3, 4))
    assert first.positions.tobytes() == again.positions.tobytes()
    assert first.curvatures.tobytes() == again.curvatures.tobytes()
    assert np.abs(first.positions - other.positions).max() > 0.005


@pytest.mark.parametrize("name", STARTS)
def test_every_start_is_on_the_table_at_time_zero(coarse: Cloth, name: str) -> None:
    state = start_state(coarse, name, CENTRE, 1)
    vertices = coarse.vertices(state)
    assert state.time == 0.0
    assert not state.held
    assert vertices[:, 2].min() >= 0.70125 - 1e-9
    assert (np.abs(vertices[:, :2] - TABLE.centre) < 0.4).all()
    assert state.asleep == (name == "flat" or state.asleep)
    assert (largest_height(coarse, state) < 1e-9) == (name == "flat")


def test_a_dropped_towel_is_a_heap(coarse: Cloth) -> None:
    truth = measure(coarse, dropped(coarse, CENTRE, 0))
    assert truth.coverage < 0.85
    assert truth.height > 0.01


@pytest.mark.parametrize("garment", ["tshirt", "trousers", "dishcloth"])
def test_other_garments_are_bunched_too(garment: str) -> None:
    cloth = Cloth(outline(garment, 48), load_material("jersey"), TABLE)
    truth = measure(cloth, start_state(cloth, "bunched", CENTRE, 0))
    assert truth.height > 0.008
    assert 0.7 < truth.coverage < 0.995


@pytest.mark.parametrize(
    ("name", "seed", "message"),
    [
        ("crumpled", 0, "no start is called"),
        ("bunched", -1, "seed"),
        ("bunched", 1.5, "seed"),
        ("flat", True, "seed"),
    ],
)
def test_bad_starts_are_refused(coarse: Cloth, name: str, seed: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        start_state(coarse, name, CENTRE, seed)


def test_bad_numbers_are_refused(coarse: Cloth) -> None:
    with pytest.raises(InputError, match="0 pinches"):
        bunched(coarse, CENTRE, 0, pinches=0)
    with pytest.raises(InputError, match="height"):
        dropped(coarse, CENTRE, 0, height=2.0)
    with pytest.raises(InputError, match="duration"):
        carry(coarse, coarse.flat(CENTRE), (None, None), 0.03)
    with pytest.raises(InputError, match="beyond the table"):
        start_state(coarse, "bunched", (0.3, -1.1), 0)
