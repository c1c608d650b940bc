"""DSLR cameras: a real child process whose grab function hangs, crashes, lies or does well."""

import os
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from unwrinkle.hardware.cameras import _gphoto_child
from unwrinkle.hardware.cameras.base import expose
from unwrinkle.hardware.cameras.gphoto import CHILD, GphotoCamera
from unwrinkle.models.site import CameraSite

pytestmark = pytest.mark.alone

SITE = CameraSite(kind="gphoto2", left="1-1", right="1-2", attempts=2)
SOON = 30.0  # s, for a test that has gone wrong

_FAKE = """
import sys, time, os
from pathlib import Path
from unwrinkle.hardware.cameras._gphoto_child import main
import shutil
stage = Path({stage!r})
calls = stage / "calls"
count = len(calls.read_text()) if calls.exists() else 0
calls.write_text("x" * (count + 1))
what = (stage / "what").read_text().split(",")
what = what[min(count, len(what) - 1)]
def grab(ports, folder):
    assert list(ports) == ["1-1", "1-2"], ports
    if what == "hang":
        (stage / "pid").write_text(str(os.getpid()))
        while True:
            time.sleep(1)
    if what == "crash":
        os.abort()
    if what == "error":
        raise RuntimeError("[-53] Could not claim the USB device")
    if what == "missing":
        raise ImportError("gphoto2")
    for name in ("left", "right"):
        shutil.copy(stage / "picture.png", folder / (name + ".jpg"))
    if what == "wrong":
        (folder / "right.jpg").write_bytes(b"raw file")
    if what == "elsewhere":
        return [("left.jpg", 10.0), ("../../etc/passwd", 10.0)]
    return [("left.jpg", 10.0), ("right.jpg", 10.0 + (5.0 if what == "late" else 0.1))]
sys.exit(main(sys.argv[1:], grab=grab))
"""


@pytest.fixture
def stage(tmp_path: Path) -> Callable[..., tuple[GphotoCamera, list[str]]]:
    def make(what: str, timeout: float = 10.0) -> tuple[GphotoCamera, list[str]]:
        red = np.full((24, 32, 3), (0, 0, 77), np.uint8)
        assert cv2.imwrite(str(tmp_path / "picture.png"), red)
        (tmp_path / "what").write_text(what)
        script = tmp_path / "child.py"
        script.write_text(_FAKE.format(stage=str(tmp_path)))
        resets: list[str] = []
        site = replace(SITE, timeout=timeout)
        child = (sys.executable, "-P", str(script))
        return GphotoCamera(site, child=child, reset=resets.append), resets

    return make


Stage = Callable[..., tuple[GphotoCamera, list[str]]]


def test_a_childs_pair_is_taken(stage: Stage) -> None:
    camera, resets = stage("good")
    result = expose(camera, 4, SOON)
    assert (result.number, result.reason, resets) == (4, "", [])
    assert result.left is not None
    assert result.left[0, 0, 0] == 77
    assert (result.time_left, result.time_right) == (10.0, 10.1)


def test_a_child_that_hangs_is_killed_and_started_anew(stage: Stage, tmp_path: Path) -> None:
    camera, resets = stage("hang,good", timeout=2.0)
    result = expose(camera, 1, SOON)
    assert result.reason == ""
    assert resets == ["1-1", "1-2"]
    with pytest.raises(ProcessLookupError):
        os.kill(int((tmp_path / "pid").read_text()), 0)


@pytest.mark.parametrize(
    ("what", "words"),
    [
        ("crash", "ended with code -6 and no picture"),
        ("error", "RuntimeError: [-53] Could not claim the USB device"),
        ("missing", "pip install 'unwrinkle[gphoto2]'"),
        ("wrong", "right.jpg is no picture that can be read (8 bytes)"),
        ("late", "5.00 s apart"),
        ("elsewhere", "cannot read"),
    ],
)
def test_a_childs_failures_are_named_and_bounded(
    stage: Stage, tmp_path: Path, what: str, words: str
) -> None:
    camera, _ = stage(what)
    result = expose(camera, 1, SOON)
    assert words in result.reason
    assert "in 2 attempts" in result.reason
    assert result.left is None
    assert (tmp_path / "calls").read_text() == "xx"


