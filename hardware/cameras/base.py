"""The head's two cameras: interface, and the exposure of a pair in the background with a deadline
and attempts.
"""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from unwrinkle.hardware.cameras.exposure import Exposer
from unwrinkle.models.errors import HardwareError
from unwrinkle.models.site import CameraSite

Picture = NDArray[np.uint8]
Taken_co = TypeVar("Taken_co", covariant=True)

#: Least width and height of a picture, pixels.
_LEAST_SIZE = 16


@dataclass(frozen=True, eq=False)
class PairPicture:
    """One exposure of both eyes.

    Attributes:
        number: of the exposure.
        left, right: (h, w, 3) uint8 RGB, read-only; None if the exposure failed.
        time_left, time_right: of the exposures on the computer's clock, s since 1970.
        reason: why the exposure failed; else empty.
    """

    number: int = 0
    left: Picture | None = None
    right: Picture | None = None
    time_left: float = 0.0
    time_right: float = 0.0
    reason: str = ""


@dataclass(frozen=True, eq=False)
class Shot:
    """One eye's picture (h, w, 3) uint8 RGB and its time, s since 1970."""

    pixels: Picture
    time: float


Pair = tuple[Shot, Shot]


@dataclass(frozen=True, eq=False)
class DepthPicture:
    """One exposure of a depth camera.

    Attributes:
        number: of the exposure.
        depth: (h, w) float32 m along the optical axis, NaN without a measurement; None if the
            exposure failed.
        time: of the exposure, s since 1970.
        reason: why the exposure failed; else empty.
        colour: (h, w, 3) uint8 RGB registered to the pixels of depth; None without colour.
    """

    number: int = 0
    depth: NDArray[np.float32] | None = None
    time: float = 0.0
    reason: str = ""
    colour: NDArray[np.uint8] | None = None


class CameraDriver(Protocol[Taken_co]):
    """A camera, or several that are exposed together."""

    def start(self, number: int) -> None:
        """Begin an exposure; one under way is cancelled."""
        ...

    def poll(self, now: float) -> None:
        """Check the exposure without waiting; `now` is of any clock, s."""
        ...

    @property
    def result(self) -> Taken_co | None:
        """Result of the last exposure; None while one is under way, and before the first."""
        ...

    def close(self) -> None:
        """Cancel the exposure under way and release the devices."""
        ...


#: Two cameras that are exposed as a pair; one depth camera.
PairCamera = CameraDriver[PairPicture]
DepthCamera = CameraDriver[DepthPicture]


class GrabbedPair:
    """A pair camera made of one function that exposes both cameras and may hang, fail, or return
    invalid pictures.
    """

    def __init__(
        self,
        grab: Callable[[threading.Event], Pair],
        site: CameraSite,
        what: str,
        *,
        margin: float = 0.0,
    ) -> None:
        """Prepare; nothing is exposed before `start`.

        Args:
            grab: exposes left and right; it should end when its event is set. Raises HardwareError.
            site: timeout, attempts, and skew.
            what: for messages, as "cameras (folder pictures/)".
            margin: time added to the site's timeout, for a `grab` that keeps the deadline itself,
                s.
        """
        self._skew = site.skew
        self._exposer = Exposer(
            grab, self._problem, timeout=site.timeout + margin, attempts=site.attempts, what=what
        )
        self._result: PairPicture | None = None

    def start(self, number: int) -> None:
        """Begin an exposure; one under way is cancelled."""
        self._result = None
        self._exposer.start(number)

    def poll(self, now: float) -> None:
        """Check whether the exposure is done, overdue or to be repeated; `now` of any clock, s."""
        self._exposer.poll(now)

    @property
    def result(self) -> PairPicture | None:
        """Result of the last exposure; None while one is under way, and before the first."""
        outcome = self._exposer.outcome
        if self._result is None and outcome is not None:
            if outcome.taken is None:
                self._result = PairPicture(outcome.number, reason=outcome.reason)
            else:
                left, right = outcome.taken
                for shot in (left, right):
                    shot.pixels.flags.writeable = False
                self._result = PairPicture(
                    outcome.number, left.pixels, right.pixels, left.time, right.time
                )
        return self._result

    def wait(self, deadline: float) -> bool:
        """Wait at most `deadline`, s, for something that `poll` has to process; return whether
        there is.
        """
        return self._exposer.wait(deadline)

    def close(self) -> None:
        """Cancel the exposure under way."""
        self._exposer.close()

    def _problem(self, pair: Pair) -> str:
        for name, shot in zip(("left", "right"), pair, strict=True):
            pixels = shot.pixels
            if (
                not isinstance(pixels, np.ndarray)
                or pixels.dtype != np.uint8
                or pixels.ndim != 3
                or pixels.shape[2] != 3
                or min(pixels.shape[:2]) < _LEAST_SIZE
            ):
                shape = getattr(pixels, "shape", None)
                return f"the {name} camera's picture is no (h, w, 3) uint8 picture, but {shape}"
        left, right = pair
        if left.pixels.shape != right.pixels.shape:
            return (
                f"the pictures' sizes differ: left {left.pixels.shape[:2]}, right "
                f"{right.pixels.shape[:2]}; set both cameras to the same mode"
            )
        apart = abs(left.time - right.time)
        if not apart <= self._skew:
            return (
                f"the two eyes' exposures are {apart:.2f} s apart, at most {self._skew:g} s (the "
                "site's skew); they do not show the same scene"
            )
        return ""


def read_pictures(*paths: Path) -> list[Picture]:
    """Read picture files of one exposure as (h, w, 3) uint8 RGB, in the sensors' orientation.

    Pictures of 10 to 16 bits are scaled to 8, all alike.

    Raises:
        HardwareError: a file cannot be read, or is not a picture.
    """
    from unwrinkle.models.io.images import decoded_images

    encoded = []
    for path in paths:
        try:
            encoded.append(np.fromfile(path, dtype=np.uint8))
        except OSError as error:
            raise HardwareError(f"cannot read {path}: {error.strerror or error}") from None
    pictures: list[Picture] = []
    for path, data, image in zip(paths, encoded, decoded_images(encoded), strict=True):
        if image is None:
            raise HardwareError(
                f"{path} is no picture that can be read ({data.size} bytes); set the camera to "
                "JPEG or PNG"
            )
        pictures.append(image)
    return pictures


def read_picture(path: Path) -> Picture:
    """Read a picture file as (h, w, 3) uint8 RGB; see `read_pictures`."""
    return read_pictures(path)[0]


def expose(camera: PairCamera, number: int, deadline: float) -> PairPicture:
    """Expose one pair and wait for it at most `deadline`, s; a failure is the result's reason."""
    end = time.monotonic() + deadline
    camera.start(number)
    while time.monotonic() < end:
        camera.poll(time.monotonic())
        if camera.result is not None:
            return camera.result
        time.sleep(0.002)
    return PairPicture(number, reason=f"no pair within {deadline:g} s")
