"""The depth frame of an OpenNI2 device, against a binding that is a fake.

Size, mirroring, and what is missing.
"""

import sys
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from unwrinkle.hardware.cameras.openni import SIZE, grab_openni2
from unwrinkle.models.errors import HardwareError


class Stream:
    """A depth or a colour stream.

    Columns count up from the left, and the first frame is not settled.
    """

    def __init__(self, binding: "Binding", kind: type[Any]) -> None:
        self.binding, self.kind = binding, kind
        self.mode = SimpleNamespace(resolutionX=320, resolutionY=240, pixelFormat=0)
        self.mirrored, self.frames = True, 0

    def get_video_mode(self) -> Any:
        return self.mode

    def set_video_mode(self, mode: Any) -> None:
        self.binding.call("set_video_mode")
        self.mode = mode

    def set_mirroring_enabled(self, on: bool) -> None:
        self.mirrored = on if self.binding.obeys else self.mirrored

    def get_mirroring_enabled(self) -> bool:
        return self.mirrored

    def start(self) -> None:
        self.binding.call("start")

    def stop(self) -> None:
        self.binding.ended += 1

    def read_frame(self) -> Any:
        self.frames += 1
        rows, columns = self.mode.resolutionY, self.mode.resolutionX
        across = np.arange(columns) % 200 + 10 * (self.frames > 1)
        picture = np.tile(across[::-1] if self.mirrored else across, (rows, 1))
        if self.kind is np.uint8:
            picture = np.repeat(picture[..., None], 3, axis=2)
        data = np.ascontiguousarray(picture, dtype=self.kind).tobytes
        return SimpleNamespace(
            height=rows, width=columns, get_buffer_as_uint16=data, get_buffer_as_uint8=data
        )


class Binding(ModuleType):
    """As much of openni.openni2 as is used; `fails` names the call that raises."""

    PIXEL_FORMAT_DEPTH_1_MM, PIXEL_FORMAT_RGB888 = 100, 200
    IMAGE_REGISTRATION_DEPTH_TO_COLOR, SENSOR_COLOR = 1, 2

    def __init__(self, fails: str = "", *, obeys: bool = True, colour: bool = True) -> None:
        super().__init__("openni.openni2")
        self.fails, self.obeys, self.ended, self.registration = fails, obeys, 0, 0
        self.depth, self.colour = Stream(self, np.uint16), Stream(self, np.uint8)
        device = SimpleNamespace(
            create_depth_stream=lambda: self.depth,
            create_color_stream=lambda: self.colour,
            has_sensor=lambda sensor: colour,
            is_image_registration_mode_supported=lambda mode: True,
            set_image_registration_mode=lambda mode: setattr(self, "registration", mode),
        )

        def open_any() -> Any:
            self.call("open_any")
            return device

        self.Device = SimpleNamespace(open_any=open_any)

    def call(self, name: str) -> None:
        if name == self.fails:
            raise RuntimeError(f"{name} fails")

    def initialize(self) -> None:
        self.call("initialize")

    def unload(self) -> None:
        self.ended += 1


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
    assert frame.colour is not None
    assert frame.depth.shape == (SIZE[1], SIZE[0]) and frame.depth.dtype == np.uint16
    assert frame.colour.shape == (SIZE[1], SIZE[0], 3) and frame.colour.dtype == np.uint8
    np.testing.assert_array_equal(frame.depth[0, :3], [10, 11, 12])
    np.testing.assert_array_equal(frame.colour[-1, :3, 1], [10, 11, 12])
    assert binding.depth.mode.pixelFormat == 100 and binding.colour.mode.pixelFormat == 200
    assert binding.registration == 1  # each depth belongs to the colour pixel at its place
    assert binding.ended == 3  # both streams and the library


def test_a_device_that_cannot_change_mirroring_is_turned_here(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refuses(self: Stream, on: bool) -> None:
        raise RuntimeError("ONI_STATUS_NOT_SUPPORTED")

    binding = install(monkeypatch, Binding())
    monkeypatch.setattr(Stream, "set_mirroring_enabled", refuses)
    np.testing.assert_array_equal(grab_openni2().depth[0, :3], [10, 11, 12])
    binding.depth.mirrored = binding.colour.mirrored = False
    np.testing.assert_array_equal(grab_openni2().depth[0, :3], [10, 11, 12])
    monkeypatch.setattr(Stream, "get_mirroring_enabled", lambda self: refuses(self, True))
    with pytest.raises(HardwareError, match="whether it mirrors"):
        grab_openni2()


def test_without_a_colour_sensor_there_is_depth_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    binding = install(monkeypatch, Binding(colour=False))
    assert grab_openni2().colour is None
    assert binding.registration == 0 and binding.ended == 2


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
