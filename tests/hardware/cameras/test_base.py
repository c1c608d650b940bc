"""Pair cameras that fail, hang and lie: bounded attempts, named reasons; files, OpenCV, OpenNI2."""

import os
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from unwrinkle.hardware.cameras.base import (
    GrabbedPair,
    Pair,
    PairPicture,
    Shot,
    expose,
    read_picture,
)
from unwrinkle.hardware.cameras.factory import make_cameras
from unwrinkle.hardware.cameras.folder import FolderCamera, WatchCamera
from unwrinkle.hardware.cameras.gphoto import GphotoCamera
from unwrinkle.hardware.cameras.opencv import OpenCvCamera
from unwrinkle.hardware.cameras.openni import OpenNi2Camera
from unwrinkle.models.errors import HardwareError, InputError
from unwrinkle.models.site import CameraSite

pytestmark = pytest.mark.alone

SITE = CameraSite(timeout=5.0, attempts=2)
SOON = 20.0  # s, for a test that has gone wrong


def picture(value: int, shape: tuple[int, int] = (24, 32)) -> np.ndarray:
    image = np.zeros((*shape, 3), dtype=np.uint8)
    image[..., 0] = value  # red
    return image


def write(path: Path, value: int) -> None:
    assert cv2.imwrite(str(path), picture(value)[..., ::-1])


def shots(apart: float = 0.0, value: int = 100) -> Pair:
    return Shot(picture(value), 50.0), Shot(picture(value + 1), 50.0 + apart)


def on_fake_clock(camera: Any, times: Iterator[float]) -> PairPicture:
    """Poll at the given times, each time after the thread has had its say."""
    for now in times:
        camera.poll(now)
        if camera.result is not None:
            return camera.result
        camera.wait(SOON)
    raise AssertionError("no result")


class Grabs:
    """Does what it is told, call by call: a pair to return or an error to raise."""

    def __init__(self, *answers: Pair | Exception) -> None:
        self.answers, self.calls = list(answers), 0

    def __call__(self, cancel: threading.Event) -> Pair:
        answer = self.answers[min(self.calls, len(self.answers) - 1)]
        self.calls += 1
        if isinstance(answer, Exception):
            raise answer
        return answer


def test_a_pair_comes_with_its_number_and_read_only() -> None:
    camera = GrabbedPair(Grabs(shots(0.25)), SITE, "cameras")
    assert camera.result is None
    result = expose(camera, 7, SOON)
    assert (result.number, result.reason) == (7, "")
    assert result.left is not None
    assert result.right is not None
    assert (result.left[0, 0].tolist(), result.right[0, 0].tolist()) == ([100, 0, 0], [101, 0, 0])
    assert result.time_right - result.time_left == pytest.approx(0.25)
    assert not result.left.flags.writeable


def test_one_failure_is_tried_again() -> None:
    grabs = Grabs(HardwareError("no frame"), shots())
    result = expose(GrabbedPair(grabs, SITE, "cameras"), 1, SOON)
    assert result.reason == ""
    assert grabs.calls == 2


def test_attempts_are_bounded_and_the_last_problem_is_told() -> None:
    grabs = Grabs(ValueError("cable"), HardwareError("no frame"), shots())
    result = expose(GrabbedPair(grabs, SITE, "cameras"), 1, SOON)
    assert result.left is None
    assert result.reason == "cameras: no picture in 2 attempts: no frame"
    assert grabs.calls == 2


def test_any_exception_of_a_library_is_a_reason() -> None:
    result = expose(GrabbedPair(Grabs(ValueError("cable")), SITE, "cameras"), 1, SOON)
    assert "ValueError: cable" in result.reason


@pytest.mark.parametrize(
    ("pair", "words"),
    [
        (shots(1.5), "1.50 s apart, at most 1 s"),
        (shots(-1.5), "1.50 s apart, at most 1 s"),
        (shots(float("nan")), "nan s apart"),
        ((Shot(picture(1), 0.0), Shot(picture(1, (20, 32)), 0.0)), "sizes differ"),
        ((Shot(np.zeros((24, 32, 3)), 0.0), Shot(picture(1), 0.0)), "left camera's picture"),  # type: ignore[arg-type]
        ((Shot(picture(1), 0.0), Shot(picture(1)[..., 0], 0.0)), "right camera's picture"),
        ((Shot(picture(1), 0.0), Shot(picture(1, (0, 0)), 0.0)), "right camera's picture"),
    ],
)
def test_a_pair_that_is_none_is_refused(pair: Pair, words: str) -> None:
    result = expose(GrabbedPair(Grabs(pair), SITE, "cameras"), 1, SOON)
    assert words in result.reason
    assert result.left is None
    assert result.right is None


