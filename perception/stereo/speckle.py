"""Speckle filter of disparity images: removes small isolated components (chance matches)."""

import dataclasses

import cv2
import numpy as np

from unwrinkle.perception.stereo.matching import Disparity

#: Approximate width of the subsampled image on which components are labelled, pixels.
_WIDTH = 600

#: Size of a component, as a fraction of the valid pixels, below which it is speckle.
_SHARE = 0.01

#: Largest disparity gradient within a component, pixels per pixel.
_SLOPE = 0.5

#: Fixed-point scale of OpenCV's speckle filter.
_SIXTEENTHS = 16


def remove_speckle(disparity: Disparity) -> Disparity:
    """Invalidate small connected components of a disparity image.

    The table fills most of the view, and a garment is connected to it. A component of less than 1 %
    of the valid pixels, separated by a disparity step, is neither.
    """
    step = max(1, round(disparity.valid.shape[1] / _WIDTH))
    valid = disparity.valid[::step, ::step]
    scaled = np.rint(_SIXTEENTHS * disparity.disparity[::step, ::step])
    nothing = -32768
    labelled = np.where(valid, np.clip(scaled, nothing + 1, 32767), nothing).astype(np.int16)
    least = int(_SHARE * np.count_nonzero(valid))
    cv2.filterSpeckles(labelled, nothing, least, _SIXTEENTHS * _SLOPE * step)
    dropped = valid & (labelled == nothing)
    if not dropped.any():
        return disparity
    values, whole = disparity.disparity.copy(), disparity.valid.copy()
    for i, j in np.argwhere(dropped) * step:  # few pixels: speckle is small
        values[i : i + step, j : j + step] = 0.0
        whole[i : i + step, j : j + step] = False
    for array in (values, whole):
        array.setflags(write=False)
    return dataclasses.replace(disparity, disparity=values, valid=whole)
