"""Speckle filter: chance matches are removed; the table and folds with a step remain."""

import numpy as np

from unwrinkle.perception.stereo.matching import Disparity
from unwrinkle.perception.stereo.speckle import remove_speckle


def table(height: int = 500, width: int = 1300) -> np.ndarray:
    rows = np.arange(height, dtype=np.float32)[:, None]
    return np.broadcast_to(-300.0 + 0.1 * rows, (height, width)).astype(np.float32)


def test_a_small_patch_apart_from_all_else_goes() -> None:
    values, valid = table(), np.ones((500, 1300), dtype=bool)
    values[40:60, 100:140] += 60.0
    found = remove_speckle(Disparity(values, valid))
    assert not found.valid[45:55, 105:135].any()
    assert not found.disparity[45:55, 105:135].any()
    kept = np.ones_like(valid)
    kept[36:64, 96:144] = False
    assert found.valid[kept].all()
    np.testing.assert_array_equal(found.disparity[kept], values[kept])


def test_a_ridge_joined_by_its_slopes_stays() -> None:
    values, valid = table(), np.ones((500, 1300), dtype=bool)
    columns = np.arange(1300, dtype=np.float32)
    values += 10.0 * np.exp(-0.5 * ((columns - 600.0) / 30.0) ** 2).astype(np.float32)
    assert remove_speckle(Disparity(values, valid)).valid.all()


def test_a_large_thing_behind_a_step_stays() -> None:
    values, valid = table(), np.ones((500, 1300), dtype=bool)
    values[100:300, 700:900] += 25.0
    assert remove_speckle(Disparity(values, valid)).valid.all()


def test_what_was_not_valid_stays_so() -> None:
    values, valid = table(), np.ones((500, 1300), dtype=bool)
    valid[:, 1000:] = False
    found = remove_speckle(Disparity(values, valid))
    np.testing.assert_array_equal(found.valid, valid)
