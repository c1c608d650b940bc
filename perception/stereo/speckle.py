"""Speckle filter of disparity images: removes small isolated components (chance matches)."""

import dataclasses

import cv2
import numpy as np

from unwrinkle.perception.stereo.matching import Disparity

#: Approximate width of the subsampled image on which components are labelled, pixels.
_LABEL_WIDTH_PX = 600

#: Size of a component, as a fraction of the valid pixels, below which it is speckle.
_SPECKLE_FRACTION = 0.01

#: Largest disparity gradient within a component, pixels per pixel.
_MAX_GRADIENT = 0.5

#: Fixed-point scale of OpenCV's speckle filter.
_FIXED_POINT = 16


def remove_speckle(disparity: Disparity) -> Disparity:
    """Invalidate small connected components of a disparity image.

    The table fills most of the view, and a garment is connected to it. A component of less than 1 %
    of the valid pixels, separated by a disparity step, is neither.
    """
    step = max(1, round(disparity.valid.shape[1] / _LABEL_WIDTH_PX))
    valid = disparity.valid[::step, ::step]
    scaled = np.rint(_FIXED_POINT * disparity.disparity[::step, ::step])
    nothing = -32768
    labelled = np.where(valid, np.clip(scaled, nothing + 1, 32767), nothing).astype(np.int16)
    least = int(_SPECKLE_FRACTION * np.count_nonzero(valid))
    cv2.filterSpeckles(labelled, nothing, least, _FIXED_POINT * _MAX_GRADIENT * step)
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
