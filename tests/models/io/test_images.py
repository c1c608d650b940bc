"""Image files as the sensor's pixels: orientation, bits, pairs."""

import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

from unwrinkle.hardware.cameras.base import read_picture, read_pictures
from unwrinkle.models.io.images import decoded_images
from unwrinkle.perception.calibration.boards import load_grey
from unwrinkle.perception.stereo.pair import load_pair


def _scene(seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    noise = cv2.GaussianBlur(rng.uniform(0, 255, (60, 90, 3)).astype(np.float32), (0, 0), 2.0)
    return np.asarray(cv2.normalize(noise, None, 20, 235, cv2.NORM_MINMAX), dtype=np.uint8)


def _jpeg(path: Path, image: np.ndarray, orientation: int) -> Path:
    """Write a JPEG with an EXIF orientation."""
    encoded = cv2.imencode(".jpg", image)[1].tobytes()
    tiff = b"II*\x00\x08\x00\x00\x00" + struct.pack("<H", 1)
    tiff += struct.pack("<HHIHHI", 0x0112, 3, 1, orientation, 0, 0)
    exif = b"Exif\x00\x00" + tiff
    path.write_bytes(
        encoded[:2] + b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + encoded[2:]
    )
    return path


@pytest.mark.parametrize("orientation", range(1, 9))
def test_the_orientation_of_a_file_is_ignored(tmp_path: Path, orientation: int) -> None:
    plain = _jpeg(tmp_path / "plain.jpg", _scene(), 1)
    turned = _jpeg(tmp_path / "left.jpg", _scene(), orientation)
    other = _jpeg(tmp_path / "right.jpg", _scene(1), 9 - orientation)
    np.testing.assert_array_equal(read_picture(turned), read_picture(plain))
    np.testing.assert_array_equal(load_grey(turned), load_grey(plain))
    pair = load_pair(turned, other)
    np.testing.assert_array_equal(pair.left, read_picture(plain))
    assert pair.right.shape == pair.left.shape


@pytest.mark.parametrize("bits", [8, 10, 12, 14, 16])
@pytest.mark.parametrize("grey", [False, True])
def test_every_number_of_bits_gives_the_same_picture(tmp_path: Path, bits: int, grey: bool) -> None:
    eight = _scene()[..., 0] if grey else _scene()
    deep = eight.astype(np.uint16) << (bits - 8)
    path = tmp_path / "deep.png"
    cv2.imwrite(str(path), deep)
    expected = np.repeat(eight[..., None], 3, axis=2) if grey else eight[..., ::-1]
    np.testing.assert_array_equal(read_picture(path), expected)
    levels = load_grey(path).astype(int)
    wanted = eight if grey else cv2.cvtColor(eight, cv2.COLOR_BGR2GRAY)
    assert np.abs(levels - wanted.astype(int)).max() <= 1


def test_both_eyes_are_scaled_alike(tmp_path: Path) -> None:
    bright, dark = _scene(0).astype(np.uint16) << 4, _scene(1).astype(np.uint16) << 1
    for name, image in (("l.png", bright), ("r.png", dark)):
        cv2.imwrite(str(tmp_path / name), image)
    left, right = read_pictures(tmp_path / "l.png", tmp_path / "r.png")
    np.testing.assert_array_equal(left, _scene(0)[..., ::-1])
    np.testing.assert_array_equal(right, _scene(1)[..., ::-1] >> 3)  # darker, as in the files
    pair = load_pair(tmp_path / "l.png", tmp_path / "r.png")
    np.testing.assert_array_equal(pair.right, right)


def test_what_is_no_image_is_none() -> None:
    assert decoded_images([np.zeros(0, np.uint8), np.arange(9, dtype=np.uint8)]) == [None, None]
