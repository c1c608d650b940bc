"""Layers of the simulated cloth, and its folded starts, against the geometry of a fold."""

import math

import numpy as np
import pytest

from unwrinkle.models.cloth import load_material
from unwrinkle.models.errors import InputError
from unwrinkle.simulation.cloth.cloth import Cloth
from unwrinkle.simulation.cloth.folded_states import FoldLine, folded_state, pressed
from unwrinkle.simulation.cloth.layers import layer_map
from unwrinkle.simulation.cloth.outlines import outline
from unwrinkle.testing.table import TABLE

CENTRE = (0.0, -1.1)


@pytest.fixture(scope="module")
def cloth() -> Cloth:
    return Cloth(outline("towel", 60), load_material("terry"), TABLE)


def test_flat_cloth_is_one_layer(cloth: Cloth) -> None:
    found = layer_map(cloth, cloth.flat(CENTRE, 0.2))
    assert set(np.unique(found.layers)) == {0, 1}
    assert (found.layers > 0).sum() * found.resolution**2 == pytest.approx(
        cloth.outline.area, rel=0.01
    )
    assert found.face_up[found.layers > 0].all()
    assert not found.folded().any() and not found.borders().any()


def test_a_pressed_corner_is_two_layers_with_its_underside_up(cloth: Cloth) -> None:
    flat = cloth.flat(CENTRE)
    half = 0.5 * float(np.ptp(cloth.rest[:, 0]))
    normal = np.array([math.sqrt(0.5), math.sqrt(0.5)])
    line = FoldLine(normal, math.sqrt(2.0) * half - 0.12, np.array([[half, half]]))
    found = layer_map(cloth, pressed(cloth, flat, line, 0.002))
    double = found.folded()
    # A right-angled triangle of height 0.12 m; the fold takes up pi * radius of it.
    assert double.sum() * found.resolution**2 == pytest.approx((0.12 - 0.006) ** 2, rel=0.06)
    assert not found.face_up[double].any()
    border = found.borders()
    assert border.sum() * found.resolution == pytest.approx(2 * 0.12 * math.sqrt(2.0), rel=0.25)
    assert np.nanmax(found.height) == pytest.approx(0.004, abs=1e-4)


@pytest.mark.parametrize("name", ["corner", "edge", "pressed"])
def test_a_folded_start_has_a_flap(cloth: Cloth, name: str) -> None:
    state = folded_state(cloth, name, CENTRE, 3)
    found = layer_map(cloth, state)
    area = found.folded().sum() * found.resolution**2
    assert 0.004 < area < 0.08
    assert (found.layers > 2).sum() < 0.01 * (found.layers > 0).sum()
    again = folded_state(cloth, name, CENTRE, 3)
    np.testing.assert_array_equal(state.positions, again.positions)


def test_unknown_starts_and_resolutions_are_refused(cloth: Cloth) -> None:
    with pytest.raises(InputError, match="corner, edge"):
        folded_state(cloth, "origami", CENTRE, 0)
    with pytest.raises(InputError, match="resolution"):
        layer_map(cloth, cloth.flat(CENTRE), 0.0)
