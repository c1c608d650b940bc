"""The calibration benchmark's scene and its table."""

from typing import Any

import numpy as np
import pytest

from benchmarks.perception import calibration
from unwrinkle.models.transforms import transformed
from unwrinkle.perception.calibration.hand_eye import angle_between
from unwrinkle.perception.stereo.head_file import nominal_head
from unwrinkle.testing.calibration_scene import (
    Units,
    board_places,
    in_view,
    scaled_head,
    true_head,
)

NOMINAL = nominal_head()


def test_the_true_head_differs_from_the_nominal_one() -> None:
    truth = true_head(NOMINAL, np.random.default_rng(0))
    for true, nominal in ((truth.left, NOMINAL.left), (truth.right, NOMINAL.right)):
        assert 0.1 < np.degrees(angle_between(true.X_MC, nominal.X_MC)) < 2.0
        assert 0.0 < abs(true.camera.fx / nominal.camera.fx - 1.0) < 0.01
    np.testing.assert_array_equal(truth.left.X_RB, NOMINAL.left.X_RB)
    assert not np.allclose(truth.right.X_RB, NOMINAL.right.X_RB)


def test_fewer_pixels_of_the_same_view() -> None:
    small = scaled_head(NOMINAL, 0.25)
    point = np.array([0.2, -0.1, 2.0])
    for eye, other in ((small.left, NOMINAL.left), (small.right, NOMINAL.right)):
        wanted = (other.camera.project(point) + 0.5) * 0.25 - 0.5
        np.testing.assert_allclose(eye.camera.project(point), wanted)


def test_boards_are_in_both_images_and_above_the_table() -> None:
    outline = np.array([[0.0, 0.0, 0.0], [0.4, 0.0, 0.0], [0.0, 0.3, 0.0], [0.4, 0.3, 0.0]])
    gaze = NOMINAL.gaze_at(np.array([0.0, -1.15, 0.8]))
    places = board_places(NOMINAL, gaze, outline, 5, np.random.default_rng(1))
    assert len(places) == 5
    for X_WT in places:
        points = transformed(X_WT, outline)
        assert points[:, 2].min() > 0.7
        for eye, X_WC in zip((NOMINAL.left, NOMINAL.right), NOMINAL.poses(gaze), strict=True):
            assert in_view(eye.camera, X_WC, points)


def test_units_stand_where_they_were_sent_but_for_their_repeatability() -> None:
    gaze, step = NOMINAL.gaze_at(np.array([0.0, -1.1, 0.8])), NOMINAL.left.unit.step
    exact, loose = (Units.of(NOMINAL, steps, 0).go(gaze) for steps in (0.0, 0.25))
    assert abs(exact.left_pan - gaze.left_pan) <= 0.5 * step
    assert 0.0 < abs(loose.left_pan - exact.left_pan) < step


@pytest.mark.parametrize("whole", [True, False])
def test_table(whole: bool) -> None:
    eye = {
        "turn": 1.8e-5,
        "shift": 3e-5,
        "tsai_turn": 9e-5,
        "tsai_shift": 7e-5,
        "focal_error": 1e-6,
    }
    row: dict[str, Any] = {
        "repeatability": 0.0,
        "eyes": [eye, {**eye, "turn": 3.5e-5}],
        "base_turn": 2e-5,
        "base_shift": 1e-5,
        "rms_px": 0.05,
    }
    results: dict[str, Any] = {
        "corner_noise_px": 0.04,
        "real": None,
        "synthetic": [row, row],
        "rendered": [{**row, "corner_error_px": 0.03}],
        "range_maps": [],
    }
    if whole:
        results["real"] = {
            "pairs": 8,
            "time": 1.0,
            "rms_px": 0.13,
            "row_error_px": 0.11,
            "focal_difference_max": 0.003,
            "focal_sigma_px": [1.3, 1.2],
            "focal_owner_px": 518.0,
        }
        results["range_maps"] = [{"rms": 2.2e-4, "rms_true": 2.0e-4}]
    page = calibration.table(results)
    assert "| 2.0 mdeg, 0.03 mm |" in page
    assert "2 heads, median (worst)" in page
    assert ("within 0.30%" in page) is whole
    assert ("| 1 | 0.220 | 0.200 | 1.10 |" in page) is whole
