"""Rendered cell from the head: the table is fully visible, the robot at its place."""

import dataclasses as dc

import cv2
import numpy as np
import pytest

from unwrinkle.models.robot import load_cell
from unwrinkle.models.transforms import inverse, transformed
from unwrinkle.perception.camera import Camera
from unwrinkle.perception.stereo.head import Gaze, StereoHead
from unwrinkle.perception.stereo.head_file import nominal_head
from unwrinkle.simulation.rendering.renderer import Renderer
from unwrinkle.testing.table import TABLE

CENTRE = np.array([0.0, -1.2, 0.70])


@pytest.fixture(scope="module")
def head() -> StereoHead:
    return nominal_head()


@pytest.fixture(scope="module")
def gaze(head: StereoHead) -> Gaze:
    return head.gaze_at(CENTRE)


@pytest.fixture(scope="module")
def cell_view(gaze: Gaze) -> Renderer:
    return Renderer(load_cell(), head=np.array([*gaze.left, *gaze.right]))


def _small(camera: Camera, block: int = 8) -> Camera:
    return dc.replace(camera, distortion=[]).scaled(1.0 / block)


@pytest.mark.parametrize("side", ["left", "right"])
def test_the_whole_table_is_seen_at_home(
    head: StereoHead, gaze: Gaze, cell_view: Renderer, side: str
) -> None:
    X_WC = head.poses(gaze)[side == "right"]
    camera = _small(getattr(head, side).camera)
    depth = cell_view.depth(camera, X_WC)
    # Left and right parts of the far edge and all the rest, but not the very rim.
    x, y = np.meshgrid(np.linspace(-0.39, 0.39, 40), np.linspace(-0.39, 0.39, 40))
    p_C = transformed(inverse(X_WC), np.stack([x, y, 0.0 * x], axis=-1) + CENTRE)
    u, v = np.rint(camera.project(p_C)).astype(int).reshape(-1, 2).T
    rays = np.stack(camera.rays(), axis=-1)[v, u]
    down = np.column_stack([rays, np.ones(len(rays))]) @ X_WC[2, :3]
    on_top = (0.70 - X_WC[2, 3]) / down
    np.testing.assert_allclose(depth[v, u], on_top, atol=3e-6)


def test_the_textured_top_is_what_is_seen(
    head: StereoHead, gaze: Gaze, cell_view: Renderer
) -> None:
    """The model's own slab lies in the same plane: any of it would flicker through."""
    X_WL, _ = head.poses(gaze)
    camera = _small(head.left.camera, 16)
    bench = Renderer(TABLE)
    depth = bench.depth(camera, X_WL)
    same = (depth > 0.0) & (np.abs(depth - cell_view.depth(camera, X_WL)) < 1e-6)
    inner = cv2.erode(same.astype(np.uint8), np.ones((5, 5))) > 0  # edges are smoothed
    assert inner.sum() > 8000
    images = [r.colour(camera, X_WL).astype(int)[inner] for r in (bench, cell_view)]
    assert np.mean(np.abs(images[0] - images[1]) > 1) < 0.003


def test_an_arm_over_the_table_is_seen(head: StereoHead, gaze: Gaze) -> None:
    cell = load_cell()
    renderer = Renderer(cell)
    X_WL, _ = head.poses(gaze)
    camera = _small(head.left.camera, 16)
    home = renderer.depth(camera, X_WL)
    renderer.set_posture(np.array(cell.robot.named_states["xtion1_above_table"]))
    moved = renderer.depth(camera, X_WL)
    assert np.sum(home - moved > 0.1) > 500
    renderer.set_posture()
    np.testing.assert_array_equal(renderer.depth(camera, X_WL), home)
