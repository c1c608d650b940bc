"""Cropping a capture to a known table."""

import dataclasses as dc

import numpy as np
import pytest
from numpy.typing import NDArray

from unwrinkle.models.errors import InputError
from unwrinkle.models.table import Table
from unwrinkle.perception.camera import Camera
from unwrinkle.perception.depth.capture import Capture
from unwrinkle.perception.depth.table_crop import crop_to_table

CAMERA = Camera("c", 320, 240, 260.0, 260.0, 159.5, 119.5)
TABLE = Table((0.1, -1.2), (0.8, 0.6), 0.7)


def _pose(height: float = 1.9) -> NDArray[np.float64]:
    X_WC = np.eye(4)
    X_WC[:3, :3] = np.diag([-1.0, 1.0, -1.0])
    X_WC[:3, 3] = (0.1, -1.2, height)
    return X_WC


def _capture() -> Capture:
    """A table 1.2 m under the camera, the floor 0.7 m deeper."""
    x, y = CAMERA.rays()
    on = (np.abs(1.2 * x) <= 0.4) & (np.abs(1.2 * y) <= 0.3)
    depth = np.where(on, 1.2, 1.9).astype(np.float32)
    colour = np.zeros((240, 320, 3), np.uint8)
    colour[on] = (200, 100, 50)
    return Capture(depth, CAMERA, colour, True, _pose(), "made")


def test_the_window_is_the_table_and_the_rays_stay() -> None:
    cropped = crop_to_table(_capture(), TABLE)
    width, height = 0.8 / 1.2 * 260.0, 0.6 / 1.2 * 260.0
    assert cropped.camera.width == pytest.approx(width, abs=3)
    assert cropped.camera.height == pytest.approx(height, abs=3)
    x, y = cropped.camera.rays()
    seen = cropped.depth > 0.0
    assert np.abs(x[seen] * 1.2).max() == pytest.approx(0.4, abs=0.006)
    assert np.abs(y[seen] * 1.2).max() == pytest.approx(0.3, abs=0.006)
    assert x.mean() == pytest.approx(0.0, abs=1e-3)
    assert cropped.colour is not None and cropped.colour_registered
    assert (cropped.colour[seen] == (200, 100, 50)).all()


def test_the_floor_is_no_reading() -> None:
    whole = crop_to_table(_capture(), dc.replace(TABLE, size=(1.0, 0.8)))
    assert set(np.unique(whole.depth)) == {np.float32(0.0), np.float32(1.2)}


def test_what_cannot_be_cropped_is_refused() -> None:
    capture = _capture()
    with pytest.raises(InputError, match="give its pose"):
        crop_to_table(Capture(capture.depth, CAMERA), TABLE)
    with pytest.raises(InputError, match="does not look down"):
        crop_to_table(Capture(capture.depth, CAMERA, X_WC=_pose(0.5)), TABLE)
    with pytest.raises(InputError, match="not in view"):
        crop_to_table(capture, dc.replace(TABLE, centre=(3.1, -1.2)))
    empty = dc.replace(capture, depth=np.full((240, 320), 1.9, np.float32))
    with pytest.raises(InputError, match=r"at 0\.000 m, the cell's table at 0\.700 m"):
        crop_to_table(empty, TABLE)
