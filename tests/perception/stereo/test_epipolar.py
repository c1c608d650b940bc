"""Epipolar check: small angle errors are corrected, large ones refused."""

import dataclasses
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from unwrinkle.models.errors import EpipolarError
from unwrinkle.perception.stereo.epipolar import EpipolarCheck, corrected_rectification
from unwrinkle.perception.stereo.head import Gaze
from unwrinkle.perception.stereo.rectification import Rectification, rectify

STEP = 0.00022439959992278893


def checked(
    seen: Any, *, swap: bool = False, **angles: float
) -> tuple[Rectification, EpipolarCheck, Rectification]:
    """Check the pair as if it had been taken at other angles; also the true rectification."""
    gaze: Gaze = dataclasses.replace(
        seen.gaze, **{name: getattr(seen.gaze, name) + by for name, by in angles.items()}
    )
    cameras = [eye.camera.scaled(0.25) for eye in (seen.head.left, seen.head.right)]
    images = [cv2.cvtColor(i, cv2.COLOR_RGB2GRAY) for i in (seen.pair.left, seen.pair.right)]
    if swap:
        images.reverse()
    claimed = rectify(*cameras, seen.head.relative(gaze))
    found, check = corrected_rectification(*images, claimed, "pair")
    return found, check, rectify(*cameras, seen.head.relative(seen.gaze))


def rows_apart(found: Rectification, true: Rectification) -> NDArray[np.float64]:
    """Pixels between the rows of points on the table, seen by truth and put into the found rows."""
    x, y = np.meshgrid(np.linspace(-0.4, 0.4, 9), np.linspace(-0.3, 0.3, 7))
    points_L = np.stack([x, y, np.full_like(x, 2.3)], axis=-1).reshape(-1, 3)
    p_CL, p_CR = points_L @ true.R_CL.T, points_L @ true.R_CL.T - [true.baseline, 0.0, 0.0]
    left = p_CL @ true.R_CL @ found.R_CL.T
    right = p_CR @ true.R_CR @ found.R_CR.T
    rows: NDArray[np.float64] = left[:, 1] / left[:, 2] - right[:, 1] / right[:, 2]
    return rows * found.camera.fx


def test_true_angles_are_left_as_they_are(seen_towel: Any) -> None:
    found, check, true = checked(seen_towel)
    assert check.matches > 60
    assert check.row_error * found.camera.fx < 0.5
    assert np.abs(rows_apart(found, true)).max() < 0.15


@pytest.mark.parametrize("tilt", [-2.0, 1.0, 3.0])
def test_steps_of_a_unit_are_taken_out_of_the_rows(seen_towel: Any, tilt: float) -> None:
    found, check, true = checked(seen_towel, right_tilt=tilt * STEP)
    assert check.row_error == pytest.approx(abs(tilt) * STEP, rel=0.3)
    assert np.abs(rows_apart(found, true)).max() < 0.15
    assert abs(check.turn[0]) == pytest.approx(abs(tilt) * STEP, rel=0.15)


@pytest.mark.parametrize("angles", [{"right_tilt": 6 * STEP}, {"left_tilt": -0.02}])
def test_a_pair_out_of_step_with_its_angles_is_refused(
    seen_towel: Any, angles: dict[str, float]
) -> None:
    with pytest.raises(EpipolarError, match=r"out of step with the head's angles.*pixels apart"):
        checked(seen_towel, **angles)


def test_both_units_off_alike_are_refused(seen_towel: Any) -> None:
    # The rows are then turned against each other, which no error of the units explains.
    with pytest.raises(EpipolarError, match="out of step"):
        checked(seen_towel, left_tilt=0.05, right_tilt=0.05)


def test_swapped_eyes_are_called_so(seen_towel: Any) -> None:
    with pytest.raises(EpipolarError, match="swapped"):
        checked(seen_towel, swap=True)


def test_eyes_that_have_nothing_in_common_are_refused(seen_towel: Any) -> None:
    other = np.random.default_rng(0).integers(0, 255, seen_towel.pair.left.shape, dtype=np.uint8)
    pair = dataclasses.replace(seen_towel.pair, right=cv2.GaussianBlur(other, (0, 0), 2.0))
    with pytest.raises(EpipolarError, match=r"features in common|out of step"):
        checked(dataclasses.replace(seen_towel, pair=pair))
