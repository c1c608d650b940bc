"""What is learned of a garment from a look at it flat."""

import dataclasses as dc

import cv2
import numpy as np
import pytest

from unwrinkle.models.errors import InputError
from unwrinkle.models.garment import rectangle
from unwrinkle.perception.folds.garment_state import GarmentState, analyse_folds
from unwrinkle.perception.folds.learn_garment import learn_garment
from unwrinkle.perception.sensor import noise_profile
from unwrinkle.testing.folded_garments import folded_map

TOWEL = rectangle("towel", 0.42, 0.52, 0.0025)


@pytest.mark.parametrize("sensor", ["stereo", "xtion"])
def test_area_thickness_and_outline(sensor: str) -> None:
    known = learn_garment(folded_map(TOWEL.outline, yaw=0.4, sensor=sensor), "towel")
    assert known.flat_area == pytest.approx(TOWEL.flat_area, rel=0.01)
    assert known.thickness == pytest.approx(0.0025, abs=0.0003)
    corners = known.corners.astype(np.float32)
    _, sides, _ = cv2.minAreaRect(corners)
    assert sorted(sides) == pytest.approx([0.42, 0.52], abs=0.006)
    assert cv2.contourArea(corners) == pytest.approx(TOWEL.flat_area, rel=0.02)


def test_what_was_learned_tells_a_fold() -> None:
    known = learn_garment(folded_map(TOWEL.outline, yaw=0.1, seed=1), "towel")
    folded = analyse_folds(
        folded_map(TOWEL.outline, (0.9, 0.22), yaw=0.5, bulge=0.004, seed=2),
        (),
        noise_profile("stereo"),
        known,
    )
    assert folded.state is GarmentState.FOLDED and len(folded.flaps) == 1
    flat = folded_map(TOWEL.outline, yaw=0.5, seed=3)
    found = analyse_folds(flat, (), noise_profile("stereo"), known)
    assert found.state is GarmentState.FLAT


def test_only_a_flat_garment_seen_in_full_is_learned() -> None:
    with pytest.raises(InputError, match="lay it flat"):
        learn_garment(folded_map(TOWEL.outline, (0.0, 0.12), bulge=0.006), "towel")
    flat = folded_map(TOWEL.outline)
    valid = flat.valid.copy()
    valid[:, : flat.shape[1] // 2] = False
    with pytest.raises(InputError, match="not seen"):
        learn_garment(dc.replace(flat, valid=valid), "towel")
