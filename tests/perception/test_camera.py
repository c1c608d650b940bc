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


OWN = {"name": "c", "width": 640, "height": 480, "fx": 525.0, "fy": 525.0, "cx": 319.5, "cy": 239.5}


def _written(path: Path, fields: Any) -> Path:
    path.write_text(fields if isinstance(fields, str) else yaml.safe_dump(fields))
    return path


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"fx": 1050.0, "fy": 1050.0, "cx": 639.5, "cy": 479.5}, "another resolution"),
        ({"cx": 639.0, "cy": 479.0}, "another resolution"),
        ({"cx": 159.5, "cy": 119.5}, "another resolution"),  # halved
        ({"cx": 423.5}, "another resolution"),  # of 848 x 480
        ({"height": 400}, "another resolution"),  # of 640 x 480
        ({"height": 360}, "another resolution"),
        ({"width": 480, "height": 640}, "another resolution"),  # exchanged
        ({"cx": 0.5, "cy": 0.5}, "pixels"),  # normalised
        ({"cx": 0.0, "cy": 0.0}, "pixels"),
        ({"fx": 262.5}, "square"),
        ({"sensor": "realsense"}, "known are"),
        ({"crop": [0, 0, 320, 240]}, "crop"),
    ],
)
def test_intrinsics_that_do_not_fit_the_image(
    tmp_path: Path, changes: dict[str, Any], named: str
) -> None:
    with pytest.raises(InputError, match=named) as caught:
        load_camera(_written(tmp_path / "mine.yaml", OWN | changes))
    assert "mine.yaml" in str(caught.value)


def test_a_declared_crop_may_have_its_principal_point_anywhere(tmp_path: Path) -> None:
    crop = {"width": 200, "height": 150, "cx": 319.5 - 400, "cy": 239.5 - 300}
    path = _written(tmp_path / "mine.yaml", OWN | crop | {"crop": [400, 300, 640, 480]})
    whole = load_camera(_written(tmp_path / "whole.yaml", OWN))
    assert load_camera(path) == whole.window(400, 300, 200, 150)
    with pytest.raises(InputError, match="crop:"):
        load_camera(_written(tmp_path / "silent.yaml", OWN | crop))


@pytest.mark.parametrize("absent", ["cx", "cy", "fx", "width"])
def test_a_missing_key_is_named(tmp_path: Path, absent: str) -> None:
    fields = {key: value for key, value in OWN.items() if key != absent}
    with pytest.raises(InputError, match=rf"mine\.yaml: {absent} missing"):
        load_camera(_written(tmp_path / "mine.yaml", fields))
    with pytest.raises(InputError, match=r"missing|size"):
        Camera(**fields)  # type: ignore[arg-type]


