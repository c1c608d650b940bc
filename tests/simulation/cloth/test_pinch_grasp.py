"""Pinch grasp: ridges are caught; flat cloth and plateaus are not."""

import dataclasses as dc

import numpy as np
import pytest
from numpy.typing import NDArray

from unwrinkle.models.blades import Blades, load_blades
from unwrinkle.models.cloth import load_material
from unwrinkle.models.errors import InputError
from unwrinkle.models.table import Table
from unwrinkle.simulation.cloth.cloth import Cloth, ClothState
from unwrinkle.simulation.cloth.outlines import Outline
from unwrinkle.simulation.cloth.pinch_grasp import LEAST_DEPTH, catch, lift

OPENING = 0.030
TABLE = Table((0.0, -1.10), (0.8, 0.8), 0.70)
LEVEL = Blades(
    width=0.025, thickness=0.003, lower_end=0.0, upper_end=0.0
)  # tips alike, stood upright


def _cloth() -> Cloth:
    return Cloth(
        Outline("patch", np.ones((61, 31), dtype=bool), 0.004), load_material("terry"), TABLE
    )


def _raised(cloth: Cloth, height: float, half: float, *, flat_top: float = 0.004) -> ClothState:
    """Return the flat cloth with a trapezoidal ridge along y, not settled.

    `half` is a side's width.
    """
    state = cloth.flat(TABLE.centre)
    positions = state.positions.copy()
    across = np.maximum(np.abs(positions[0] - TABLE.centre[0]) - flat_top, 0.0)
    positions[2] += height * np.clip(1.0 - across / half, 0.0, 1.0)
    return dc.replace(state, positions=positions, asleep=False)


def _above(x: float, tip: float) -> NDArray[np.float64]:
    """Upright blades with their middle over x, closing along x, tips this high above the table."""
    X_WT = np.eye(4)
    X_WT[:3, :3] = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    middle = LEVEL.middle(OPENING)[0]
    X_WT[:3, 3] = [TABLE.centre[0] + x - middle, TABLE.centre[1], TABLE.height + tip]
    return X_WT


def test_a_ridge_between_the_blades_is_caught_and_lifted() -> None:
    cloth = _cloth()
    state = _raised(cloth, 0.020, 0.008)
    held = catch(cloth, state, _above(0.0, 0.003), LEVEL, OPENING)
    assert held.caught and held.withheld == 0.0 and held.layers == 1
    # The crest is half a thickness and 20 mm above the table, the tips 3 mm.
    assert held.depth == pytest.approx(0.020 + 0.00125 - 0.003, abs=1e-4)
    places = state.positions[:, held.nodes]
    assert np.abs(places[0]).max() <= 0.5 * OPENING
    assert np.abs(places[1] - TABLE.centre[1]).max() <= 0.0125
    assert places[2].min() >= TABLE.height + 0.003
    lifted = lift(cloth, state, held, hand=1)
    assert lifted.state.grips[0] is None and lifted.state.grips[1] is not None
    rise = lifted.state.positions[2, held.nodes] - places[2]
    assert rise == pytest.approx(0.10, abs=1e-6)
    assert 2e-3 < lifted.area < cloth.outline.area
    weight = cloth.outline.area * cloth.material.areal_density * 9.81
    assert 0.2 * weight < lifted.weight <= weight


def test_flat_cloth_is_not_caught() -> None:
    cloth = _cloth()
    state = cloth.flat(TABLE.centre)
    held = catch(cloth, state, _above(0.0, 0.003), LEVEL, OPENING)
    assert not held.caught and held.depth < 0.0 and len(held.nodes) == 0
    assert "5 mm are needed" in held.reason
    with pytest.raises(InputError, match="nothing is caught"):
        lift(cloth, state, held)


def test_a_ridge_lower_than_the_least_depth_slips_out() -> None:
    cloth = _cloth()
    tip = 0.003
    short, enough = (
        catch(cloth, _raised(cloth, tip - 0.00125 + depth, 0.008), _above(0.0, tip), LEVEL, OPENING)
        for depth in (LEAST_DEPTH - 0.0015, LEAST_DEPTH + 0.0015)
    )
    assert not short.caught and enough.caught


def test_blades_beside_the_ridge_catch_nothing() -> None:
    cloth = _cloth()
    held = catch(cloth, _raised(cloth, 0.020, 0.008), _above(0.05, 0.003), LEVEL, OPENING)
    assert not held.caught


def test_blades_on_a_plateau_press_it_down_and_catch_nothing() -> None:
    cloth = _cloth()
    state = _raised(cloth, 0.020, 0.008, flat_top=0.04)
    held = catch(cloth, state, _above(0.0, 0.003), LEVEL, OPENING)
    assert held.pressed == pytest.approx(0.020 + 0.00125 - 0.003, abs=1e-4)
    assert not held.caught and held.depth < LEAST_DEPTH


def test_many_layers_stop_the_blades() -> None:
    cloth = _cloth()
    state = cloth.flat(TABLE.centre)
    positions = state.positions.copy()
    # Folded in three across: strips 0.08 m wide lie on each other.
    x = positions[0] - TABLE.centre[0]
    folded = np.abs((x + 0.20) % 0.16 - 0.08) - 0.04
    positions[0] = TABLE.centre[0] + folded
    positions[2] += 0.0025 * np.floor((x + 0.12) / 0.08)
    held = catch(cloth, dc.replace(state, positions=positions), _above(0.0, 0.003), LEVEL, OPENING)
    assert held.layers == 3
    assert held.withheld == pytest.approx(3 * 0.0025 - 0.003, abs=1e-6)
    assert held.X_WT[2, 3] == pytest.approx(TABLE.height + 3 * 0.0025)
    assert not held.caught


def test_the_shorter_upper_blade_takes_off_from_the_depth() -> None:
    cloth = _cloth()
    state = _raised(cloth, 0.020, 0.008)
    level = catch(cloth, state, _above(0.0, 0.003), LEVEL, OPENING)
    real = catch(cloth, state, _above(0.0, 0.003), load_blades(), OPENING)
    assert level.depth - real.depth == pytest.approx(0.010, abs=1e-6)


def test_bad_input_is_refused() -> None:
    cloth = _cloth()
    state = cloth.flat(TABLE.centre)
    upwards = np.eye(4)
    with pytest.raises(InputError, match="points down"):
        catch(cloth, state, upwards, LEVEL, OPENING)
    with pytest.raises(InputError, match="opening"):
        catch(cloth, state, _above(0.0, 0.01), LEVEL, -0.01)
