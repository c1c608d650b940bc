"""Small islands of disparity that nothing joins to the rest: chance matches, mostly of bare walls."""

import dataclasses

import cv2
import numpy as np

from unwrinkle.perception.stereo.matching import Disparity

_WIDTH = 600  # islands are sought on a thinned image of about this width
_SHARE = 0.01  # of the valid pixels; what is smaller is an island
_SLOPE = 0.5  # pixels of disparity per pixel that still join neighbours
_SIXTEENTHS = 16


def remove_speckle(disparity: Disparity) -> Disparity:
    """Call islands not valid.

    A garment joins the table it lies on, and the table is most of the view. A patch of less than 1 %
    of what was matched, apart from all else by a step of the disparity, is neither.
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
    for i, j in np.argwhere(dropped) * step:  # few: islands are small
        values[i : i + step, j : j + step] = 0.0
        whole[i : i + step, j : j + step] = False
    for array in (values, whole):
        array.setflags(write=False)
    return dataclasses.replace(disparity, disparity=values, valid=whole)
