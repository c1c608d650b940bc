"""Fixtures for all tests."""

import gc
import os
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from unwrinkle.models.arrays import Pose
from unwrinkle.perception.calibration.boards import Board, charuco_board
from unwrinkle.perception.camera import Camera

_DESK = 150  # grey of what is around a drawn board
REPOSITORY = Path(__file__).parents[1]


#: Garbage is collected between tests, once so many objects were made.
_MUCH = 100_000


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Run files with slow tests first, so that one process does not end long after the other."""
    marks = ("slow", "end_to_end")
    slow = {item.path for item in items if any(map(item.get_closest_marker, marks))}
    items.sort(key=lambda item: item.path not in slow)


@pytest.fixture(scope="session", autouse=True)
def _own_garbage() -> Iterator[None]:
    """Collect garbage in this thread alone.

    Renderers and Meshcats must not be destroyed by another one.
    """
    gc.disable()
    yield
    gc.enable()


@pytest.fixture(autouse=True)
def _collected(_own_garbage: None) -> Iterator[None]:
    yield
    if gc.get_count()[0] > _MUCH:
        gc.collect()


@pytest.fixture(scope="session")
def repository() -> Path:
    """The repository's root folder."""
    return REPOSITORY


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real captures; not part of the repository, so tests skip without it."""
    folder = Path(os.environ.get("UNWRINKLE_DATA", REPOSITORY.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no real captures in {folder}; set UNWRINKLE_DATA to their folder")
    return folder.resolve()


@pytest.fixture(scope="session")
def draw_board() -> Callable[..., NDArray[np.uint8]]:
    """Draw a board through a camera with its distortion, every pixel from 9 rays."""
    return _drawn


def _drawn(
    board: Board,
    camera: Camera,
    X_CT: Pose,
    *,
    contrast: float = 0.8,
    blur: float = 0.6,
    noise: float = 0.0,
    seed: int = 0,
    legacy: bool = False,
) -> NDArray[np.uint8]:
    texels = 40
    squares = (board.columns + 1, board.rows + 1)
    if board.dictionary:
        size = (squares[0] * texels, squares[1] * texels)
        pattern = charuco_board(board, legacy=legacy).generateImage(size, marginSize=0)
    else:
        dark = np.add.outer(np.arange(squares[1]), np.arange(squares[0])) % 2 == 0
        pattern = np.kron(np.where(dark, 0, 255), np.ones((texels, texels))).astype(np.uint8)
    pattern = np.pad(pattern, texels, constant_values=255)
    R, p = X_CT[:3, :3], X_CT[:3, 3]
    around = (board.points_T[[0, board.columns - 1, -1, -board.columns], :2]) @ R[:, :2].T
    seen = camera.project(p + 1.6 * around - 0.3 * around.sum(axis=0) / 2.0)
    left, top = np.clip(seen.min(axis=0), 0, None).astype(int)
    right, bottom = np.ceil(seen.max(axis=0)).astype(int)
    x, y = (ray[top:bottom, left:right] for ray in camera.rays())
    # Rays are smooth: interpolated between pixels.
    fine = (3 * x.shape[1], 3 * x.shape[0])
    rays = cv2.resize(np.stack([x, y], axis=-1).astype(np.float32), fine)
    depth = (R[:, 2] @ p) / (rays @ R[:2, 2] + R[2, 2])
    points = np.concatenate([rays * depth[..., None], depth[..., None]], axis=-1) - p
    # Two squares before the first corner: the margin and the outer square.
    places = (points @ R[:, :2] / board.square + 2.0) * texels - 0.5
    part = cv2.remap(pattern, places.astype(np.float32), None, cv2.INTER_NEAREST, borderValue=_DESK)
    image = np.full((camera.height, camera.width), _DESK, np.uint8)
    image[top:bottom, left:right] = cv2.resize(part, x.shape[::-1], interpolation=cv2.INTER_AREA)
    light = 128.0 + contrast * (cv2.GaussianBlur(image.astype(float), (0, 0), blur) - 128.0)
    light += noise * np.random.default_rng(seed).standard_normal(light.shape)
    return np.clip(np.rint(light), 0, 255).astype(np.uint8)
