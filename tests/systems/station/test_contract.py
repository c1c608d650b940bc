"""Behaviour common to every form of the station: simulated, over TCP, with the devices' drivers."""

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from unwrinkle.models.robot import Cell
from unwrinkle.perception.stereo.head import Gaze
from unwrinkle.planning.motion_mode import MotionMode
from unwrinkle.planning.trajectory import Trajectory

pytestmark = pytest.mark.alone

Swing = Callable[..., Trajectory]

FORMS = ("sim", "loopback", "hardware")


@pytest.fixture(params=FORMS)
def rig(
    request: pytest.FixtureRequest, make_rig: Callable[..., Any], tmp_path: Path
) -> Iterator[Any]:
    """Return a station of each form with test inputs at its ports."""
    for number in range(3):
        for eye in ("left", "right"):
            image = np.full((30, 40, 3), 60 * number + 40, np.uint8)
            assert cv2.imwrite(str(tmp_path / f"{eye}{number}.png"), image)
    rig = make_rig(request.param, tmp_path)
    yield rig
    rig.close()


def _until(rig: Any, done: Callable[[Any], bool], port: str = "controller.status") -> Any:
    """Advance until a port fulfils a condition, for at most 15 s of the station's clock."""
    for _ in range(600):
        value = rig.read(port)
        if done(value):
            return value
        rig.go(0.025)
    raise AssertionError(f"{port} stays at {value}")


def test_at_first_it_rests(rig: Any, station_cell: Cell) -> None:
    status = rig.read("controller.status")
    assert status.state == MotionMode.IDLE and status.reason == ""
    np.testing.assert_allclose(
        rig.read("joints.position_measured"), station_cell.robot.named_states["home"], atol=1e-4
    )
    rig.go(0.5)
    assert np.abs(rig.read("joints.velocity_measured")).max() < 1e-3
    assert rig.read("head.left_image").number == 0


def test_a_trajectory_is_run_to_its_end_once(rig: Any, swing: Swing) -> None:
    rig.go(0.2)
    start = rig.read("joints.position_measured")
    motion = swing(start, axis=8, way=0.3)
    number = rig.send_motion(motion)
    _until(rig, lambda s: s.state == MotionMode.RUNNING and s.command == number)
    status = _until(rig, lambda s: s.completed == number)
    assert status.state == MotionMode.IDLE and status.reason == ""
    end = rig.read("joints.position_measured")
    np.testing.assert_allclose(end, motion.positions[-1], atol=6e-4)
    rig.resend(number, swing(end, axis=8, way=-0.3))  # a number seen before is no new command
    rig.go(1.0)
    np.testing.assert_allclose(rig.read("joints.position_measured"), end, atol=6e-4)


def test_a_hold_ends_at_rest_on_the_path(rig: Any, swing: Swing) -> None:
    rig.go(0.2)
    start = rig.read("joints.position_measured")
    number = rig.send_motion(swing(start, axis=1, way=0.5, duration=2.0))
    _until(rig, lambda p: p[1] - start[1] > 0.1, "joints.position_measured")
    hold = rig.send_motion(None)
    _until(rig, lambda s: s.state == MotionMode.HOLDING or s.completed == hold)
    status = _until(rig, lambda s: s.completed == hold)
    assert status.state == MotionMode.IDLE and number < hold
    rig.go(0.3)
    moved = rig.read("joints.position_measured") - start
    assert 0.1 < moved[1] < 0.5
    np.testing.assert_allclose(np.delete(moved, 1), 0.0, atol=2e-4)
    assert np.abs(rig.read("joints.velocity_measured")).max() < 2e-3


def test_a_trajectory_from_elsewhere_is_refused(rig: Any, swing: Swing) -> None:
    rig.go(0.2)
    there = rig.read("joints.position_measured")
    number = rig.send_motion(swing(there + 3e-3))
    status = _until(rig, lambda s: s.command == number and s.reason)
    assert status.state == MotionMode.IDLE and status.completed != number
    assert "mrad" in status.reason
    rig.go(0.5)
    np.testing.assert_allclose(rig.read("joints.position_measured"), there, atol=2e-4)


def test_what_is_beyond_a_limit_is_refused_not_clamped(rig: Any, swing: Swing) -> None:
    rig.go(0.2)
    there = rig.read("joints.position_measured")
    number = rig.send_motion(swing(there, axis=2, way=0.4, duration=0.12))
    status = _until(rig, lambda s: s.command == number and s.reason)
    assert status.completed != number and "limit" in status.reason
    assert re.search(r"r1\S*_l\b", status.reason)
    rig.go(0.5)
    np.testing.assert_allclose(rig.read("joints.position_measured"), there, atol=2e-4)


def test_the_override_slows(rig: Any, swing: Swing) -> None:
    rig.override(0.4)
    rig.go(0.2)
    start = rig.read("joints.position_measured")
    motion = swing(start, axis=7, way=0.4)
    number = rig.send_motion(motion)
    _until(rig, lambda p: p[7] - start[7] > 2e-3, "joints.position_measured")
    begin, fastest = rig.time, 0.0
    while rig.read("controller.status").completed != number:
        rig.go(0.025)
        fastest = max(fastest, float(np.abs(rig.read("joints.velocity_measured")).max()))
        assert rig.time - begin < 10.0, rig.read("controller.status")
    planned = float(np.abs(motion.velocities).max())
    if rig.simulated:
        assert fastest == pytest.approx(0.4 * planned, rel=0.1)
    assert 0.3 * planned < fastest < 0.7 * planned  # differences in real time are not exact
    assert rig.time - begin > 1.8  # planned for one second, at 0.4 of the speed


def test_the_grippers_close_and_open(rig: Any) -> None:
    rig.go(0.2)
    for closed in ((True, False), (True, True), (False, False)):
        number = rig.send_grip(closed)
        status = _until(rig, lambda s, n=number: s.command == n, "gripper.status")
        assert status.closed == closed and status.reason == ""


def test_a_look_gives_one_exposure_with_the_gaze_it_was_taken_at(rig: Any) -> None:
    rig.go(0.2)
    gaze = Gaze(0.02, -0.21, -0.02, -0.21)
    number = rig.send_look(gaze)
    left = _until(rig, lambda image: image.number == number, "head.left_image")
    right = rig.read("head.right_image")
    assert right.number == number and left.reason == right.reason == ""
    assert left.pixels is not None and left.pixels.dtype == np.uint8
    reported = left.gaze
    step = 3e-4
    for name in ("left_pan", "left_tilt", "right_pan", "right_tilt"):
        assert getattr(reported, name) == pytest.approx(getattr(gaze, name), abs=step)
    np.testing.assert_allclose(
        rig.read("head.position_measured"), [0.02, -0.21, -0.02, -0.21], atol=step
    )
    rig.go(0.5)
    assert rig.read("head.left_image") is left or (
        rig.read("head.left_image").pixels is left.pixels
    )


def test_a_gaze_beyond_the_units_limits_is_refused(rig: Any) -> None:
    rig.go(0.2)
    before = np.array(rig.read("head.position_measured"))
    number = rig.send_look(Gaze(0.0, 0.9, 0.0, -0.2))
    image = _until(rig, lambda image: image.number == number, "head.left_image")
    assert image.pixels is None and "limit" in image.reason
    rig.go(0.5)
    np.testing.assert_allclose(rig.read("head.position_measured")[:2], before[:2], atol=1e-9)
