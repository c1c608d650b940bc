"""Renderer: exact pixel positions and depth, table, moving items."""

import dataclasses as dc

import numpy as np
import pytest
from numpy.typing import NDArray

from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import load_cell
from unwrinkle.perception.camera import Camera
from unwrinkle.simulation.rendering import renderer as rendering
from unwrinkle.simulation.rendering.meshes import height_field_mesh, rectangle_mesh
from unwrinkle.simulation.rendering.renderer import Light, Renderer, drake_camera
from unwrinkle.simulation.rendering.synthetic_towel import overhead_pose
from unwrinkle.simulation.rendering.textures import cloth, uniform
from unwrinkle.testing.table import TABLE

CAMERA = Camera("c", 480, 360, 900.0, 880.0, 231.4, 187.2)


def _wave(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    return 0.02 + 0.012 * np.sin(x * 40.0) * np.cos(y * 30.0 + 1.0)


def _oblique(target: tuple[float, float, float], distance: float = 0.9) -> NDArray[np.float64]:
    """X_WC from behind, 50 degrees down, turned and rolled a little."""
    z = np.array([0.18, -0.62, -0.74])
    z /= np.linalg.norm(z)
    x = np.cross(z, [0.06, 0.0, 1.0])
    x /= np.linalg.norm(x)
    X_WC = np.eye(4)
    X_WC[:3, :3] = np.column_stack([x, np.cross(z, x), z])
    X_WC[:3, 3] = np.array(target) - distance * z
    return X_WC


def _points(
    camera: Camera, X_WC: NDArray[np.float64], depth: NDArray[np.float32]
) -> NDArray[np.float64]:
    x, y = camera.rays()
    p_C = np.stack([x * depth, y * depth, depth], axis=-1).astype(float)
    return np.asarray(p_C @ X_WC[:3, :3].T + X_WC[:3, 3])


@pytest.fixture(scope="module")
def wavy() -> Renderer:
    mesh = height_field_mesh(
        "cloth",
        _wave,
        uniform((200, 180, 160)),
        centre=(0.0, -1.1),
        size=(0.40, 0.40),
        table_height=TABLE.height,
    )
    return Renderer(TABLE, [mesh])


def _height_error(renderer: Renderer, camera: Camera, taken_with: Camera) -> NDArray[np.float64]:
    """Height over the wave of the depth image, read with one camera and taken with another."""
    X_WC = _oblique((0.0, -1.1, TABLE.height))
    depth = renderer.depth(taken_with, X_WC)
    assert (depth > 0.0).all()
    p_W = _points(camera, X_WC, depth)
    on = np.abs(p_W[..., :2] - [0.0, -1.1]).max(axis=-1) < 0.16
    assert on.mean() > 0.3
    return np.asarray((p_W[..., 2] - TABLE.height - _wave(p_W[..., 0], p_W[..., 1]))[on])


def test_depth_back_projects_to_the_surface_within_microns(wavy: Renderer) -> None:
    """Fails without the half pixel of `drake_camera`."""
    error = _height_error(wavy, CAMERA, CAMERA)
    assert np.sqrt(np.mean(error**2)) < 3e-6
    assert abs(error.mean()) < 3e-6
    assert np.abs(error).max() < 2e-5


@pytest.mark.parametrize("shift", [(-0.5, -0.5), (0.5, 0.0), (0.0, 0.5)])
def test_half_a_pixel_would_show(wavy: Renderer, shift: tuple[float, float]) -> None:
    """Shows that the test above detects another pixel convention."""
    wrong = dc.replace(CAMERA, cx=CAMERA.cx + shift[0], cy=CAMERA.cy + shift[1])
    error = _height_error(wavy, CAMERA, wrong)
    assert np.sqrt(np.mean(error**2)) > 3e-5


def test_drake_counts_from_the_corner() -> None:
    info = drake_camera(CAMERA)
    assert (info.center_x(), info.center_y()) == pytest.approx((231.9, 187.7))
    assert (info.focal_x(), info.focal_y(), info.width(), info.height()) == (900, 880, 480, 360)
    with pytest.raises(InputError, match="outside the image"):
        drake_camera(dc.replace(CAMERA, cx=-3.0))


@pytest.mark.parametrize("corner", [(590, 360), (290, 380), (450, 500), (280, 205)])
def test_principal_point_may_lie_outside_the_image(wavy: Renderer, corner: tuple[int, int]) -> None:
    """A window beside the principal point sees what that part of a wide image sees."""
    X_WC = _oblique((0.0, -1.1, TABLE.height), 1.2)
    wide = Camera("w", 1080, 880, 900.0, 900.0, 539.5, 439.5)
    u, v = corner
    window = Camera("v", 200, 160, 900.0, 900.0, 539.5 - u, 439.5 - v)
    part = (slice(v, v + 160), slice(u, u + 200))
    apart = np.abs(wavy.depth(window, X_WC) - wavy.depth(wide, X_WC)[part])
    assert np.mean(apart > 2e-6) < 0.001  # but for pixels that just touch the cloth's edge
    one, other = wavy.colour(window, X_WC).astype(float), wavy.colour(wide, X_WC)[part]
    assert np.abs(one - other)[4:-4, 4:-4].mean() < 0.2


@pytest.mark.parametrize("in_parts", [False, True])
def test_quality_averages_a_picture_twice_as_large(
    monkeypatch: pytest.MonkeyPatch, in_parts: bool
) -> None:
    """Also where it is drawn in parts: their seams and offsets do not show."""
    monkeypatch.setattr(rendering, "_MAX_PIXELS", 10_000 if in_parts else 10_000_000)
    X_WM = np.eye(4)
    X_WM[:3, 3] = (0.0, -1.1, 0.71)
    renderer = Renderer(TABLE, [rectangle_mesh("r", (0.2, 0.2), cloth("terry", (0.2, 0.2)), X_WM)])
    camera = Camera("c", 360, 300, 3000.0, 3000.0, 170.3, 161.8)
    X_WC = _oblique((0.0, -1.1, 0.71))
    large = renderer.colour(camera.scaled(2.0), X_WC).astype(float)
    average = large.reshape(300, 2, 360, 2, 3).mean(axis=(1, 3))
    difference = np.abs(renderer.colour(camera, X_WC, quality=2) - average)
    assert difference.mean() < 0.5
    assert difference[155:168].mean() < 0.8 and difference[:, 164:176].mean() < 0.8  # the seams
    assert np.abs(renderer.colour(camera, X_WC) - average).mean() > 1.5
    with pytest.raises(InputError, match="quality 0"):
        renderer.colour(camera, X_WC, quality=0)


def test_ridges_are_shaded_and_both_eyes_see_the_same_light(wavy: Renderer) -> None:
    """One colour all over: what differs is light, and it stays with the surface."""
    first = overhead_pose(0.0, -1.1, TABLE.height + 1.0)
    second = overhead_pose(0.12, -1.1, TABLE.height + 1.0)
    camera = Camera("c", 200, 200, 500.0, 500.0, 99.5, 99.5)
    images = [wavy.colour(camera, pose)[..., 1].astype(float) for pose in (first, second)]
    assert images[0].std() > 8.0
    depth = wavy.depth(camera, first)
    p_W = _points(camera, first, depth)
    seen = camera.project((p_W - second[:3, 3]) @ second[:3, :3])
    inside = (seen > 1.0).all(axis=-1) & (seen < 198.0).all(axis=-1)
    u, v = np.rint(seen[inside]).astype(int).T
    assert np.abs(images[1][v, u] - images[0][inside]).mean() < 1.0


def test_brightness_follows_the_lights() -> None:
    dark = Renderer(TABLE, lights=[Light((0.0, 0.0, -1.0), 0.25)])
    bright = Renderer(TABLE, lights=[Light((0.0, 0.0, -1.0), 0.75)])
    camera = Camera("c", 64, 64, 200.0, 200.0, 31.5, 31.5)
    X_WC = overhead_pose(0.0, -1.2, 1.8)
    levels = [renderer.colour(camera, X_WC).mean() for renderer in (dark, bright)]
    assert levels[1] == pytest.approx(3.0 * levels[0], rel=0.03)


def test_things_move() -> None:
    plate = rectangle_mesh("plate", (0.2, 0.2), uniform((255, 0, 0)))
    renderer = Renderer(TABLE, [plate])
    camera = Camera("c", 64, 64, 120.0, 120.0, 31.5, 31.5)
    X_WC = overhead_pose(0.0, -1.1, TABLE.height + 1.0)
    for height in (0.05, 0.2):
        X_WM = np.eye(4)
        X_WM[:3, 3] = (0.0, -1.1, TABLE.height + height)
        renderer.move("plate", X_WM)
        assert renderer.depth(camera, X_WC)[32, 32] == pytest.approx(1.0 - height, abs=1e-6)
    with pytest.raises(InputError, match="no item 'plato'; it has plate"):
        renderer.move("plato", X_WM)


def test_nothing_is_zero() -> None:
    renderer = Renderer(TABLE)
    camera = Camera("c", 64, 64, 30.0, 30.0, 31.5, 31.5)
    depth = renderer.depth(camera, overhead_pose(0.0, -1.2, 1.7))
    assert depth[0, 0] == 0.0 and depth[32, 32] == pytest.approx(1.0, abs=1e-6)
    assert np.isfinite(depth).all()


def test_nothing_nearer_than_the_near_plane_is_seen() -> None:
    """So the lens body in front of its own camera's optical centre does not hide the view."""
    near = np.eye(4)
    near[:3, 3] = (0.0, -1.2, 1.6)
    renderer = Renderer(TABLE, [rectangle_mesh("lens", (0.2, 0.2), uniform((0, 0, 0)), near)])
    camera = Camera("c", 64, 64, 120.0, 120.0, 31.5, 31.5)
    depth = renderer.depth(camera, overhead_pose(0.0, -1.2, 1.7))
    assert depth[32, 32] == pytest.approx(1.0, abs=1e-6)


def test_bad_scenes_are_refused() -> None:
    plate = rectangle_mesh("plate", (0.2, 0.2), uniform((255, 0, 0)))
    with pytest.raises(InputError, match="two items"):
        Renderer(TABLE, [plate, plate])
    with pytest.raises(InputError, match="no robot"):
        Renderer(TABLE).set_posture()
    with pytest.raises(InputError, match=r"posture \(12,\)"):
        Renderer(load_cell(), posture=np.zeros(12))
