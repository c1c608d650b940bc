"""The rectified pair: rows are epipolar lines, disparities are depths, pixels stay in place."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from unwrinkle.models.arrays import Pose
from unwrinkle.models.errors import InputError
from unwrinkle.models.transforms import inverse, pose, transformed
from unwrinkle.perception.camera import Camera
from unwrinkle.perception.stereo.rectification import Rectification, rectify

LEFT = Camera("left", 616, 408, 915.4, 913.0, 310.0, 214.2, [-0.0558, 0.5239, 0.0, 0.0, 0.0])
RIGHT = Camera("right", 616, 408, 903.9, 900.6, 312.0, 217.4, [-0.0773, 0.8325, 1e-3, -5e-4, 0.1])


def relative(toe_in: float = 7.0, roll: float = 4.0, tilt: float = 0.5, base: float = 0.29) -> Pose:
    turn = Rotation.from_euler("YZX", [-toe_in, roll, tilt], degrees=True).as_matrix()
    return pose(turn, np.array([base, -0.004, 0.02]))


@pytest.fixture(scope="module")
def rectified() -> Rectification:
    return rectify(LEFT, RIGHT, relative())


poses = st.builds(
    relative,
    toe_in=st.floats(-3.0, 12.0),
    roll=st.floats(-8.0, 8.0),
    tilt=st.floats(-2.0, 2.0),
    base=st.floats(0.15, 0.45),
)


@settings(max_examples=40, deadline=None)
@given(X_LR=poses, seed=st.integers(0, 999))
def test_project_rectify_triangulate_gives_the_point_back(X_LR: Pose, seed: int) -> None:
    rng = np.random.default_rng(seed)
    region = rng.uniform([-0.35, -0.25, 1.9], [0.35, 0.25, 2.6], (40, 3))
    rect = rectify(LEFT, RIGHT, X_LR, region=region)
    left, right = rect.project(region)
    # Through the other route: each camera's own projection, and the map that the images take.
    for view, camera, points, maps in (
        (left, LEFT, region, rect._lattices[0]),
        (right, RIGHT, transformed(inverse(X_LR), region), rect._lattices[1]),
    ):
        pixels = camera.project(points)
        inside = (np.abs(pixels - [307.5, 203.5]) < [307.0, 203.0]).all(axis=1)
        inside &= ((view > 0.0) & (view < [rect.camera.width - 1, rect.camera.height - 1])).all(1)
        full = maps.maps((rect.camera.height, rect.camera.width))
        for axis in (0, 1):
            found = bilinear(full[axis], view[inside])
            assert np.abs(found - pixels[inside, axis]).max(initial=0.0) < 0.02
    assert np.abs(left[:, 1] - right[:, 1]).max() < 1e-9
    p_CQ = transformed(rect.X_CL, region)
    disparity = left[:, 0] - right[:, 0]
    assert rect.depth(disparity) == pytest.approx(p_CQ[:, 2], abs=1e-9)
    assert rect.disparity(p_CQ[:, 2]) == pytest.approx(disparity, abs=1e-9)
    low, high = rect.disparity_range(region)
    assert low < disparity.min() and disparity.max() < high


def bilinear(image: np.ndarray, places: np.ndarray) -> np.ndarray:
    x, y = np.floor(places.T).astype(int)
    s, t = (places - np.floor(places)).T
    above = image[y, x] * (1 - s) + image[y, x + 1] * s
    return above * (1 - t) + (image[y + 1, x] * (1 - s) + image[y + 1, x + 1] * s) * t


def test_points_are_those_that_the_pixels_see(rectified: Rectification) -> None:
    p_CQ = np.array([0.12, -0.08, 2.2])
    pixels, _ = rectified.project(transformed(rectified.X_LC, p_CQ))
    disparity = np.full(
        (rectified.camera.height, rectified.camera.width),
        rectified.disparity(np.array(2.2)),
        dtype=np.float32,
    )
    points = rectified.points(disparity)
    assert points.dtype == np.float32
    found = [bilinear(points[..., k], pixels[None])[0] for k in range(3)]
    assert found == pytest.approx(p_CQ, abs=1e-6)


def test_disparity_beyond_infinity_has_no_depth(rectified: Rectification) -> None:
    beyond = np.array([rectified.shift - 1.0, rectified.shift, rectified.shift + 10.0])
    depth = rectified.depth(beyond)
    assert depth[:2].tolist() == [0.0, 0.0]
    assert depth[2] == pytest.approx(rectified.camera.fx * rectified.baseline / 10.0)


def test_images_take_grey_levels_from_where_the_camera_sees_them(rectified: Rectification) -> None:
    # A quarter of a pixel of shift moves the steepest part of this pattern by over 2 grey levels.
    def pattern(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        return 128.0 + 55.0 * np.sin(u / 7.0) + 55.0 * np.cos(v / 9.0)

    u, v = np.meshgrid(np.arange(616.0), np.arange(408.0))
    image = np.rint(pattern(u, v)).astype(np.uint8)
    shape = rectified.camera.height, rectified.camera.width
    for eye, result in enumerate(rectified.apply(image, image)):
        columns, rows = (m.astype(float) for m in rectified._lattices[eye].maps(shape))
        seen = (columns > 2) & (columns < 612) & (rows > 2) & (rows < 404)
        assert seen.mean() > 0.7
        error = (result - pattern(columns, rows))[seen]
        assert np.abs(error).max() < 1.3
        assert abs(error.mean()) < 0.02
        unseen = (columns < -1) | (columns > 616) | (rows < -1) | (rows > 408)
        assert unseen.any() and not result[unseen].any()


def test_colour_comes_as_the_grey_image_does(rectified: Rectification) -> None:
    rng = np.random.default_rng(1)
    small = rng.integers(40, 215, (52, 77), dtype=np.uint8)
    image = np.kron(small, np.ones((8, 8), np.uint8))[:408, :616]
    grey, _ = rectified.apply(image, image)
    colour = rectified.apply_colour(np.repeat(image[..., None], 3, axis=2))
    assert colour.shape == (*grey.shape, 3)
    same = np.abs(colour[..., 1].astype(int) - grey) < 25
    assert same.mean() > 0.97


def test_rgb_pair_is_turned_grey(rectified: Rectification) -> None:
    red = np.zeros((408, 616, 3), np.uint8)
    red[..., 0] = 200
    left, _ = rectified.apply(red, red)
    assert np.median(left[left > 0]) == round(0.299 * 200)


def test_a_region_is_all_that_is_kept() -> None:
    region = np.array([[x, y, 2.3] for x in (-0.1, 0.1) for y in (-0.05, 0.06)])
    rect = rectify(LEFT, RIGHT, relative(), region=region, margin=10)
    whole = rectify(LEFT, RIGHT, relative())
    assert rect.camera.width * rect.camera.height < 0.2 * whole.camera.width * whole.camera.height
    for pixels in rect.project(region):
        assert (pixels > 8.0).all()
        assert (pixels < [rect.camera.width - 9.0, rect.camera.height - 9.0]).all()
    assert rect.camera.fx == whole.camera.fx


def test_a_small_region_far_from_the_axis_still_gives_a_camera() -> None:
    region = np.array([[0.55, 0.0, 2.0], [0.56, 0.01, 2.0]])
    rect = rectify(LEFT, RIGHT, relative(), region=region)
    for pixels in rect.project(region):
        assert (pixels > 0.0).all() and (pixels[:, 0] < rect.camera.width).all()


def test_whole_view_keeps_every_pixel_of_rows_that_both_see(rectified: Rectification) -> None:
    rays = np.array([[u, v, 1.0] for u in (-0.3, 0.0, 0.3) for v in (-0.15, 0.0, 0.15)])
    left, _ = rectified.project(2.0 * rays)
    assert (left > 0).all()
    assert (left < [rectified.camera.width - 1, rectified.camera.height - 1]).all()


@pytest.mark.parametrize(
    ("X_LR", "words"),
    [
        (np.eye(4), "apart"),
        (inverse(relative(roll=0.0)), "swapped"),
        (relative(toe_in=150.0), "look apart"),
        (pose(np.eye(3), np.array([0.001, 0.0, 0.3])), "look apart"),
        (2.0 * np.eye(4), "rigid"),
    ],
)
def test_impossible_pairs_are_refused(X_LR: Pose, words: str) -> None:
    with pytest.raises(InputError, match=words):
        rectify(LEFT, RIGHT, X_LR)


@pytest.mark.parametrize(
    ("region", "words"),
    [
        ([[0.0, 0.0, -1.0]], "behind"),
        ([[3.0, 0.0, 2.0], [3.1, 0.1, 2.0]], "both see"),
        ([[0.0, np.nan, 2.0]], "finite"),
        ([[0.0, 2.0]], r"\(n, 3\)"),
    ],
)
def test_regions_out_of_sight_are_refused(region: list[list[float]], words: str) -> None:
    with pytest.raises(InputError, match=words):
        rectify(LEFT, RIGHT, relative(), region=np.array(region))


def test_range_behind_the_cameras_is_refused(rectified: Rectification) -> None:
    with pytest.raises(InputError, match="do the cameras look"):
        rectified.disparity_range(np.array([[0.0, 0.0, 0.01]]))


@pytest.mark.parametrize(
    ("left", "right", "words"),
    [
        (np.zeros((408, 600), np.uint8), np.zeros((408, 616), np.uint8), "left image: 600 x 408"),
        (np.zeros((408, 616), np.uint8), np.zeros((400, 616), np.uint8), "right image"),
        (np.zeros((408, 616)), np.zeros((408, 616)), "wanted uint8"),
        (np.zeros((408, 616, 4), np.uint8), np.zeros((408, 616), np.uint8), "shape"),
    ],
)
def test_images_of_another_camera_are_refused(
    rectified: Rectification, left: np.ndarray, right: np.ndarray, words: str
) -> None:
    with pytest.raises(InputError, match=words):
        rectified.apply(left, right)


def test_lens_that_folds_back_is_not_seen_twice() -> None:
    # Barrel distortion that turns back at a radius of 0.6 focal lengths: beyond lies nothing.
    bent = Camera("bent", 616, 408, 500.0, 500.0, 307.5, 203.5, [-0.9, 0.0, 0.0, 0.0, 0.0])
    plain = Camera("plain", 616, 408, 500.0, 500.0, 307.5, 203.5)
    from unwrinkle.perception.stereo._kernels.resample import lattice, warp

    wide = Camera("wide", 1400, 1000, 500.0, 500.0, 699.5, 499.5)
    image = np.full((408, 616), 90, np.uint8)
    seen = warp(image, lattice(bent, wide, np.eye(3)), (1000, 1400)) > 0
    rays = np.hypot(*wide.rays())
    assert not seen[rays > 0.65].any()
    assert seen[rays < 0.4].all()
    assert (warp(image, lattice(plain, wide, np.eye(3)), (1000, 1400)) > 0).sum() == 405 * 613
