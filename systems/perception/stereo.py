"""From the head's pictures to the range map: computed when asked for, once per exposure."""

import dataclasses as dc
import logging
import time

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from unwrinkle.flattening.messages import Perceived
from unwrinkle.flattening.station_messages import HeadImage
from unwrinkle.models.errors import InputError, NoGarmentError
from unwrinkle.models.robot import Cell
from unwrinkle.perception.sensor import noise_profile
from unwrinkle.perception.stereo.head import StereoHead
from unwrinkle.perception.stereo.pair import StereoPair
from unwrinkle.perception.stereo.range_mapping import KnownTable, range_map_from_pair
from unwrinkle.systems.latest import Latest

#: Most time between the eyes' exposures, s, and between the angles that they report for one look, rad: a few of the
#: units' steps.
MOST_APART, MOST_TURNED = 1.0, 7e-4
#: Height of a garment that a stereo pair does not tell from the table, m.
UNSEEN = noise_profile("stereo-head").garment_height

_log = logging.getLogger(__name__)


def known_table(cell: Cell) -> KnownTable:
    """The cell's working table, in the form that perception takes."""
    x, y, height = (float(value) for value in cell.table_centre)
    width, depth = cell.scenario.table.size
    return KnownTable((x, y), (width, depth), height)


def failed(number: int, error: InputError, clock: float, *, unseen: float) -> Perceived:
    """What is handed on where perception refuses a look.

    Args:
        number: of the look.
        error: that it ended with.
        clock: `time.perf_counter` when it began.
        unseen: height of a garment that the sensor does not tell from the table, m.
    """
    reason = " ".join(str(error).split())
    _log.info("look %d: %s", number, reason)
    seconds = time.perf_counter() - clock
    empty = isinstance(error, NoGarmentError)
    return Perceived(number, None, reason, empty=empty, unseen=unseen, seconds=seconds)


class StereoPerception(LeafSystem):
    """Stereo matching of the last exposure.

    Inputs: `left_image`, `right_image` (`HeadImage`). Outputs: `exposed`, vector (1,), number of the last exposure that both
    eyes have answered, cheap; `range_map` (`Perceived`), computed when it is evaluated.
    """

    def __init__(self, cell: Cell, head: StereoHead, *, seed: int = 0) -> None:
        """Take the table from the cell.

        Args:
            cell: the robot in its cell.
            head: as calibrated.
            seed: of perception's random choices.
        """
        super().__init__()
        self._head, self._table, self._seed = head, known_table(cell), seed
        images = [
            self.DeclareAbstractInputPort(name, AbstractValue.Make(HeadImage()))
            for name in ("left_image", "right_image")
        ]
        tickets = {self.input_port_ticket(port.get_index()) for port in images}
        self.DeclareVectorOutputPort("exposed", 1, self._exposed, tickets)
        self.DeclareAbstractOutputPort(
            "range_map", lambda: AbstractValue.Make(Perceived()), self._perceive, tickets
        )
        self._latest = Latest(self._range_map, _same)

    def _images(self, context: Context) -> tuple[HeadImage, HeadImage]:
        left = self.get_input_port(0).Eval(context)
        return left, self.get_input_port(1).Eval(context)

    def _exposed(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, min(image.number for image in self._images(context)))

    def _perceive(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self._latest(self._images(context)))

    def _range_map(self, images: tuple[HeadImage, HeadImage]) -> Perceived:
        left, right = images
        number = min(left.number, right.number)
        if number == 0:
            return Perceived(reason="nothing was looked at yet")
        clock = time.perf_counter()
        try:
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
            found = range_map_from_pair(
                StereoPair(left.pixels, right.pixels, f"look {number}"),
                self._head,
                left.gaze,
                table=self._table,
                seed=self._seed,
            )
        except InputError as error:
            return failed(number, error, clock, unseen=UNSEEN)
        return Perceived(number, found, seconds=time.perf_counter() - clock)


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


def _same(a: tuple[HeadImage, HeadImage], b: tuple[HeadImage, HeadImage]) -> bool:
    return all(_same_image(x, y) for x, y in zip(a, b, strict=True))


def _same_image(a: HeadImage, b: HeadImage) -> bool:
    if (a.number, a.gaze, a.time, a.reason) != (b.number, b.gaze, b.time, b.reason):
        return False
    if a.pixels is None or b.pixels is None:
        return a.pixels is b.pixels
    return a.pixels is b.pixels or np.array_equal(a.pixels, b.pixels)
