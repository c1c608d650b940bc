"""Units of stored depth: stated by file or user, or implausible without one."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from unwrinkle.models.errors import InputError
from unwrinkle.perception.depth.capture import load_capture
from unwrinkle.perception.depth.range_mapping import save_capture

SHAPE = (480, 640)


def _stored(depth_m: float, unit: float) -> np.ndarray:
    return np.full(SHAPE, round(depth_m / unit), dtype=np.uint16)


def _npz(path: Path, header: Any = None, **arrays: np.ndarray) -> Path:
    import json

    if header is not None:
        arrays["header"] = np.array(json.dumps(header))
    np.savez(path, **arrays)  # type: ignore[arg-type]
    return path


@pytest.mark.parametrize(
    ("depth_m", "unit"), [(0.5, 0.0001), (1.0, 0.0002), (1.0, 0.00025), (1.4, 0.0001)]
)
def test_integers_of_another_unit_are_refused_until_it_is_given(
    tmp_path: Path, depth_m: float, unit: float
) -> None:
    path = tmp_path / "d.png"
    cv2.imwrite(str(path), _stored(depth_m, unit))
    with pytest.raises(InputError, match=r"d\.png.*--depth-unit"):
        load_capture(path)
    np.testing.assert_allclose(load_capture(path, depth_unit=unit).depth, depth_m, rtol=1e-3)
    if depth_m <= 1.0:  # the user is right
        assert load_capture(path, depth_unit=0.001).depth.max() > 2.5


@pytest.mark.parametrize(
    "header",
    [
        {"depth_unit": 0.0001},
        {"depth_units": 0.0001},
        {"depth_scale": 0.0001},
        {"depth_scale": 10000},  # units per metre
        {"depth_factor": 10000.0},
        {"units_per_metre": 10000},
    ],
)
def test_the_headers_of_other_programs_state_the_unit(
    tmp_path: Path, header: dict[str, Any]
) -> None:
    path = _npz(tmp_path / "d.npz", header, depth=_stored(0.5, 0.0001))
    np.testing.assert_allclose(load_capture(path).depth, 0.5, rtol=1e-3)


def test_a_number_beside_the_depth_states_the_unit(tmp_path: Path) -> None:
    depth = _stored(0.5, 0.0001)
    path = _npz(tmp_path / "d.npz", depth=depth, depth_scale=np.array(0.0001))
    np.testing.assert_allclose(load_capture(path).depth, 0.5, rtol=1e-3)


@pytest.mark.parametrize(
    ("header", "named"),
    [
        ({"depth_unit": 0.001, "depth_scale": 0.0001}, "different units"),
        ({"depth_unit": 5000}, "metres per unit"),
        ({"depth_scale": 3.0}, "metres per unit"),
        ({"depth_unit": "inch"}, "metres per unit"),
        ({"depth_unit": True}, "metres per unit"),
        ({"deph_unit": 0.0001}, "did you mean depth_unit"),
        ({"scale": 0.0001}, "not read"),
        ({"camera_matrix": [1, 2]}, "not read"),
    ],
)
def test_a_header_that_is_not_understood_is_refused(
    tmp_path: Path, header: dict[str, Any], named: str
) -> None:
    path = _npz(tmp_path / "d.npz", header, depth=_stored(1.0, 0.001))
    with pytest.raises(InputError, match=named) as caught:
        load_capture(path)
    assert "d.npz" in str(caught.value)


@pytest.mark.parametrize("name", ["color", "scale", "X_CW", "mask"])
def test_an_array_that_is_not_read_is_refused(tmp_path: Path, name: str) -> None:
    path = _npz(tmp_path / "d.npz", depth=_stored(1.0, 0.001), **{name: np.ones(3)})
    with pytest.raises(InputError, match=f"array '{name}' is not read"):
        load_capture(path)


def test_floats_are_metres_unless_only_their_unit_is_plausible(tmp_path: Path) -> None:
    metres = np.full(SHAPE, 1.2)
    path = _npz(tmp_path / "d.npz", {"depth_scale": 0.001}, depth=metres)
    np.testing.assert_allclose(load_capture(path).depth, 1.2, rtol=1e-6)
    path = _npz(tmp_path / "e.npz", {"depth_scale": 0.001}, depth=1000.0 * metres)
    np.testing.assert_allclose(load_capture(path).depth, 1.2, rtol=1e-6)
    np.save(tmp_path / "f.npy", 1000.0 * metres)
    with pytest.raises(InputError, match="--depth-unit"):
        load_capture(tmp_path / "f.npy")
    np.testing.assert_allclose(load_capture(tmp_path / "f.npy", depth_unit=0.001).depth, 1.2)


@pytest.mark.parametrize(
    ("kind", "sign"),
    [
        (np.uint16, 0),
        (np.uint16, 65535),
        (np.int32, 65535),
        (np.int32, -1),
        (np.int16, np.iinfo(np.int16).max),
        (np.float32, np.nan),
        (np.float32, np.inf),
        (np.float32, -np.inf),
        (np.float32, 1e10),
        (np.float64, 65536.0),
        (np.float64, 10.0),
        (np.float64, -1.0),
    ],
)
def test_signs_for_no_reading(tmp_path: Path, kind: type, sign: float) -> None:
    metres = np.issubdtype(kind, np.floating)
    depth = np.full(SHAPE, 1.0 if metres else 1000, dtype=kind)
    depth[::7, ::3] = sign
    np.save(tmp_path / "d.npy", depth)
    read = load_capture(tmp_path / "d.npy").depth
    assert (read[::7, ::3] == 0.0).all()
    assert np.count_nonzero(read) == np.count_nonzero(depth == depth[1, 1])


@pytest.mark.parametrize(
    ("camera", "named"),
    [
        ({"cx": None}, "cx"),
        ({"cx": 639.5, "cy": 479.5, "fx": 1050.0, "fy": 1050.0}, "another resolution"),
        ({"sensor": "realsense"}, "noise profile"),
        ({"ppx": 3.0}, "ppx"),
    ],
)
def test_the_camera_of_a_header_is_checked(
    tmp_path: Path, camera: dict[str, Any], named: str
) -> None:
    good = {"name": "c", "width": 640, "height": 480, "fx": 525.0, "fy": 525.0}
    fields = good | {"cx": 319.5, "cy": 239.5} | camera
    fields = {key: value for key, value in fields.items() if value is not None}
    path = _npz(tmp_path / "d.npz", {"camera": fields}, depth=_stored(1.0, 0.001))
    with pytest.raises(InputError, match=named) as caught:
        load_capture(path)
    assert "d.npz" in str(caught.value)


def test_a_cropped_capture_is_saved_and_read(tmp_path: Path) -> None:
    import dataclasses as dc

    np.save(tmp_path / "d.npy", np.full(SHAPE, 1.0))
    whole = load_capture(tmp_path / "d.npy", "xtion-pro-live")
    camera = whole.camera.window(400, 300, 200, 150)
    save_capture(
        tmp_path / "c.npz", dc.replace(whole, depth=whole.depth[:150, :200], camera=camera)
    )
    assert load_capture(tmp_path / "c.npz").camera == camera