def test_a_capture_that_hangs_keeps_nobody_waiting() -> None:
    gate = threading.Event()
    calls = []

    def grab(cancel: threading.Event) -> Pair:
        calls.append(threading.current_thread())
        assert gate.wait(SOON)
        return shots()

    camera = GrabbedPair(grab, SITE, "cameras")
    camera.start(1)
    for now in (0.0, 4.9, 5.1, 5.2, 10.1):
        camera.poll(now)
        assert camera.result is None
    camera.poll(10.3)
    result = camera.result
    assert result is not None
    assert "nothing came within 5 s; the exposure before still hangs" in result.reason
    # Never two calls at a time; when the device is free again, so is the camera.
    assert len(calls) == 1
    camera.start(2)
    gate.set()
    calls[0].join(SOON)
    assert on_fake_clock(camera, iter((11.0, 11.1, 11.2, 11.3))).reason == ""
    assert len(calls) == 2


def test_a_capture_that_ends_when_told_is_tried_again() -> None:
    calls = []

    def grab(cancel: threading.Event) -> Pair:
        calls.append(1)
        if len(calls) == 1:
            assert cancel.wait(SOON)
            raise HardwareError("given up")
        return shots()

    camera = GrabbedPair(grab, SITE, "cameras")
    camera.start(1)
    camera.poll(0.0)
    assert on_fake_clock(camera, iter((5.1, 5.2, 5.3, 5.4))).reason == ""
    assert len(calls) == 2


def test_a_new_start_gives_up_the_old_exposure() -> None:
    def grab(cancel: threading.Event) -> Pair:
        if not first.is_set():
            first.set()
            assert cancel.wait(SOON)
        return shots()

    first = threading.Event()
    camera = GrabbedPair(grab, SITE, "cameras")
    camera.start(1)
    assert first.wait(SOON)
    result = expose(camera, 2, SOON)
    assert (result.number, result.reason) == (2, "")


def test_a_closed_camera_takes_nothing_more() -> None:
    grabs = Grabs(shots())
    camera = GrabbedPair(grabs, SITE, "cameras")
    camera.close()
    assert "closed" in expose(camera, 1, SOON).reason
    assert grabs.calls == 0


# Files.


def test_a_folders_pairs_come_in_order_and_end(tmp_path: Path) -> None:
    for index in (2, 1):
        write(tmp_path / f"left_{index}.png", 10 * index)
        write(tmp_path / f"right_{index}.png", 10 * index + 1)
    write(tmp_path / "left_3.png", 9)  # has no partner
    camera = FolderCamera(replace(SITE, kind="folder", folder=str(tmp_path)))
    reds = []
    for number in (1, 2):
        result = expose(camera, number, SOON)
        assert result.left is not None
        assert result.right is not None
        reds.append((int(result.left[0, 0, 0]), int(result.right[0, 0, 0])))
    assert reds == [(10, 11), (20, 21)]
    assert "all 2 pairs" in expose(camera, 3, SOON).reason


def test_a_damaged_file_is_named_and_passed_over(tmp_path: Path) -> None:
    for index in (1, 2):
        write(tmp_path / f"left{index}.png", index)
        write(tmp_path / f"right{index}.png", index)
    (tmp_path / "left1.png").write_bytes(b"\x89PNG no")
    camera = FolderCamera(replace(SITE, kind="folder", folder=str(tmp_path)))
    assert "left1.png is no picture that can be read (7 bytes)" in expose(camera, 1, SOON).reason
    assert expose(camera, 2, SOON).reason == ""


def test_watching_takes_only_what_is_new_and_whole(tmp_path: Path) -> None:
    site = replace(SITE, kind="watch", folder=str(tmp_path))
    write(tmp_path / "left.png", 1)
    write(tmp_path / "right.png", 2)
    camera = WatchCamera(site)
    camera.start(1)
    assert not camera.wait(0.3)
    write(tmp_path / "left.png", 11)
    assert not camera.wait(0.3)  # its partner is still the old one
    write(tmp_path / "right.png", 12)
    assert camera.wait(SOON)
    camera.poll(0.0)
    result = camera.result
    assert result is not None
    assert result.left is not None
    assert result.right is not None
    assert (result.left[0, 0, 0], result.right[0, 0, 0]) == (11, 12)
    assert result.time_left == pytest.approx((tmp_path / "left.png").stat().st_mtime)


def test_watched_files_of_different_times_are_no_pair(tmp_path: Path) -> None:
    camera = WatchCamera(replace(SITE, kind="watch", folder=str(tmp_path), attempts=1))
    camera.start(1)
    for name, age in (("left_7.png", 30.0), ("right_7.png", 0.0)):
        draft = tmp_path / ("draft_" + name)
        write(draft, 5)
        when = time.time() - age
        os.utime(draft, (when, when))
        draft.rename(tmp_path / name)
    assert camera.wait(SOON)
    camera.poll(0.0)
    assert camera.result is not None
    assert "30.0" in camera.result.reason
    assert "s apart" in camera.result.reason