def test_a_hanging_child_dies_with_the_camera(stage: Stage, tmp_path: Path) -> None:
    camera, _ = stage("hang", timeout=60.0)
    camera.start(1)
    end = time.monotonic() + SOON
    while not (tmp_path / "pid").exists() and time.monotonic() < end:
        camera.wait(0.01)
    camera.close()
    with pytest.raises(ProcessLookupError):
        os.kill(int((tmp_path / "pid").read_text()), 0)


def test_the_real_child_says_what_is_missing() -> None:
    try:
        import gphoto2  # noqa: F401

        pytest.skip("gphoto2 is installed")
    except ImportError:
        pass
    site = replace(SITE, attempts=1, timeout=15.0)
    assert CHILD[-1] == "unwrinkle.hardware.cameras._gphoto_child"
    assert "unwrinkle[gphoto2]" in expose(GphotoCamera(site), 1, SOON).reason


def test_a_usb_port_is_found_wherever_the_camera_is_numbered(tmp_path: Path) -> None:
    (tmp_path / "1-1.2").mkdir()
    (tmp_path / "1-1.2" / "busnum").write_text("1\n")
    (tmp_path / "1-1.2" / "devnum").write_text("14\n")
    assert _gphoto_child.usb_address("1-1.2", tmp_path) == "usb:001,014"
    assert _gphoto_child.usb_address("usb:003,004", tmp_path) == "usb:003,004"
    with pytest.raises(OSError, match="no device at USB port 9-9"):
        _gphoto_child.usb_address("9-9", tmp_path)


def test_the_child_releases_both_then_downloads_jpegs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log: list[str] = []
    fake = FakeGphoto(log)
    monkeypatch.setitem(sys.modules, "gphoto2", fake)
    assert _gphoto_child.main(["usb:001,002", "usb:001,003", str(tmp_path)]) == 0
    assert log[:4] == ["init 0", "init 1", "trigger 0", "trigger 1"]
    assert log[-2:] == ["exit 0", "exit 1"]
    assert (tmp_path / "left.jpg").read_text() == "DSC_0.JPG of 0"
    assert (tmp_path / "right.jpg").read_text() == "DSC_1.JPG of 1"


class FakeGphoto:
    """As much of the binding as the child uses; each camera writes a raw file and a JPEG."""

    GP_EVENT_FILE_ADDED, GP_FILE_TYPE_NORMAL = 2, 1

    def __init__(self, log: list[str]) -> None:
        self.log, self.count = log, 0

    def PortInfoList(self) -> Any:
        class List:
            def load(self) -> None: ...

            def lookup_path(self, path: str) -> int:
                return int(path[-1])

            def __getitem__(self, index: int) -> int:
                return index

        return List()

    def Camera(self) -> Any:
        fake, index = self, self.count
        self.count += 1

        class Camera:
            events = [(0, None)]  # noqa: RUF012

            def set_port_info(self, info: int) -> None:
                assert info == index + 2

            def init(self) -> None:
                fake.log.append(f"init {index}")

            def trigger_capture(self) -> None:
                fake.log.append(f"trigger {index}")
                self.events = [
                    (2, _Name(f"DSC_{index}.NEF")),
                    (0, None),
                    (2, _Name(f"DSC_{index}.JPG")),
                ]

            def wait_for_event(self, milliseconds: int) -> Any:
                return self.events.pop(0)

            def file_get(self, folder: str, name: str, kind: int) -> Any:
                return _File(f"{name} of {index}")

            def exit(self) -> None:
                fake.log.append(f"exit {index}")

        return Camera()


class _Name:
    folder = "/store"

    def __init__(self, name: str) -> None:
        self.name = name


class _File:
    def __init__(self, text: str) -> None:
        self.text = text

    def save(self, path: str) -> None:
        Path(path).write_text(self.text)
