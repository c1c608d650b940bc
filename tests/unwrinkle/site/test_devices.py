"""`unwrinkle site check` on units, cameras and grippers: they are queried, and nothing moves."""

import dataclasses as dc
import sys
import threading
import time
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
from typing import Any

import can
import cv2
import numpy as np
import pytest

from unwrinkle.hardware.cameras.factory import CAMERAS, CameraKind
from unwrinkle.hardware.cameras.opencv import OpenCvCamera
from unwrinkle.hardware.cameras.openni import OpenNi2Camera
from unwrinkle.hardware.grippers.can_bus import GET_POSITION
from unwrinkle.models.errors import HardwareError, InputError
from unwrinkle.models.site import CameraSite, GripperSite, PanTiltSite
from unwrinkle.perception.stereo.head_file import nominal_calibration
from unwrinkle.simulation.devices.can_gripper import VirtualCanGrippers
from unwrinkle.simulation.devices.serial_pan_tilt import PtyPort, VirtualSerialPanTilt
from unwrinkle.site import _devices
from unwrinkle.site._devices import (
    check_cameras,
    check_grippers,
    check_unit,
    exposure_time,
)

pytestmark = pytest.mark.alone

CLOCK, SLEEP = time.monotonic, time.sleep
_CHANNELS = count()


@pytest.fixture
def background() -> Iterator[Callable[[Callable[[float], None]], None]]:
    """Poll devices in threads, until the test ends."""
    over, threads = threading.Event(), list[threading.Thread]()

    def begin(poll: Callable[[float], None]) -> None:
        def loop() -> None:
            while not over.wait(0.002):
                poll(time.monotonic())

        threads.append(threading.Thread(target=loop))
        threads[-1].start()

    yield begin
    over.set()
    for thread in threads:
        thread.join()


def pictures(folder: Path, *names: str, shape: tuple[int, int] = (30, 40)) -> CameraSite:
    for name in names:
        assert cv2.imwrite(str(folder / name), np.full((*shape, 3), 90, np.uint8))
    return CameraSite("folder", folder=str(folder), timeout=5.0, attempts=1)


# Pan-tilt units.


def test_a_unit_says_step_limits_and_position(background: Any) -> None:
    unit, port = VirtualSerialPanTilt(), PtyPort()
    background(lambda now: port.poll(unit, now))
    site = PanTiltSite(reply_timeout=2.0)
    text = check_unit(port.device, site, "left", None, CLOCK, SLEEP)
    assert port.device in text
    assert "pan at 0.00 deg of -158.9 to 158.9, 185.14 seconds of arc per step" in text
    assert "tilt at 0.00 deg of -46.6 to 31.1" in text
    moving = [c for c in unit.commands if c[:2] in ("PP", "TP", "PO", "TO") and len(c) > 2]
    assert moving == [] and unit.commands
    head = nominal_calibration().stereo_head()
    other = dc.replace(head, left=dc.replace(head.left, unit=dc.replace(head.left.unit, step=1e-3)))
    with pytest.raises(HardwareError, match="the head's file expects"):
        check_unit(port.device, site, "left", other, CLOCK, SLEEP)


# Cameras.


def test_a_folder_tells_which_pair_would_be_next(tmp_path: Path) -> None:
    site = pictures(tmp_path, "left1.png", "right1.png", "left2.png", "right2.png")
    text = check_cameras(site)
    assert "2 pairs, the next is left1.png and right1.png of 40 x 30 pixels" in text
    assert check_cameras(site) == text  # nothing was taken from it


def test_pairs_that_cannot_be_used_are_named(tmp_path: Path) -> None:
    site = pictures(tmp_path, "left1.png")
    with pytest.raises(HardwareError, match="has no pair of files"):
        check_cameras(site)
    pictures(tmp_path, "right1.png", shape=(20, 40))
    with pytest.raises(HardwareError, match=r"sizes differ.*put pairs .* of one size there"):
        check_cameras(site)
    (tmp_path / "right1.png").write_bytes(b"none")
    with pytest.raises(HardwareError, match="no picture that can be read"):
        check_cameras(site)
    with pytest.raises(InputError, match=r"needs cameras\.folder"):
        check_cameras(dc.replace(site, folder=""))
    assert check_cameras(CameraSite()) == "this site has no cameras"


