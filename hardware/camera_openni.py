"""A depth camera (Xtion) through OpenNI2, where its library and Python's binding are present."""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unwrinkle.hardware.exposure import Exposer
from unwrinkle.models.errors import HardwareError
from unwrinkle.models.site import CameraSite

#: Size of the frames that are asked for, columns and rows; devices begin with a smaller one.
SIZE = (640, 480)

_MILLIMETRE = 1e-3
#: ASSUMED: so many first frames of a stream are passed over, since depth settles in them.
_UNSTEADY = 5


@dataclass(frozen=True, eq=False)
class DepthPicture:
    """One exposure of a depth camera.

    Attributes:
        number: of the exposure.
        depth: (h, w) float32 m along the axis, NaN where there is none; None where there is no picture.
        time: of the exposure, s since 1970.
        reason: why there is no picture; else empty.
    """

    number: int = 0
    depth: NDArray[np.float32] | None = None
    time: float = 0.0
    reason: str = ""


@dataclass(frozen=True, eq=False)
class _Depth:
    depth: NDArray[np.float32]
    time: float


def grab_openni2() -> NDArray[np.uint16]:
    """One depth frame (h, w), mm, 0 where there is none, of the first device; never mirrored.

    Raises:
        HardwareError: the binding, the library or the device are missing, or the device gives no such frame.
    """
    try:
        # No declared dependency: the library itself has to be installed by hand.
        openni2 = import_module("openni.openni2")
    except ImportError:
        raise HardwareError(
            "an OpenNI2 camera needs the OpenNI2 library and: pip install openni"
        ) from None
    stage = (
        "the OpenNI2 library does not load: {}; install it (package libopenni2-0), or set OPENNI2_REDIST to its "
        "folder"
    )
    try:
        openni2.initialize()
        stage = "no OpenNI2 device: {}; is the camera plugged in, and may this user open it (udev rules)?"
        try:
            device = openni2.Device.open_any()
            stage = "no depth frame from OpenNI2: {}; unplug the camera and plug it in again"
            return _frame(openni2, device.create_depth_stream())
        finally:
            openni2.unload()
    except Exception as error:  # noqa: BLE001  the binding raises its own kinds
        raise HardwareError(stage.format(error)) from None


def _frame(openni2: Any, stream: Any) -> NDArray[np.uint16]:
    mode = stream.get_video_mode()
    mode.resolutionX, mode.resolutionY = SIZE
    mode.pixelFormat = openni2.PIXEL_FORMAT_DEPTH_1_MM
    stream.set_video_mode(mode)
    stream.set_mirroring_enabled(False)
    stream.start()
    try:
        for _ in range(_UNSTEADY + 1):
            frame = stream.read_frame()
        flat = np.frombuffer(frame.get_buffer_as_uint16(), dtype=np.uint16)
        picture = flat.reshape(frame.height, frame.width).copy()
        # Devices may ignore the wish, and a mirrored garment would be gripped on the wrong side.
        return picture[:, ::-1].copy() if stream.get_mirroring_enabled() else picture
    finally:
        stream.stop()


class OpenNi2Camera:
    """One depth camera; the first device there is."""

    def __init__(
        self, site: CameraSite, grab: Callable[[], NDArray[np.uint16]] = grab_openni2
    ) -> None:
        """Nothing is opened yet.

        Args:
            site: timeout and attempts.
            grab: takes a frame (h, w), mm, 0 where there is no depth.
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
        """Begin an exposure; one under way is given up."""
        self._exposer.start(number)

    def poll(self, now: float) -> None:
        """Look whether it is done; `now` is of any clock, s."""
        self._exposer.poll(now)

    @property
    def result(self) -> DepthPicture | None:
        """The last exposure's; None while one is under way, and before the first."""
        outcome = self._exposer.outcome
        if outcome is None:
            return None
        if outcome.taken is None:
            return DepthPicture(outcome.number, reason=outcome.reason)
        return DepthPicture(outcome.number, outcome.taken.depth, outcome.taken.time)

    def close(self) -> None:
        """Give up what is under way."""
        self._exposer.close()

    def _grab(self, cancel: threading.Event) -> _Depth:
        raw = np.asarray(self._grab_frame())
        depth = np.where(raw > 0, raw * np.float32(_MILLIMETRE), np.float32(np.nan))
        depth = np.asarray(depth, dtype=np.float32)
        depth.flags.writeable = False
        return _Depth(depth, time.time())

    def _problem(self, taken: _Depth) -> str:
        if taken.depth.ndim != 2 or not np.isfinite(taken.depth).any():
            return f"the frame {taken.depth.shape} has no depth at all"
        return ""
