"""Small islands of disparity that nothing joins to the rest: chance matches, mostly of bare walls."""

import dataclasses

import cv2
import numpy as np

from unwrinkle.perception.stereo_matching import Disparity

_WIDTH = 600  # islands are sought on a thinned image of about this width
_SHARE = 0.01  # of the valid pixels; what is smaller is an island
_SLOPE = 0.5  # pixels of disparity per pixel that still join neighbours
_SIXTEENTHS = 16


def without_islands(disparity: Disparity) -> Disparity:
    """Call islands not valid.

    A garment joins the table it lies on, and the table is most of the view. A patch of less than 1 %
    of what was matched, apart from all else by a step of the disparity, is neither.
    """
    height, width = disparity.valid.shape
    step = max(1, round(width / _WIDTH))
    valid = disparity.valid[::step, ::step]
    scaled = np.rint(_SIXTEENTHS * disparity.disparity[::step, ::step])
    nothing = -32768
    labelled = np.where(valid, np.clip(scaled, nothing + 1, 32767), nothing).astype(np.int16)
    least = int(_SHARE * np.count_nonzero(valid))
    cv2.filterSpeckles(labelled, nothing, least, _SIXTEENTHS * _SLOPE * step)
    kept = (labelled != nothing) | ~valid  # thinned pixels that were not valid tell nothing
    whole = kept.repeat(step, axis=0).repeat(step, axis=1)[:height, :width]
    valid = disparity.valid & whole
    values = np.where(valid, disparity.disparity, np.float32(0.0))
    for array in (values, valid):
        array.setflags(write=False)
    return dataclasses.replace(disparity, disparity=values, valid=valid)
