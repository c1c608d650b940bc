"""Captures from files: supported formats and refused input."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from unwrinkle.models.errors import InputError
from unwrinkle.perception.camera import Camera, load_camera
from unwrinkle.perception.depth.range_mapping import Capture, load_capture, save_capture

SHAPE = (480, 640)


def _depth() -> np.ndarray:
    depth = np.full(SHAPE, 1000, dtype=np.uint16)
    depth[:5] = 0
    return depth


def _png(folder: Path, image: np.ndarray, name: str = "a_depth_mm.png") -> Path:
    path = folder / name
    cv2.imwrite(str(path), image)
    return path


def test_integers_are_millimetres_and_floats_metres(tmp_path: Path) -> None:
    png = load_capture(_png(tmp_path, _depth()))
    np.save(tmp_path / "i.npy", _depth().astype(np.int32))
    metres = _depth() * 0.001
    metres[:5] = np.nan
    np.save(tmp_path / "f.npy", metres)
    np.savez(tmp_path / "d.npz", depth=metres)
    for capture in (
        png,
        load_capture(tmp_path / "i.npy"),
        load_capture(tmp_path / "f.npy"),
        load_capture(tmp_path / "d.npz"),
    ):
        assert capture.depth.dtype == np.float32
        assert (capture.depth[:5] == 0.0).all()
        np.testing.assert_allclose(capture.depth[5:], 1.0)
        assert capture.camera.name == "xtion-pro-live"
        assert capture.X_WC is None


@pytest.mark.parametrize(
    ("depth_name", "colour_name"),
    [("a_depth_mm.png", "a_rgb.jpg"), ("cloD1.png", "cloC1.png")],
)
def test_colour_beside_is_found_and_not_registered(
    tmp_path: Path, depth_name: str, colour_name: str
) -> None:
    colour = np.zeros((*SHAPE, 3), dtype=np.uint8)
    colour[..., 2] = 200  # OpenCV writes BGR: red
    _png(tmp_path, colour, colour_name)
    capture = load_capture(_png(tmp_path, _depth(), depth_name))
    assert capture.colour is not None
    assert not capture.colour_registered
    np.testing.assert_allclose(capture.colour[0, 0].astype(int), (200, 0, 0), atol=5)


def test_npz_round_trip(tmp_path: Path) -> None:
    X_WC = np.diag([-1.0, 1.0, -1.0, 1.0])
    X_WC[:3, 3] = (0.1, -1.1, 2.0)
    colour = np.full((*SHAPE, 3), 120, dtype=np.uint8)
    depth = (_depth() * 0.001).astype(np.float32)
    saved = Capture(depth, load_camera("xtion-glasgow"), colour, True, X_WC, "x")
    save_capture(tmp_path / "c.npz", saved, depth_unit=0.0001)
    loaded = load_capture(tmp_path / "c.npz")
    np.testing.assert_allclose(loaded.depth, saved.depth, atol=1e-6)
    np.testing.assert_array_equal(loaded.X_WC, X_WC)
    assert loaded.colour is not None
    np.testing.assert_allclose(loaded.colour.astype(int), 120, atol=2)
    assert loaded.camera == saved.camera
    assert loaded.colour_registered


def test_pose_from_yaml(tmp_path: Path) -> None:
    path = tmp_path / "pose.yaml"
    path.write_text("translation: [0, -1.1, 1.7]\nrotation: [[-1, 0, 0], [0, 1, 0], [0, 0, -1]]\n")
    capture = load_capture(_png(tmp_path, _depth()), pose=path)
    np.testing.assert_allclose(
        capture.X_WC, np.diag([-1.0, 1.0, -1.0, 1.0]) + np.outer([0, -1.1, 1.7, 0], [0, 0, 0, 1])
    )
    path.write_text("translation: [0, 0, 1]\nrotation: [[1, 0, 0], [0, 1, 0], [0, 0, -1]]\n")
    with pytest.raises(InputError, match="rigid"):
        load_capture(tmp_path / "a_depth_mm.png", pose=path)


def _zero() -> np.ndarray:
    return np.zeros(SHAPE, np.uint16)


def _many_holes() -> np.ndarray:
    depth = _depth()
    depth[np.random.default_rng(0).random(SHAPE) < 0.6] = 0
    return depth


@pytest.mark.parametrize(
    ("array", "named"),
    [
        (_zero(), "all zero"),
        (np.full(SHAPE, np.nan), "all NaN"),
        (_many_holes(), "insufficient view"),
        (_depth()[:240], "shape"),
        (_depth()[None], "shape"),
        (-np.ones(SHAPE), "negative"),
        (_depth().astype(float), "metres"),
        (np.ones(SHAPE, dtype=np.complex64), "complex64"),
        (np.ones(SHAPE, dtype=np.uint16), "median depth"),
    ],
)
def test_useless_arrays(tmp_path: Path, array: np.ndarray, named: str) -> None:
    path = tmp_path / "bad.npy"
    np.save(path, array)
    with pytest.raises(InputError, match=named) as caught:
        load_capture(path)
    assert "bad.npy" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_pickle_is_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "p.npy", np.array([{"a": 1}], dtype=object))
    with pytest.raises(InputError, match="pickled"):
        load_capture(tmp_path / "p.npy")
    np.savez(tmp_path / "p.npz", depth=np.array([{"a": 1}], dtype=object))
    with pytest.raises(InputError, match="pickled"):
        load_capture(tmp_path / "p.npz")


@pytest.mark.parametrize("suffix", [".png", ".npy", ".npz"])
@pytest.mark.parametrize("share", [0.0, 0.5, 0.98])
def test_truncated(tmp_path: Path, suffix: str, share: float) -> None:
    path = tmp_path / f"t{suffix}"
    noisy = _depth() + np.random.default_rng(0).integers(0, 50, SHAPE).astype(np.uint16)
    if suffix == ".png":
        _png(tmp_path, noisy, path.name)
    elif suffix == ".npy":
        np.save(path, noisy)
    else:
        np.savez_compressed(path, depth=noisy)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(InputError, match=rf"t\{suffix}"):
        load_capture(path)


def test_wrong_kinds_of_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        load_capture(tmp_path / "absent.png")
    with pytest.raises(InputError, match="colour image"):
        load_capture(_png(tmp_path, np.zeros((*SHAPE, 3), np.uint8)))
    (tmp_path / "a.txt").write_text("1000")
    with pytest.raises(InputError, match=r"\.txt"):
        load_capture(tmp_path / "a.txt")
    np.savez(tmp_path / "b.npz", distance=_depth())
    with pytest.raises(InputError, match="distance"):
        load_capture(tmp_path / "b.npz")
    with pytest.raises(InputError, match="no such colour"):
        load_capture(_png(tmp_path, _depth()), colour=tmp_path / "no.jpg")


def test_registered_colour_must_have_depths_size() -> None:
    camera: Any = Camera("c", 640, 480, 525.0, 525.0, 319.5, 239.5)
    depth = (_depth() * 0.001).astype(np.float32)
    with pytest.raises(InputError, match="registered"):
        Capture(depth, camera, np.zeros((100, 100, 3), np.uint8), True)
