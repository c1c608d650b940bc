"""Stereo perception as a system: the head's pictures to the range map."""

import dataclasses as dc

from unwrinkle.flattening.perceiving import StereoCapture, map_of
from unwrinkle.flattening.station_messages import HeadImage
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.sensor import noise_profile
from unwrinkle.perception.stereo.head import StereoHead
from unwrinkle.perception.stereo.pair import StereoPair
from unwrinkle.systems.perception.base import PerceptionSystem

#: Greatest time between the eyes' exposures, s.
MOST_APART = 1.0
#: Greatest difference between the angles that the eyes report for one look, rad: a few of the units' steps.
MOST_TURNED = 7e-4
#: Least height of a garment that a stereo pair tells from the table, m.
UNSEEN = noise_profile("stereo-head").garment_height


class StereoPerceptionSystem(PerceptionSystem):
    """Stereo matching of the last exposure. Inputs: `left_image`, `right_image` (`HeadImage`)."""

    def __init__(self, cell: Cell, head: StereoHead, *, seed: int = 0) -> None:
        """Keep the cell and the head.

        Args:
            cell: the robot in its cell.
            head: as calibrated.
            seed: of perception's random choices.
        """
        super().__init__({"left_image": HeadImage(), "right_image": HeadImage()}, unseen=UNSEEN)
        self._cell, self._head, self._seed = cell, head, seed

    def range_map(self, number: int, left: HeadImage, right: HeadImage) -> RangeMap:
        """Match the pair."""
        if left.number != right.number:
            raise InputError(
                f"look {number}: the eyes answer different commands, {left.number} (left) and "
                f"{right.number} (right); look again"
            )
        for side, image in (("left", left), ("right", right)):
            if image.pixels is None:
                raise InputError(
                    f"look {number}: the {side} camera returned nothing"
                    f"{': ' if image.reason else ''}{image.reason}"
                )
        _check_together(number, left, right)
        assert left.pixels is not None and right.pixels is not None
        pair = StereoPair(left.pixels, right.pixels, f"look {number}")
        return map_of(StereoCapture(pair, self._head, left.gaze), self._cell, seed=self._seed)


def _check_together(number: int, left: HeadImage, right: HeadImage) -> None:
    """Refuse pictures of two times, or of two gazes."""
    apart = abs(left.time - right.time)
    if not apart <= MOST_APART:
        raise InputError(
            f"look {number}: the eyes' pictures were taken {apart:.1f} s apart, at most "
            f"{MOST_APART:.1f} s; look again"
        )
    turned = max(
        abs(a - b) for a, b in zip(dc.astuple(left.gaze), dc.astuple(right.gaze), strict=True)
    )
    if not turned <= MOST_TURNED:
        raise InputError(
            f"look {number}: the eyes report gazes {1e3 * turned:.1f} mrad apart, at most "
            f"{1e3 * MOST_TURNED:.1f} mrad; the head moved in between, look again"
        )