def test_nothing_new_is_a_reason_at_the_deadline(tmp_path: Path) -> None:
    site = replace(SITE, kind="watch", folder=str(tmp_path), attempts=1)
    camera = WatchCamera(site)
    camera.start(1)
    camera.poll(0.0)
    camera.poll(5.1)
    assert camera.result is not None
    assert "nothing came within 5 s" in camera.result.reason
    camera.close()


# OpenCV.


class Device:
    def __init__(self, source: str, log: list[str], fails: set[str]) -> None:
        self.source, self.log, self.fails = source, log, fails
        self.frame = 0

    def isOpened(self) -> bool:
        return f"open {self.source}" not in self.fails

    def grab(self) -> bool:
        self.frame += 1
        self.log.append(f"grab {self.source}")
        return f"grab {self.source}" not in self.fails

    def retrieve(self) -> Any:
        there = f"retrieve {self.source}" not in self.fails
        return there, np.full((20, 20, 3), (0, 0, 10 * self.frame), np.uint8) if there else None

    def release(self) -> None:
        self.log.append(f"release {self.source}")


def opencv(fails: set[str], log: list[str]) -> OpenCvCamera:
    site = replace(SITE, kind="opencv", left="0", right="rtsp://x")
    return OpenCvCamera(site, lambda source: Device(source, log, fails))


def test_opencv_pictures_are_rgb_and_not_old() -> None:
    log: list[str] = []
    camera = opencv(set(), log)
    result = expose(camera, 1, SOON)
    assert result.left is not None
    # Four frames that the driver had kept back were passed over; OpenCV's blue is last.
    assert result.left[0, 0].tolist() == [50, 0, 0]
    assert log == ["grab 0", "grab rtsp://x"] * 5
    camera.close()
    assert log[-2:] == ["release 0", "release rtsp://x"]


@pytest.mark.parametrize("what", ["open", "grab", "retrieve"])
def test_opencv_failures_name_the_camera_and_open_it_anew(what: str) -> None:
    log: list[str] = []
    fails = {f"{what} rtsp://x"}
    camera = opencv(fails, log)
    assert "rtsp://x" in expose(camera, 1, SOON).reason
    assert log.count("release 0") == 2
    fails.clear()
    assert expose(camera, 2, SOON).reason == ""


# A depth camera, and what a site has.


def test_depth_is_in_metres_and_nan_where_there_is_none() -> None:
    frame = np.array([[0, 1500], [800, 0]], dtype=np.uint16)
    result = expose(OpenNi2Camera(SITE, lambda: frame), 3, SOON)  # type: ignore[arg-type]
    assert result.number == 3
    np.testing.assert_allclose(result.depth, [[np.nan, 1.5], [0.8, np.nan]])  # type: ignore[attr-defined]


def test_without_openni2_or_depth_there_is_a_reason() -> None:
    assert "pip install openni" in expose(OpenNi2Camera(SITE), 1, SOON).reason  # type: ignore[arg-type]
    empty = OpenNi2Camera(SITE, lambda: np.zeros((2, 2), np.uint16))
    assert "no depth at all" in expose(empty, 1, SOON).reason  # type: ignore[arg-type]


def test_cameras_are_opened_as_the_site_says(tmp_path: Path) -> None:
    write(tmp_path / "left.png", 1)
    write(tmp_path / "right.png", 1)
    here = replace(SITE, folder=str(tmp_path), left="", right="")
    two = replace(SITE, left="0", right="1")
    for site, kind in (
        (replace(here, kind="folder"), FolderCamera),
        (replace(here, kind="watch"), WatchCamera),
        (replace(two, kind="opencv"), OpenCvCamera),
        (replace(two, kind="gphoto2"), GphotoCamera),
    ):
        camera = make_cameras(site)
        assert isinstance(camera, kind)
        camera.close()


@pytest.mark.parametrize(
    ("site", "words"),
    [
        (CameraSite(), "'none'"),
        (CameraSite(kind="openni2"), "not a pair of cameras"),
        (CameraSite(kind="folder"), "needs cameras.folder"),
        (CameraSite(kind="opencv", left="0", right="0"), "two different cameras"),
        (CameraSite(kind="gphoto2", left="1-1"), "two different USB ports"),
    ],
)
def test_sites_that_lack_something_are_refused(site: CameraSite, words: str) -> None:
    with pytest.raises(InputError, match=words):
        make_cameras(site)


def test_missing_folders_and_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(HardwareError, match="there is no folder"):
        make_cameras(CameraSite(kind="watch", folder=str(tmp_path / "none")))
    with pytest.raises(HardwareError, match="has no pair"):
        make_cameras(CameraSite(kind="folder", folder=str(tmp_path)))
    with pytest.raises(HardwareError, match="cannot read"):
        read_picture(tmp_path / "none.png")
