"""The depth frame of an OpenNI2 device, against a binding that is a fake: size, mirroring, and what is missing."""

import sys
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from unwrinkle.hardware.camera_openni import SIZE, grab_openni2
from unwrinkle.models.errors import HardwareError


class Binding(ModuleType):
    """As much of openni.openni2 as is used; `fails` names the call that raises."""

    PIXEL_FORMAT_DEPTH_1_MM = 100

    def __init__(self, fails: str = "", *, obeys: bool = True) -> None:
        super().__init__("openni.openni2")
        self.fails, self.obeys = fails, obeys
        self.mode = SimpleNamespace(resolutionX=320, resolutionY=240, pixelFormat=0)
        self.mirrored, self.ended, self.frames = True, 0, 0
        self.Device = SimpleNamespace(open_any=self._open)

    def _call(self, name: str) -> None:
        if name == self.fails:
            raise RuntimeError(f"{name} fails")

    def initialize(self) -> None:
        self._call("initialize")

    def unload(self) -> None:
        self.ended += 1

    def _open(self) -> Any:
        self._call("open_any")
        return SimpleNamespace(create_depth_stream=lambda: self)

    def get_video_mode(self) -> Any:
        return self.mode

    def set_video_mode(self, mode: Any) -> None:
        self._call("set_video_mode")
        self.mode = mode

    def set_mirroring_enabled(self, on: bool) -> None:
        self.mirrored = on if self.obeys else self.mirrored

    def get_mirroring_enabled(self) -> bool:
        return self.mirrored

    def start(self) -> None:
        self._call("start")

    def stop(self) -> None:
        self.ended += 1

    def read_frame(self) -> Any:
        self.frames += 1
        rows, columns = self.mode.resolutionY, self.mode.resolutionX
        picture = np.tile(np.arange(columns, dtype=np.uint16), (rows, 1)) + 1000 * (self.frames > 1)
        if self.mirrored:
            picture = picture[:, ::-1]
        data = np.ascontiguousarray(picture, dtype=np.uint16)
        return SimpleNamespace(height=rows, width=columns, get_buffer_as_uint16=data.tobytes)


def install(monkeypatch: pytest.MonkeyPatch, binding: Binding) -> Binding:
    package = ModuleType("openni")
    monkeypatch.setitem(sys.modules, "openni", package)
    monkeypatch.setitem(sys.modules, "openni.openni2", binding)
    return binding


@pytest.mark.parametrize("obeys", [True, False])
def test_a_frame_is_whole_settled_and_not_mirrored(
    monkeypatch: pytest.MonkeyPatch, obeys: bool
) -> None:
    binding = install(monkeypatch, Binding(obeys=obeys))
    frame = grab_openni2()
    assert frame.shape == (SIZE[1], SIZE[0]) and frame.dtype == np.uint16
    np.testing.assert_array_equal(frame[0, :3], [1000, 1001, 1002])
    assert binding.mode.pixelFormat == 100 and binding.frames > 1
    assert binding.ended == 2  # the stream and the library


@pytest.mark.parametrize(
    ("fails", "words", "ended"),
    [
        ("initialize", "library does not load: initialize fails; install it", 0),
        ("open_any", "no OpenNI2 device: open_any fails; is the camera plugged in", 1),
        ("set_video_mode", "no depth frame", 1),
        ("start", "no depth frame", 1),
    ],
)
def test_what_is_missing_is_named(
    monkeypatch: pytest.MonkeyPatch, fails: str, words: str, ended: int
) -> None:
    binding = install(monkeypatch, Binding(fails))
    with pytest.raises(HardwareError, match=words):
        grab_openni2()
    assert binding.ended == ended
