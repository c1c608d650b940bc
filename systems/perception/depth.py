"""From the depth camera's picture to the range map: computed when asked for, once per exposure."""

import time

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from unwrinkle.flattening.messages import Perceived
from unwrinkle.flattening.station_messages import DepthImage
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell
from unwrinkle.perception.depth.range_mapping import range_map_from_capture
from unwrinkle.perception.depth.table_crop import crop_to_table
from unwrinkle.perception.sensor import noise_profile
from unwrinkle.systems.latest import Latest
from unwrinkle.systems.perception.stereo import failed


class DepthPerception(LeafSystem):
    """The garment in the depth camera's last exposure.

    Input: `image` (`DepthImage`). Outputs: `exposed`, vector (1,), number of the last exposure, cheap; `range_map`
    (`Perceived`), computed when it is evaluated.
    """

    def __init__(self, cell: Cell, *, seed: int = 0) -> None:
        """Take the table from the cell.

        Args:
            cell: the robot in its cell; its table counts where the camera's pose is unknown.
            seed: of perception's random choices.
        """
        super().__init__()
        x, y = cell.scenario.garment_centre
        self._centre, self._height = (x, y), float(cell.table_centre[2])
        across, along = cell.scenario.table.size
        self._table_centre, self._table_size = cell.table_centre, (across, along)
        self._seed = seed
        port = self.DeclareAbstractInputPort("image", AbstractValue.Make(DepthImage()))
        tickets = {self.input_port_ticket(port.get_index())}
        self.DeclareVectorOutputPort("exposed", 1, self._exposed, tickets)
        self.DeclareAbstractOutputPort(
            "range_map", lambda: AbstractValue.Make(Perceived()), self._perceive, tickets
        )
        self._latest = Latest(self._range_map, _same)

    def _exposed(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, self.get_input_port(0).Eval(context).number)

    def _perceive(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self._latest(self.get_input_port(0).Eval(context)))

    def _range_map(self, image: DepthImage) -> Perceived:
        number = image.number
        if number == 0:
            return Perceived(reason="nothing was looked at yet")
        clock, unseen = time.perf_counter(), 0.0
        try:
            if image.capture is None:
                raise InputError(
                    f"look {number}: the depth camera returned nothing"
                    f"{': ' if image.reason else ''}{image.reason}"
                )
            unseen = noise_profile(image.capture.camera.sensor).garment_height
            # From above the floor may fill more of the view than the table does.
            table = crop_to_table(image.capture, self._table_centre, self._table_size)
            found = range_map_from_capture(
                table, centre=self._centre, table_height=self._height, seed=self._seed
            )
        except InputError as error:
            return failed(number, error, clock, unseen=unseen)
        return Perceived(number, found, seconds=time.perf_counter() - clock)


def _same(a: DepthImage, b: DepthImage) -> bool:
    if (a.number, a.time, a.reason) != (b.number, b.time, b.reason):
        return False
    if a.capture is None or b.capture is None:
        return a.capture is b.capture
    return a.capture is b.capture or np.array_equal(a.capture.depth, b.capture.depth)
