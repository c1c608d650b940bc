"""Live view of the loop: it shows its inputs, sends nothing twice, and needs little CPU time."""

import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from unwrinkle.closed_loop.watcher import LiveWatcher
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.simulation.rendering.meshes import grid_triangles
from unwrinkle.viewer.live_view import LiveView, shaded
from unwrinkle.viewer.scene import start_meshcat
from unwrinkle.viewer.text_panel import picture_panel

pytestmark = pytest.mark.alone

HEAD = np.array([0.1, -0.5, -0.1, -0.5])
OPEN = np.full(2, 0.03)


def _cloth(nodes: int, wave: float = 0.0) -> np.ndarray:
    u, v = np.meshgrid(np.linspace(-0.24, 0.24, nodes), np.linspace(-1.34, -0.86, nodes))
    z = 0.703 + 0.01 * np.sin(40.0 * u + wave)
    return np.column_stack([u.ravel(), v.ravel(), z.ravel()])


@pytest.fixture
def meshcat() -> Any:
    return start_meshcat()


@pytest.fixture
def view(cell: Cell, meshcat: Any) -> LiveView:
    return LiveView(cell, meshcat, grid_triangles(10, 10))


def _place(meshcat: Any, body: str) -> bytes:
    return bytes(meshcat._GetPackedTransform(f"/drake/illustration/{body}"))


def test_robot_head_fingers_and_cloth_follow(view: LiveView, meshcat: Any) -> None:
    bodies = ("r1/link_7", "left_ptu/tilted", "r2_gripper/upper_finger")
    assert view.update(np.zeros(13), np.zeros(4), OPEN, _cloth(10), force=True)
    assert meshcat.HasPath("loop/cloth")
    assert not meshcat.HasPath("proximity")
    before = [_place(meshcat, body) for body in bodies]
    cloth = meshcat._GetPackedObject("loop/cloth")
    assert view.update(np.full(13, 0.1), HEAD, np.zeros(2), _cloth(10, 1.0), force=True)
    after = [_place(meshcat, body) for body in bodies]
    assert all(a != b for a, b in zip(after, before, strict=True))
    assert meshcat._GetPackedObject("loop/cloth") != cloth


def test_nothing_is_sent_twice_or_too_often(view: LiveView, meshcat: Any) -> None:
    assert view.update(np.zeros(13), HEAD, OPEN, _cloth(10))
    assert not view.update(np.full(13, 0.2), HEAD, OPEN, _cloth(10, 2.0))  # too soon
    assert not view.update(np.zeros(13), HEAD, OPEN, _cloth(10), force=True)  # as before
    assert view.update(np.zeros(13), HEAD, OPEN, _cloth(10, 0.5), force=True)
    time.sleep(0.05)
    assert view.update(np.full(13, 0.2), HEAD, OPEN)
    assert meshcat.HasPath("loop/cloth")


def test_an_update_is_cheap(cell: Cell, meshcat: Any) -> None:
    """At most 5 ms of processor time with 80 x 80 nodes that move."""
    view = LiveView(cell, meshcat, grid_triangles(80, 80))
    clothes = [_cloth(80, 0.1 * k) for k in range(20)]
    view.update(np.zeros(13), HEAD, OPEN, clothes[-1], force=True)
    spent = []
    for k, cloth in enumerate(clothes):
        begin = time.thread_time()
        view.update(np.full(13, 0.01 * k), HEAD, OPEN, cloth, force=True)
        spent.append(time.thread_time() - begin)
    assert np.median(spent) < 0.005


@pytest.mark.parametrize("side", [1, -1])
def test_folds_are_shaded_whichever_way_round_the_triangles_are(side: int) -> None:
    cloth = _cloth(60)
    colours = shaded(cloth, grid_triangles(60, 60)[:, ::side].T)
    slope = np.cos(40.0 * cloth[:, 0])
    inside = np.abs(cloth[:, 1] + 1.1) < 0.2
    blue = colours[2]
    assert blue[inside & (slope > 0.8)].mean() > 1.2 * blue[inside & (slope < -0.8)].mean()
    assert colours.min() >= 0.0
    assert colours.max() <= 1.0


def test_pictures_plan_analysis_and_status_come_and_go(
    view: LiveView, meshcat: Any, plan: FlatteningPlan, synthetic_run: Any
) -> None:
    picture = np.full((30, 40, 3), 90, dtype=np.uint8)
    view.show_look(picture, picture)
    view.show_analysis(synthetic_run.analyses[0])
    view.show_plan(plan)
    view.status(["action 1", "", "pull 12 mm"])
    paths = ["loop/left eye", "loop/right eye", "loop/status"]
    paths += [f"loop/wrinkles/wrinkle {k}" for k in (1, 2, 3)]
    paths += [f"loop/plan/{kind}/{arm}" for kind in ("grasp", "pull") for arm in ("right", "left")]
    assert [path for path in paths if not meshcat.HasPath(path)] == []
    board = meshcat._GetPackedObject("loop/status")
    view.status(("action 1", "pull 12 mm"))
    assert meshcat._GetPackedObject("loop/status") == board
    view.status(["action 2"])
    assert meshcat._GetPackedObject("loop/status") != board
    view.show_analysis(synthetic_run.analyses[2])
    assert meshcat.HasPath("loop/wrinkles/wrinkle 1")
    assert not meshcat.HasPath("loop/wrinkles/wrinkle 2")
    view.show_look(None, None)
    view.show_analysis(None)
    view.show_plan(None)
    view.status([])
    assert [path for path in paths if meshcat.HasPath(path)] == []


def test_without_cloth_only_the_robot_is_shown(cell: Cell, meshcat: Any) -> None:
    view = LiveView(cell, meshcat, None)
    assert view.update(np.full(13, 0.1), HEAD, OPEN, _cloth(10), force=True)
    assert not meshcat.HasPath("loop/cloth")


def test_triangles_of_another_shape_are_refused(cell: Cell, meshcat: Any) -> None:
    with pytest.raises(InputError, match=r"shape \(4, 2\); \(m, 3\) is required"):
        LiveView(cell, meshcat, np.zeros((4, 2), dtype=int))


def test_large_pictures_become_small_boards(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    large = rng.integers(0, 255, (1500, 2000, 3), dtype=np.uint8)
    board = picture_panel(large, 0.5)
    text = board.source().in_memory().mesh_file.contents()
    assert b"data:image/jpeg;base64," in text
    assert len(text) < 500_000


def test_a_page_that_was_closed_is_noticed(cell: Cell, monkeypatch: pytest.MonkeyPatch) -> None:
    viewers = iter([0, 0, 1, 1, 0, 0])
    browser = SimpleNamespace(GetNumActiveConnections=lambda: next(viewers))
    still = SimpleNamespace(mode="perceive")
    monkeypatch.setattr("unwrinkle.closed_loop.watcher.LiveView", lambda *args: None)
    watcher = LiveWatcher(
        SimpleNamespace(station=SimpleNamespace(cell=cell, cloth=None)),
        browser,  # type: ignore[arg-type]
    )
    closed = []
    for _ in range(6):
        watcher.update(still, still, None, None)  # type: ignore[arg-type]
        closed.append(watcher.closed)
    assert closed == [False, False, False, False, True, True]
