"""Cameras: loading by name, projection and unprojection, refused intrinsics."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from unwrinkle.models.errors import InputError
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


@pytest.mark.parametrize("distortion", [[], [0.1, -0.05, 0.001, -0.002, 0.01]])
def test_unprojection_inverts_projection(distortion: list[float]) -> None:
    camera = Camera(**_fields(distortion=distortion))
    pixels = np.array([[[12.5, 7.0], [320.0, 200.0]], [[600.0, 470.0], [319.5, 239.5]]])
    depth = np.array([[0.8, 1.2], [1.7, 2.0]])
    points = camera.unproject(pixels, depth)
    assert points.shape == (2, 2, 3)
    np.testing.assert_array_equal(points[..., 2], depth)
    np.testing.assert_allclose(camera.project(points), pixels, atol=2e-3)
    np.testing.assert_array_equal(camera.unproject(pixels[0, 0], 0.8), points[0, 0])


def test_unprojection_of_an_image_is_that_of_its_pixels() -> None:
    camera = Camera(**_fields(width=32, height=24, fx=30.0, fy=31.0, cx=15.2, cy=11.7))
    depth = np.random.default_rng(0).uniform(0.5, 2.0, (24, 32))
    rows, columns = np.indices(depth.shape)
    points = camera.unproject(np.stack([columns, rows], axis=-1), depth)
    np.testing.assert_array_equal(camera.unproject_image(depth), points)


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


@pytest.mark.parametrize("changes", [{"cx": 320.0}, {"cy": -1.0}])
def test_a_file_with_the_intrinsics_of_another_resolution(
    tmp_path: Path, changes: dict[str, Any]
) -> None:
    path = tmp_path / "mine.yaml"
    size = {"width": 320, "height": 240}
    intrinsics = {"fx": 262, "fy": 262, "cx": 160, "cy": 120}
    path.write_text(yaml.safe_dump({"name": "mine"} | size | intrinsics | changes))
    with pytest.raises(InputError, match=r"mine\.yaml: principal point .* another resolution"):
        load_camera(path)


def test_unknown_names() -> None:
    with pytest.raises(InputError, match="xtion-pro-live"):
        load_camera("xtion-amateur")
    with pytest.raises(InputError, match="stereo"):
        noise_profile("sonar")