K = [525, 0, 319.5, 0, 525, 239.5, 0, 0, 1]
ROS = {
    "image_width": 640,
    "image_height": 480,
    "camera_name": "c",
    "camera_matrix": {"rows": 3, "cols": 3, "data": K},
    "distortion_model": "plumb_bob",
    "distortion_coefficients": {"rows": 1, "cols": 5, "data": [0.1, 0, 0, 0, 0]},
    "rectification_matrix": {"rows": 3, "cols": 3, "data": [1, 0, 0, 0, 1, 0, 0, 0, 1]},
    "projection_matrix": {"rows": 3, "cols": 4, "data": [525, 0, 319.5, 0, 0, 525]},
}
ROS_MESSAGE = (
    "header:\n  frame_id: depth\nheight: 480\nwidth: 640\ndistortion_model: plumb_bob\n"
    "d: [0.1, 0.0, 0.0, 0.0, 0.0]\nk: [525.0, 0.0, 319.5, 0.0, 525.0, 239.5, 0.0, 0.0, 1.0]\n"
    "r: [1, 0, 0, 0, 1, 0, 0, 0, 1]\np: [525, 0, 319.5, 0, 0, 525, 239.5, 0, 0, 0, 1, 0]\n"
    "binning_x: 0\nbinning_y: 0\nroi: {x_offset: 0, y_offset: 0, height: 0, width: 0}\n---\n"
)
OPENCV = (
    "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\ncamera_matrix: !!opencv-matrix\n"
    "   rows: 3\n   cols: 3\n   dt: d\n   data: [ 525., 0., 319.5, 0., 525., 239.5, 0., 0., 1. ]\n"
    "distortion_coefficients: !!opencv-matrix\n   rows: 5\n   cols: 1\n   dt: d\n"
    "   data: [ 1.0e-01, 0., 0., 0., 0. ]\n"
)
KALIBR = {
    "cam0": {
        "camera_model": "pinhole",
        "intrinsics": [525, 525, 319.5, 239.5],
        "resolution": [640, 480],
        "distortion_model": "radtan",
        "distortion_coeffs": [0.1, 0, 0, 0],
        "rostopic": "/cam0",
    }
}
REALSENSE = {"width": 640, "height": 480, "fx": 525.0, "fy": 525.0, "ppx": 319.5, "ppy": 239.5}
REALSENSE_PRINTED = (
    'Intrinsic of "Depth" / 640x480 / {Z16}\n  Width:      \t640\n  Height:     \t480\n'
    "  PPX:        \t319.5\n  PPY:        \t239.5\n  Fx:         \t525\n  Fy:         \t525\n"
    "  Distortion: \tBrown Conrady\n  Coeffs:     \t0.1  0  0  0  0\n  FOV (deg):  \t62 x 49\n"
)
OPEN3D = '{"width": 640, "height": 480, "intrinsic_matrix": [525,0,0,0,525,0,319.5,239.5,1]}'


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("ros.yaml", ROS),
        ("message.yaml", ROS_MESSAGE),
        ("opencv.yml", OPENCV),
        ("camchain.yaml", KALIBR),
        ("rs.json", REALSENSE | {"model": "Brown Conrady", "coeffs": [0.1, 0, 0, 0, 0]}),
        ("rs.txt", REALSENSE_PRINTED),
        ("open3d.json", OPEN3D),
        ("nested.yaml", OWN | {"distortion": [[0.1, 0.0, 0.0, 0.0, 0.0]]}),
    ],
)
def test_camera_files_of_other_programs(tmp_path: Path, name: str, content: Any) -> None:
    camera = load_camera(_written(tmp_path / name, content))
    numbers = (camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy)
    assert numbers == (640, 480, 525.0, 525.0, 319.5, 239.5)
    assert sum(camera.distortion) == (0.0 if name == "open3d.json" else pytest.approx(0.1))


def test_a_ros_region_of_interest_is_a_crop(tmp_path: Path) -> None:
    roi = {"x_offset": 100, "y_offset": 40, "width": 400, "height": 300}
    camera = load_camera(_written(tmp_path / "roi.yaml", ROS | {"roi": roi}))
    assert (camera.width, camera.height) == (400, 300)
    assert (camera.cx, camera.cy) == (219.5, 199.5)
    assert camera.crop == [100, 40, 640, 480]


@pytest.mark.parametrize(
    ("content", "named"),
    [
        (KALIBR | {"cam1": KALIBR["cam0"]}, "cam0, cam1"),
        ({"cam0": KALIBR["cam0"] | {"distortion_model": "equidistant"}}, "lens model"),
        (ROS | {"distortion_model": "equidistant"}, "lens model"),
        (ROS | {"binning_x": 2, "binning_y": 2}, "binning"),
        ({key: value for key, value in ROS.items() if key != "camera_matrix"}, "fx, fy, cx, cy"),
        (ROS | {"camera_matrix": {"data": K[:6]}}, "nine"),
        (OWN | {"depth_scale": 0.0001}, "--depth-unit"),
        (OWN | {"focal": 3}, "focal"),
        ({"intrinsics": {"f": 525}}, "width: 640"),
        ("[1, 2]", "width: 640"),
        ("name: off\nname: b\n", "twice"),
    ],
)
def test_camera_files_that_cannot_be_used_name_the_cure(
    tmp_path: Path, content: Any, named: str
) -> None:
    with pytest.raises(InputError) as caught:
        load_camera(_written(tmp_path / "mine.yaml", content))
    assert named in str(caught.value)
    assert "mine.yaml" in str(caught.value)
    assert "\n" not in str(caught.value)
