"""Named cameras, projection, and absurd intrinsics."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from unwrinkle.models import InputError
from unwrinkle.perception.camera import Camera, camera_names, load_camera
from unwrinkle.perception.sensor import noise_profile, noise_profile_names


def _fields(**changes: Any) -> dict[str, Any]:
    fields = {"name": "c", "width": 640, "height": 480, "fx": 525.0, "fy": 525.0}
    return {**fields, "cx": 319.5, "cy": 239.5, **changes}


def test_every_named_camera_loads_and_has_a_noise_profile() -> None:
    assert {"xtion-pro-live", "xtion-glasgow", "kinect-v2"} <= set(camera_names())
    for name in camera_names():
        camera = load_camera(name)
        assert camera.name == name
        assert camera.sensor in noise_profile_names()
        assert noise_profile(camera.sensor).name == camera.sensor


@pytest.mark.parametrize("name", ["xtion-pro-live", "xtion-glasgow"])
def test_rays_and_projection_agree(name: str) -> None:
    camera = load_camera(name)
    x, y = camera.rays()
    rows, columns = [5, 240, 470], [10, 320, 600]
    points = np.stack([x[rows, columns], y[rows, columns], np.ones(3)], axis=-1) * 1.3
    np.testing.assert_allclose(
        camera.project(points), np.stack([columns, rows], axis=-1), atol=2e-3
    )


def test_camera_from_yaml(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("name: mine\nwidth: 320\nheight: 240\nfx: 262\nfy: 262\ncx: 160\ncy: 120\n")
    assert load_camera(path).fx == 262.0
    path.write_text(path.read_text() + "focal: 3\n")
    with pytest.raises(InputError, match="focal"):
        load_camera(path)


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"fx": 0.0}, "focal"),
        ({"fy": -525.0}, "focal"),
        ({"fx": float("nan")}, "finite"),
        ({"cx": float("inf")}, "finite"),
        ({"cx": 2000.0}, "principal"),
        ({"cy": -900.0}, "principal"),
        ({"fx": 5.0}, "field of view"),
        ({"fy": 525000.0}, "field of view"),
        ({"width": 0}, "size"),
        ({"distortion": [0.1]}, "distortion"),
    ],
)
def test_absurd_intrinsics(changes: dict[str, Any], named: str) -> None:
    with pytest.raises(InputError, match=named):
        Camera(**_fields(**changes))


def test_unknown_names() -> None:
    with pytest.raises(InputError, match="xtion-pro-live"):
        load_camera("xtion-amateur")
    with pytest.raises(InputError, match="stereo"):
        noise_profile("sonar")
