"""The virtual pan-tilt unit: whole steps, limits, and where it really stands."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from unwrinkle.models.errors import InputError
from unwrinkle.perception.stereo.head_file import nominal_head
from unwrinkle.simulation.devices.pan_tilt import VirtualPanTilt

STEP = 0.001
PAN, TILT = (-0.5, 0.5), (-0.3004, 0.2)


def unit(repeatability: float = 0.25, seed: int = 0) -> VirtualPanTilt:
    return VirtualPanTilt(STEP, PAN, TILT, repeatability=repeatability, seed=seed)


def test_limits_are_the_last_whole_steps_inside() -> None:
    assert unit().limits == {"pan": (-500, 500), "tilt": (-300, 200)}


def test_the_cells_units_reach_their_limits_to_a_step() -> None:
    own = nominal_head().left.unit
    limits = VirtualPanTilt(own.step, own.pan, own.tilt, seed=0).limits
    for axis, angles in (("pan", own.pan), ("tilt", own.tilt)):
        left = np.array(angles) - own.step * np.array(limits[axis])
        assert -own.step < left[0] <= 0.0 <= left[1] < own.step


@given(pan=st.integers(-500, 500), tilt=st.integers(-300, 200), seed=st.integers(0, 100))
def test_it_reports_what_it_was_told_and_stands_near_it(pan: int, tilt: int, seed: int) -> None:
    moved = unit(seed=seed)
    moved.move(pan, tilt)
    assert moved.position == (pan, tilt)
    off = np.array(moved.true_angles) / STEP - [pan, tilt]
    assert np.abs(off).max() <= 0.75 + 1e-9
    # An axis that is at rest was not moved, hence has no error yet.
    assert (off[0] == 0.0) == (pan == 0)


def test_repeatability_is_the_spread_of_many_moves() -> None:
    moved = unit(repeatability=0.2, seed=3)
    rests = []
    for k in range(2000):
        moved.move(100 + k % 2, 0)
        rests.append(moved.true_angles[0] / STEP - moved.position[0])
    assert np.std(rests) == pytest.approx(0.2, rel=0.06)
    assert np.mean(rests) == pytest.approx(0.0, abs=0.02)


def test_an_axis_that_is_there_already_does_not_move() -> None:
    moved = unit()
    moved.move(10, 20)
    before = moved.true_angles
    moved.move(10, 21)
    assert moved.true_angles[0] == before[0]
    assert moved.true_angles[1] != before[1] + STEP


def test_the_seed_decides_the_errors() -> None:
    angles = []
    for seed in (1, 1, 2):
        moved = unit(seed=seed)
        moved.move(7, 8)
        angles.append(moved.true_angles)
    assert angles[0] == angles[1] != angles[2]


def test_beyond_the_limits_nothing_moves() -> None:
    moved = unit()
    moved.move(10, 20)
    with pytest.raises(InputError, match=r"tilt position 201 .* -300 to 200 by 1 steps"):
        moved.move(30, 201)
    with pytest.raises(InputError, match="pan position -501"):
        moved.move(-501, 0)
    assert moved.position == (10, 20)


@pytest.mark.parametrize("position", [0.5, 3.0, True, "4", float("nan")])
def test_positions_are_whole_steps(position: object) -> None:
    with pytest.raises(InputError, match="whole steps"):
        unit().move(position, 0)  # type: ignore[arg-type]


def test_absurd_units_are_refused() -> None:
    with pytest.raises(InputError, match="step"):
        VirtualPanTilt(0.0, PAN, TILT, seed=0)
    with pytest.raises(InputError, match="step"):
        VirtualPanTilt(float("nan"), PAN, TILT, seed=0)
    with pytest.raises(InputError, match="repeatability"):
        VirtualPanTilt(STEP, PAN, TILT, repeatability=-1.0, seed=0)
    with pytest.raises(InputError, match="zero between"):
        VirtualPanTilt(STEP, (0.1, 0.5), TILT, seed=0)