def test_pictures_have_to_be_of_the_calibrated_size(tmp_path: Path) -> None:
    head = nominal_calibration().stereo_head()
    site = pictures(tmp_path, "left1.png", "right1.png")
    with pytest.raises(
        HardwareError, match=r"of 40 x 30 pixels, but the left camera is calibrated"
    ):
        check_cameras(site, head)
    camera = head.left.camera
    pictures(tmp_path, "left1.png", "right1.png", shape=(camera.height // 8, camera.width // 8))
    assert f"{camera.width // 8} x {camera.height // 8}" in check_cameras(site, head)


def test_a_watched_folder_waits_for_a_pair_and_tells_its_skew(
    tmp_path: Path, background: Any
) -> None:
    written = 0.0

    def write(now: float) -> None:
        nonlocal written
        if now > written + 0.5:  # again and again: pictures from before the watch do not count
            pictures(tmp_path, "left.png", "right.png")
            written = now

    site = CameraSite("watch", folder=str(tmp_path), timeout=0.3, attempts=1)
    with pytest.raises(HardwareError, match=r"0\.3 s; release both cameras during this check"):
        check_cameras(site)
    background(write)
    text = check_cameras(dc.replace(site, timeout=10.0))
    assert text.startswith("watch: a pair of 40 x 30 pixels, left at ")
    assert text.endswith("ms apart, at most 1000 ms")


class Device:
    """Fake of cv2.VideoCapture; device 9 is missing."""

    def __init__(self, source: str) -> None:
        self.there = source != "9"

    def isOpened(self) -> bool:
        return self.there

    def grab(self) -> bool:
        return True

    def retrieve(self) -> Any:
        return True, np.full((48, 64, 3), 7, np.uint8)

    def release(self) -> None:
        self.there = False


def test_opencv_cameras_are_opened(monkeypatch: pytest.MonkeyPatch) -> None:
    site = CameraSite("opencv", left="0", right="2", timeout=5.0, attempts=1)
    monkeypatch.setitem(CAMERAS, "opencv", CameraKind(lambda site: OpenCvCamera(site, Device)))
    assert "opencv: a pair of 64 x 48 pixels" in check_cameras(site)
    with pytest.raises(HardwareError, match=r"camera 9 cannot be opened.*cameras\.right"):
        check_cameras(dc.replace(site, right="9"))


def test_what_is_not_installed_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("gphoto2", "openni", "openni.openni2"):
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.setattr(_devices, "find_spec", lambda name: None)
    with pytest.raises(HardwareError, match=r"pip install 'unwrinkle\[gphoto2\]'"):
        check_cameras(CameraSite("gphoto2", "1-1", "1-2"))
    with pytest.raises(HardwareError, match="pip install openni"):
        check_cameras(CameraSite("openni2", attempts=1))


def test_a_depth_frame_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    frame = np.full((480, 640), 1100, np.uint16)
    frame[:240], frame[0, 0] = 0, 900
    monkeypatch.setitem(
        CAMERAS, "openni2", CameraKind(lambda site: OpenNi2Camera(site, lambda: frame), depth=True)
    )
    text = check_cameras(CameraSite("openni2", timeout=5.0))
    assert (
        "640 x 480 pixels without colour" in text
        and "50% of it from 0.90 to 1.10 m, median 1.10 m" in text
    )


def test_an_exposure_has_an_end() -> None:
    assert exposure_time(CameraSite(timeout=20.0, attempts=2)) == 50.0
    assert exposure_time(CameraSite(timeout=1.0, attempts=0)) == 6.0


# Grippers on a CAN bus.


@pytest.fixture
def far_bus() -> Iterator[can.BusABC]:
    """Yield the grippers' end of a virtual bus; it is closed after the polling threads."""
    with can.Bus(interface="virtual", channel=f"check {next(_CHANNELS)}") as bus:
        yield bus


@pytest.fixture
def grippers(far_bus: Any, background: Any) -> tuple[GripperSite, VirtualCanGrippers]:
    """Return virtual grippers on a separate bus, and their site."""
    site = GripperSite("can", interface="virtual", channel=far_bus.channel_id, timeout=5.0)
    virtual = VirtualCanGrippers(far_bus)
    background(virtual.poll)
    return site, virtual


def test_can_grippers_say_where_they_stand(
    grippers: tuple[GripperSite, VirtualCanGrippers],
) -> None:
    site, virtual = grippers
    text = check_grippers(site, CLOCK, SLEEP)
    assert "right (limb 1) at 0% of its closure, left (limb 0) at 0% of its closure" in text
    assert virtual.commands == [] and GET_POSITION == 0x0D, "nothing but questions may be sent"


def test_can_grippers_that_are_wrong(
    grippers: tuple[GripperSite, VirtualCanGrippers],
) -> None:
    site, virtual = grippers
    with pytest.raises(
        HardwareError, match=r"right gripper \(limb 7\) does not answer; check the power supply"
    ):
        check_grippers(dc.replace(site, limbs=[7, 0], timeout=0.3), CLOCK, SLEEP)
    virtual.faults.add("uncalibrated")
    with pytest.raises(HardwareError, match="left gripper is not calibrated"):
        check_grippers(dc.replace(site, timeout=0.3), CLOCK, SLEEP)
    virtual.faults.add("silent")
    with pytest.raises(
        HardwareError, match=r"limb 1.* does not answer; .*limb 0.* does not answer"
    ):
        check_grippers(dc.replace(site, timeout=0.3), CLOCK, SLEEP)
    with pytest.raises(HardwareError, match="cannot open CAN interface nonsense"):
        check_grippers(dc.replace(site, interface="nonsense"), CLOCK, SLEEP)
    assert virtual.commands == []
