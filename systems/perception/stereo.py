"""Drake system of stereo perception: a pair of the head's images in, the range map out."""

import dataclasses as dc

from unwrinkle.flattening.capture_to_observation import StereoCapture, map_of
from unwrinkle.flattening.station_messages import HeadImage
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.sensor import noise_profile
from unwrinkle.perception.stereo.head import StereoHead
from unwrinkle.perception.stereo.pair import StereoPair
from unwrinkle.systems.perception.base import PerceptionSystem

#: Maximum time between the exposures of the two cameras, s.
MAX_EXPOSURE_OFFSET = 1.0
#: Maximum difference between the head angles reported with the two images, rad: a few steps of the
#: pan-tilt units.
MAX_GAZE_DIFFERENCE = 7e-4
#: Height of the lowest garment that a stereo pair distinguishes from the table, m.
UNSEEN = noise_profile("stereo-head").garment_height


class StereoPerceptionSystem(PerceptionSystem):
    """Match the pair of the last exposure. Inputs: `left_image`, `right_image` (`HeadImage`)."""

    def __init__(self, cell: Cell, head: StereoHead, *, seed: int = 0) -> None:
        """Keep the cell and the head.

        Args:
            cell: robot and cell.
            head: calibrated stereo head.
            seed: seed of perception's random numbers.
        """
        super().__init__({"left_image": HeadImage(), "right_image": HeadImage()}, unseen=UNSEEN)
        self._cell, self._head, self._seed = cell, head, seed

    def range_map(self, number: int, left: HeadImage, right: HeadImage) -> RangeMap:
        """Match a pair.

        Raises:
            InputError: an image is missing, or the two belong to different looks, times or head
                angles.
        """
        if left.number != right.number:
            raise InputError(
                f"look {number}: the images belong to different looks, {left.number} (left) and "
                f"{right.number} (right); look again"
            )
        for side, image in (("left", left), ("right", right)):
            if image.pixels is None:
                raise InputError(
                    f"look {number}: the {side} camera returned no image"
                    f"{': ' if image.reason else ''}{image.reason}"
                )
        _check_together(number, left, right)
        assert left.pixels is not None and right.pixels is not None
        pair = StereoPair(left.pixels, right.pixels, f"look {number}")
        return map_of(StereoCapture(pair, self._head, left.gaze), self._cell, seed=self._seed)


def _check_together(number: int, left: HeadImage, right: HeadImage) -> None:
    """Refuse a pair whose images differ in time or in head angles."""
    apart = abs(left.time - right.time)
    if not apart <= MAX_EXPOSURE_OFFSET:
        raise InputError(
            f"look {number}: the left and right images were exposed {apart:.1f} s apart, at most "
            f"{MAX_EXPOSURE_OFFSET:.1f} s is allowed; look again"
        )
    turned = max(
        abs(a - b) for a, b in zip(dc.astuple(left.gaze), dc.astuple(right.gaze), strict=True)
    )
    if not turned <= MAX_GAZE_DIFFERENCE:
        raise InputError(
            f"look {number}: the head angles of the two images differ by {1e3 * turned:.1f} mrad, "
            f"at most {1e3 * MAX_GAZE_DIFFERENCE:.1f} mrad is allowed; the head moved between the "
            "exposures, look again"
        )
