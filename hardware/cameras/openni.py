"""A depth camera (Xtion) through OpenNI2; needs its library and the Python binding."""

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unwrinkle.hardware.cameras.base import DepthPicture
from unwrinkle.hardware.cameras.exposure import Exposer
from unwrinkle.models.errors import HardwareError
from unwrinkle.models.site import CameraSite

#: Requested size of the frames, columns and rows; devices begin with a smaller one.
SIZE = (640, 480)

_MILLIMETRE = 1e-3
#: ASSUMED: first frames of a stream that are skipped, since depth settles in them.
_SETTLING_FRAMES = 5


@dataclass(frozen=True, eq=False)
class DepthFrame:
    """A frame as the device returns it.

    Attributes:
        depth: (h, w) mm, 0 without a measurement.
        colour: (h, w, 3) RGB that depth is registered to, or None.
    """

    depth: NDArray[np.uint16]
    colour: NDArray[np.uint8] | None = None


#: Takes a frame: depth (h, w), mm, 0 without a measurement; alone or with its colour.
Grab = Callable[[], DepthFrame | NDArray[np.uint16]]


@dataclass(frozen=True, eq=False)
class _Depth:
    depth: NDArray[np.float32]
    colour: NDArray[np.uint8] | None
    time: float


def grab_openni2() -> DepthFrame:
    """Take one frame of the first device, not mirrored; with colour if the device can register
    depth to it.

    Raises:
        HardwareError: the binding, the library or the device is missing, or the device returns no
            such frame.
    """
    try:
        # Not a declared dependency: the library itself has to be installed by hand.
        openni2 = import_module("openni.openni2")
    except ImportError:
        raise HardwareError(
            "an OpenNI2 camera needs the OpenNI2 library and: pip install openni"
        ) from None
    stage = (
        "the OpenNI2 library does not load: {}; install it (package libopenni2-0), or set "
        "OPENNI2_REDIST to its folder"
    )
    try:
        openni2.initialize()
        stage = (
            "no OpenNI2 device: {}; is the camera plugged in, and may this user open it (udev "
            "rules)?"
        )
        try:
            device = openni2.Device.open_any()
            stage = "no depth frame from OpenNI2: {}; unplug the camera and plug it in again"
            return _frame(openni2, device)
        finally:
            openni2.unload()
    except HardwareError:
        raise
    except Exception as error:  # noqa: BLE001  the binding raises its own kinds
        raise HardwareError(stage.format(error)) from None


def _frame(openni2: Any, device: Any) -> DepthFrame:
    depth = device.create_depth_stream()
    _prepare(depth, openni2.PIXEL_FORMAT_DEPTH_1_MM)
    registered = openni2.IMAGE_REGISTRATION_DEPTH_TO_COLOR
    colour = None
    if device.has_sensor(openni2.SENSOR_COLOR) and device.is_image_registration_mode_supported(
        registered
    ):
        colour = device.create_color_stream()
        _prepare(colour, openni2.PIXEL_FORMAT_RGB888)
        device.set_image_registration_mode(registered)
    streams = [stream for stream in (depth, colour) if stream is not None]
    for stream in streams:
        stream.start()
    try:
        return DepthFrame(
            _read(depth, np.uint16), None if colour is None else _read(colour, np.uint8)
        )
    finally:
        for stream in streams:
            stream.stop()


def _prepare(stream: Any, pixels: Any) -> None:
    mode = stream.get_video_mode()
    mode.resolutionX, mode.resolutionY = SIZE
    mode.pixelFormat = pixels
    stream.set_video_mode(mode)
    # Some drivers cannot change mirroring; `_read` turns mirrored frames.
    with suppress(Exception):  # the binding raises its own kinds
        stream.set_mirroring_enabled(False)


def _read(stream: Any, kind: type[Any]) -> NDArray[Any]:
    """Return a frame of depth (h, w), or of colour (h, w, 3)."""
    for _ in range(_SETTLING_FRAMES + 1):
        frame = stream.read_frame()
    data = frame.get_buffer_as_uint16() if kind is np.uint16 else frame.get_buffer_as_uint8()
    shape = (frame.height, frame.width, -1) if kind is np.uint8 else (frame.height, frame.width)
    picture = np.frombuffer(data, dtype=kind).reshape(shape)
    # A device may ignore the setting, and a mirrored garment would be gripped on the wrong side.
    try:
        mirrored = stream.get_mirroring_enabled()
    except Exception as error:  # noqa: BLE001  the binding raises its own kinds
        raise HardwareError(
            "the OpenNI2 device does not report whether it mirrors its frames "
            f"({error}); use another driver, or store its frames as captures"
        ) from None
    return (picture[:, ::-1] if mirrored else picture).copy()


class OpenNi2Camera:
    """One depth camera, the first device found."""

    def __init__(self, site: CameraSite, grab: Grab = grab_openni2) -> None:
        """Prepare; the device is not opened yet.

        Args:
            site: timeout and attempts.
            grab: takes a frame.
        """
        self._grab_frame = grab
        self._exposer = Exposer(
            self._grab,
            self._problem,
            timeout=site.timeout,
            attempts=site.attempts,
            what="depth camera",
        )

    def start(self, number: int) -> None:
        """Begin an exposure; one under way is cancelled."""
        self._exposer.start(number)

    def poll(self, now: float) -> None:
        """Check the exposure without waiting; `now` is of any clock, s."""
        self._exposer.poll(now)

    @property
    def result(self) -> DepthPicture | None:
        """Result of the last exposure; None while one is under way, and before the first."""
        outcome = self._exposer.outcome
        if outcome is None:
            return None
        if outcome.taken is None:
            return DepthPicture(outcome.number, reason=outcome.reason)
        taken = outcome.taken
        return DepthPicture(outcome.number, taken.depth, taken.time, colour=taken.colour)

    def close(self) -> None:
        """Cancel the exposure under way."""
        self._exposer.close()

    def _grab(self, cancel: threading.Event) -> _Depth:
        frame = self._grab_frame()
        if not isinstance(frame, DepthFrame):
            frame = DepthFrame(frame)
        raw = np.asarray(frame.depth)
        depth = np.where(raw > 0, raw * np.float32(_MILLIMETRE), np.float32(np.nan))
        depth = np.asarray(depth, dtype=np.float32)
        depth.flags.writeable = False
        if frame.colour is not None:
            frame.colour.flags.writeable = False
        return _Depth(depth, frame.colour, time.time())

    def _problem(self, taken: _Depth) -> str:
        if taken.depth.ndim != 2 or not np.isfinite(taken.depth).any():
            return f"the frame {taken.depth.shape} has no depth at all"
        if taken.colour is not None and taken.colour.shape != (*taken.depth.shape, 3):
            return (
                f"its colour {taken.colour.shape} does not have the pixels of its depth "
                f"{taken.depth.shape}"
            )
        return ""
