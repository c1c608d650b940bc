"""The calibration benchmark's scene and its table."""

import dataclasses
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
    eye = calibration.EyeErrors(1.8e-5, 3e-5, 9e-5, 7e-5, 1e-5, 1e-5, 1e-6, 0.1)
    errors: dict[str, Any] = {
        "eyes": (eye, dataclasses.replace(eye, turn=3.5e-5)),
        "base_turn": 2e-5,
        "base_shift": 1e-5,
        "joint_noise": 0.0,
        "rms_px": 0.05,
        "row_error_px": 0.1,
        "repeatability": 0.0,
    }
    synthetic = calibration.SyntheticHead(seed=0, **errors)
    rendered = calibration.RenderedHead(
        pairs=20, stereo_rms_px=0.1, corner_error_px=0.03, rejected=(), **errors
    )
    real = calibration.ChessboardFigures(
        8, 0.13, 0.11, (517.0, 519.0), (1.3, 1.2), 518.0, 0.003, 1.0
    )
    results = calibration.CalibrationResult(
        corner_noise_px=0.04,
        repeatability=0.0,
        real=real if whole else None,
        synthetic=(synthetic, synthetic),
        rendered=(rendered,),
        range_maps=(calibration.RangeMapErrors((0.0,), 2.2e-4, 2.0e-4),) if whole else (),
        mount_turn_error=0.0,
        mount_shift_error=0.0,
    )
    page = calibration.table(results)
    assert "| 2.0 mdeg, 0.03 mm |" in page
    assert "2 heads, median (worst)" in page
    assert ("within 0.30%" in page) is whole
    assert ("| 1 | 0.220 | 0.200 | 1.10 |" in page) is whole
