"""Synthetic towels: their closed forms, and the comparison with what was found."""

import pytest

from unwrinkle.perception.wrinkles.analysis import analyse
from unwrinkle.simulation.rendering.synthetic_towel import Ridge
from unwrinkle.testing.table import TABLE
from unwrinkle.testing.towels import (
    compare,
    crossed_towel,
    crossing_separated,
    formula_chord_height,
    formula_width,
    map_of,
    ridged_towel,
)


def test_the_formulas() -> None:
    ridge = Ridge((0.0, 0.0), 0.0, 0.022, 0.0135, 0.2)
    assert formula_width(ridge) == pytest.approx(0.027)
    assert formula_chord_height(ridge) == pytest.approx(0.00866, abs=1e-5)


def test_compare_sees_what_is_missed_and_what_is_too_much() -> None:
    towel, other = ridged_towel(0), ridged_towel(1)
    found = analyse(map_of(towel, 0.001), table=TABLE)
    assert compare(towel, found).missed == 0
    assert max(compare(other, found).width, default=1.0) > 0.0003
    assert not crossing_separated(crossed_towel(0), found)
