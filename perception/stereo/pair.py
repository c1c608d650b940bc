"""Image pairs of the stereo head, checked for exposure, contrast and size."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.errors import InputError
from unwrinkle.models.io.images import decoded_images

#: Grey level below which a pixel is black.
_BLACK_LEVEL = 4

#: Grey level above which a pixel is saturated.
_SATURATED_LEVEL = 251

#: Largest fraction of black, or of saturated, pixels.
_MAX_BAD_FRACTION = 0.6

#: Least standard deviation of the grey levels.
_MIN_CONTRAST = 1.5


@dataclass(frozen=True, eq=False)
class StereoPair:
    """Simultaneous images of the left and the right camera.

    Attributes:
        left, right: (h, w, 3) uint8 RGB.
        name: for messages.

    Raises:
        InputError: the images differ in size, are not RGB, are black, saturated or without
            contrast, or are identical.
    """

    left: NDArray[np.uint8]
    right: NDArray[np.uint8]
    name: str = "pair"

    def __post_init__(self) -> None:
        """Check the images and make read-only views."""
        for side in ("left", "right"):
            image = np.asarray(getattr(self, side))
            if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8:
                raise InputError(
                    f"{self.name}: the {side} image is {image.dtype} {image.shape}, wanted uint8 "
                    "(rows, columns, 3)"
                )
            image = image.view()
            image.setflags(write=False)
            object.__setattr__(self, side, image)
        if self.left.shape != self.right.shape:
            sizes = [f"{i.shape[1]} x {i.shape[0]}" for i in (self.left, self.right)]
            raise InputError(
                f"{self.name}: the left image is {sizes[0]}, the right {sizes[1]}; "
                "take both with the same resolution"
            )
        left, right = _thinned(self.left), _thinned(self.right)
        _check_exposure(left, f"{self.name}: the left eye")
        _check_exposure(right, f"{self.name}: the right eye")
        if np.array_equal(left, right):
            raise InputError(f"{self.name}: left and right are the same image; name both eyes")


def load_pair(left: str | Path, right: str | Path) -> StereoPair:
    """Load a pair from two image files, in the sensor's orientation.

    Images of 10 to 16 bits are scaled to 8, both alike.

    Raises:
        InputError: a file is missing or not an image, or the pair is unusable; see `StereoPair`.
    """
    left, right = Path(left), Path(right)
    name = f"{left.name} + {right.name}"
    encoded = []
    for path, side in ((left, "left"), (right, "right")):
        if not path.is_file():
            raise InputError(f"{path}: no such {side} image; check the name or the folder")
        encoded.append(np.fromfile(path, dtype=np.uint8))
    images = decoded_images(encoded)
    for path, image in zip((left, right), images, strict=True):
        if image is None:
            raise InputError(f"{path}: is no readable image; copy or take it again")
    left_image, right_image = (image for image in images if image is not None)
    return StereoPair(left_image, right_image, name)


def _thinned(image: NDArray[np.uint8]) -> NDArray[Any]:
    step = max(1, image.shape[1] // 400)
    return image[::step, ::step]


def _check_exposure(image: NDArray[Any], label: str) -> None:
    grey = image.mean(axis=2)
    dark, bright = float(np.mean(grey < _BLACK_LEVEL)), float(np.mean(grey > _SATURATED_LEVEL))
    if dark > _MAX_BAD_FRACTION:
        raise InputError(f"{label} is black ({dark:.0%} of it); check its lens cap and exposure")
    if bright > _MAX_BAD_FRACTION:
        raise InputError(f"{label} is saturated ({bright:.0%} of it); shorten its exposure")
    if grey.std() < _MIN_CONTRAST:
        raise InputError(f"{label} shows no structure (contrast {grey.std():.1f}); check its focus")
