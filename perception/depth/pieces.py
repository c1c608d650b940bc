"""Pieces that stand on the table: which one is the garment, and what else lies in view.

A gripper parked in view is higher than any garment lies, and is left out with a note. Of several
pieces that may each be a garment, none is chosen silently: a pixel on the garment decides.
"""

import logging
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.arrays import Mask
from unwrinkle.models.errors import SeveralGarmentsError

_log = logging.getLogger(__name__)

#: Height above the table, metres, that a garment on it does not reach.
MAX_GARMENT_HEIGHT_M = 0.22

#: Height, metres, down to which the sides of a higher object are left out with it, and its rim.
_SIDE_HEIGHT_M = 0.03
_RIM_M = 0.02

#: Least area of a higher object, and of a second garment, square metres.
_MIN_OBJECT_M2 = 0.0008
_MIN_GARMENT_M2 = 0.008

#: Least area of a second piece that may be the garment, fraction of the largest.
_MIN_SHARE = 0.25

#: Distance, metres, below which two pieces are parts of one garment, seen by their folds.
_SAME_GARMENT_M = 0.06


def without_high_objects(
    height: NDArray[np.floating[Any]], seen: Mask, pixel: float, name: str
) -> Mask:
    """Return the pixels that are readings of no object higher than a garment.

    Args:
        height: (h, w) heights above the table, metres.
        seen: (h, w) bool, pixels with a reading.
        pixel: spacing of the pixels on the table, metres.
        name: of the capture, for the note.

    Raises:
        SeveralGarmentsError: such an object touches what may be the garment.
    """
    high = (seen & (height > MAX_GARMENT_HEIGHT_M)).astype(np.uint8)
    least = max(4.0, _MIN_OBJECT_M2 / pixel**2)
    if np.count_nonzero(high) < least:
        return seen
    raised = (seen & (height > _SIDE_HEIGHT_M)).astype(np.uint8)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(raised)
    above = np.bincount(labels[high > 0], minlength=len(stats))
    above[0] = 0
    objects = np.flatnonzero(above >= least)
    if objects.size == 0:
        return seen
    for label in objects:
        low = float(stats[label, cv2.CC_STAT_AREA] - above[label]) * pixel**2
        if low > max(_MIN_GARMENT_M2, 0.5 * above[label] * pixel**2):
            top = float(np.quantile(height[(labels == label) & (high > 0)], 0.9))
            raise SeveralGarmentsError(
                f"{name}: an object {top:.2f} m above the table touches what may be the garment "
                f"(of at most {MAX_GARMENT_HEIGHT_M} m); move the arm or the object out of view, "
                "or name the garment's part of the image with --region"
            )
    mask = np.isin(labels, objects)
    top = float(np.quantile(height[mask], 0.9))
    _log.warning(
        "%s: an object %.2f m above the table lies in view; it is left out",
        name,
        top,
    )
    radius = max(1, round(_RIM_M / pixel))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    return np.asarray(seen & (cv2.dilate(mask.astype(np.uint8), disc) == 0))


def refuse_other_pieces(garment: Mask, raised: Mask, pixel: float, name: str) -> None:
    """Refuse a view in which another piece may be the garment as well.

    Args:
        garment: (h, w) bool, the mask of the garment.
        raised: (h, w) bool, pixels that by depth stand above the table.
        pixel: spacing of the pixels on the table, metres.
        name: of the capture, for messages.

    Raises:
        SeveralGarmentsError: there is such a piece; the message has the places of both.
    """
    count, labels, _ = _labelled(raised | garment, pixel)
    own = np.unique(labels[garment])
    areas = np.bincount(labels.ravel(), minlength=count) * pixel**2
    areas[0] = areas[own] = 0.0
    area = np.count_nonzero(garment) * pixel**2
    least = max(_MIN_GARMENT_M2, _MIN_SHARE * area)
    others = [label for label in np.argsort(-areas) if areas[label] >= least]
    if not others:
        return
    column, row = _middle(garment)
    places = [
        f"{np.count_nonzero(garment) * pixel**2:.3f} around column {column:.0f}, row {row:.0f}"
    ]
    for label in others[:3]:
        at = _middle(raised & (labels == label))
        places.append(f"{areas[label]:.3f} around column {at[0]:.0f}, row {at[1]:.0f}")
    raise SeveralGarmentsError(
        f"{name}: {1 + len(others)} pieces on the table may be the garment (square metres: "
        f"{'; '.join(places)}); leave one there, or name a pixel on it, e.g. --at "
        f"{column:.0f},{row:.0f}; of one thin cloth, depth alone sees the folds: give --colour"
    )


def _labelled(raised: Mask, pixel: float) -> tuple[int, NDArray[Any], Mask]:
    """Return the number of pieces, the labels (h, w) and the pixels near a piece, pieces that are
    close to each other as one.
    """
    radius = max(1, round(0.5 * _SAME_GARMENT_M / pixel))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    grown = cv2.dilate(raised.astype(np.uint8), disc)
    count, labels = cv2.connectedComponents(grown)
    return count, np.where(raised, labels, 0), np.asarray(grown) > 0


def named_piece(raised: Mask, pixel: float, name: str, at: tuple[float, float]) -> Mask:
    """Return the piece (h, w) of the pixels above the table that a pixel lies on.

    Args:
        raised: (h, w) bool, pixels that stand above the table.
        pixel: their spacing on the table, metres.
        name: of the capture, for messages.
        at: column and row of a pixel on the garment.

    Raises:
        SeveralGarmentsError: there is no piece at the pixel.
    """
    _, labels, near = _labelled(raised, pixel)
    return _named(labels, near, at, name)


def _named(labels: NDArray[Any], near: Mask, at: tuple[float, float], name: str) -> Mask:
    """Return the piece at a pixel."""
    column, row = round(at[0]), round(at[1])
    rows, columns = labels.shape
    if not (0 <= column < columns and 0 <= row < rows):
        raise SeveralGarmentsError(
            f"{name}: pixel {column},{row} of --at lies outside the image of {columns} x {rows}"
        )
    found, where = cv2.distanceTransformWithLabels(
        (labels == 0).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    if not near[row, column]:
        raise SeveralGarmentsError(
            f"{name}: nothing stands above the table at column {column}, row {row} of --at; the "
            f"nearest piece is {found[row, column]:.0f} pixels away"
        )
    source = where == where[row, column]
    label = int(labels[source & (labels > 0)][0])
    return np.asarray(labels == label)


def _middle(mask: Mask) -> tuple[float, float]:
    """Return column and row of the piece's pixel that is nearest to its centre of area."""
    rows, columns = np.nonzero(mask)
    nearest = np.argmin((rows - rows.mean()) ** 2 + (columns - columns.mean()) ** 2)
    return float(columns[nearest]), float(rows[nearest])
