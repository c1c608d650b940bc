"""Image pairs: exposure, contrast and size checks."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from unwrinkle.models.errors import InputError
from unwrinkle.perception.stereo.pair import StereoPair, load_pair

SHAPE = (60, 90, 3)


def noise(seed: int) -> NDArray[np.uint8]:
    return np.random.default_rng(seed).integers(40, 200, SHAPE, dtype=np.uint8)


def test_a_pair_is_read_as_rgb(tmp_path: Path) -> None:
    left, right = noise(0), noise(1)
    for name, image in (("l.png", left), ("r.png", right)):
        cv2.imwrite(str(tmp_path / name), image[..., ::-1])
    pair = load_pair(tmp_path / "l.png", tmp_path / "r.png")
    np.testing.assert_array_equal(pair.left, left)
    np.testing.assert_array_equal(pair.right, right)
    assert pair.name == "l.png + r.png"
    assert not pair.left.flags.writeable


@pytest.mark.parametrize(
    ("left", "right", "message"),
    [
        (noise(0), noise(1)[:-2], r"left image is 90 x 60, the right 90 x 58"),
        (noise(0), noise(0), "same image"),
        (np.zeros(SHAPE, np.uint8), noise(1), r"left eye is black \(100%"),
        (noise(0), np.full(SHAPE, 255, np.uint8), r"right eye is saturated \(100%"),
        (noise(0), np.full(SHAPE, 128, np.uint8), "right eye shows no structure"),
        (noise(0)[..., 0], noise(1), "left image is uint8"),
        (noise(0).astype(float), noise(1), "left image is float64"),
    ],
)
def test_unusable_pairs(left: NDArray[np.uint8], right: NDArray[np.uint8], message: str) -> None:
    with pytest.raises(InputError, match=message):
        StereoPair(left, right, "pair")


def test_missing_and_broken_files(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "l.png"), noise(0))
    with pytest.raises(InputError, match=r"r\.png: no such right image"):
        load_pair(tmp_path / "l.png", tmp_path / "r.png")
    (tmp_path / "r.png").write_bytes(b"no picture")
    with pytest.raises(InputError, match=r"r\.png: is no readable image"):
        load_pair(tmp_path / "l.png", tmp_path / "r.png")
