"""Two cameras that OpenCV can open: device numbers or stream addresses."""

import threading
import time
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from unwrinkle.hardware.cameras.base import GrabbedPair, Pair, Shot
from unwrinkle.models.errors import HardwareError, InputError
from unwrinkle.models.site import CameraSite

#: ASSUMED: frames that drivers buffer; this many old frames are skipped before a picture is taken.
_BUFFERED_FRAMES = 4


class Device(Protocol):
    """The part of cv2.VideoCapture that is used."""

    def isOpened(self) -> bool:
        """Return whether the device can be used."""
        ...

    def grab(self) -> bool:
        """Take a frame; return whether there was one."""
        ...

    def retrieve(self) -> Any:
        """Return whether there is a frame, and the last frame taken, (h, w, 3) uint8 BGR."""
        ...

    def release(self) -> None:
        """Close."""
        ...


def _open_device(source: str) -> Device:
    import cv2

    device: Device = cv2.VideoCapture(int(source) if source.isdigit() else source)
    return device


class OpenCvCamera(GrabbedPair):
    """Two cameras through OpenCV, opened with the first exposure and again after a failed one."""

    def __init__(
        self, site: CameraSite, open_device: Callable[[str], Device] = _open_device
    ) -> None:
        """Prepare; no device is opened yet.

        Args:
            site: `left` and `right` are device numbers or stream addresses.
            open_device: opens one camera.

        Raises:
            InputError: the site does not name two different cameras.
        """
        if not site.left or not site.right or site.left == site.right:
            raise InputError(
                "cameras.kind 'opencv' needs two different cameras in cameras.left and "
                f"cameras.right, got '{site.left}' and '{site.right}'"
            )
        self._sources, self._open = (site.left, site.right), open_device
        self._devices: list[Device] = []
        super().__init__(self._grab, site, f"cameras ({site.left} and {site.right})")

    def close(self) -> None:
        """Cancel the exposure under way, and close both cameras unless it hangs."""
        super().close()
        if self.wait(0.0):
            self._release()

    def _release(self) -> None:
        for device in self._devices:
            device.release()
        self._devices = []

    def _grab(self, cancel: threading.Event) -> Pair:
        try:
            return self._take(cancel)
        except BaseException:
            self._release()
            raise

    def _take(self, cancel: threading.Event) -> Pair:
        if not self._devices:
            for source in self._sources:
                self._devices.append(self._open(source))
                if not self._devices[-1].isOpened():
                    raise HardwareError(
                        f"camera {source} cannot be opened; is it plugged in, and free?"
                    )
        times = [0.0, 0.0]
        for _ in range(_BUFFERED_FRAMES + 1):
            # Both are taken before either is decoded, so that the exposures are close in time.
            for index, device in enumerate(self._devices):
                if cancel.is_set():
                    raise HardwareError("given up")
                if not device.grab():
                    raise HardwareError(f"camera {self._sources[index]} gives no frame")
                times[index] = time.time()
        shots = []
        for index, device in enumerate(self._devices):
            there, frame = device.retrieve()
            if not there or frame is None:
                raise HardwareError(f"camera {self._sources[index]}'s frame cannot be decoded")
            pixels = np.array(np.asarray(frame)[..., ::-1], dtype=np.uint8, order="C")
            shots.append(Shot(pixels, times[index]))
        return shots[0], shots[1]
