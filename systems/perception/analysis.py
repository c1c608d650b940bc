"""From the range map to the wrinkles: computed when asked for, once per look."""

import logging
import time

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, LeafSystem

from unwrinkle.flattening.messages import Analysed, Perceived
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell
from unwrinkle.perception.wrinkles.analysis import analyse
from unwrinkle.systems.latest import Latest

_log = logging.getLogger(__name__)


class WrinkleAnalysis(LeafSystem):
    """Finds the wrinkles. Input: `range_map` (`Perceived`); output: `analysis` (`Analysed`)."""

    def __init__(self, cell: Cell) -> None:
        """Take the table and how to pull (Eq. 5, the section) from the cell's scenario."""
        super().__init__()
        self._table, self._rules = cell.table, cell.scenario.loop
        port = self.DeclareAbstractInputPort("range_map", AbstractValue.Make(Perceived()))
        self.DeclareAbstractOutputPort(
            "analysis",
            lambda: AbstractValue.Make(Analysed()),
            self._calc,
            {self.input_port_ticket(port.get_index())},
        )
        self._latest = Latest(self._analyse, lambda a, b: a is b)

    def _calc(self, context: Context, output: AbstractValue) -> None:
        output.set_value(self._latest(self.get_input_port(0).Eval(context)))

    def _analyse(self, perceived: Perceived) -> Analysed:
        number = perceived.number
        if perceived.range_map is None:
            return Analysed(number, None, perceived.reason)
        clock = time.perf_counter()
        try:
            analysis = analyse(
                perceived.range_map,
                mode=self._rules.mode,
                table=self._table,
                section=self._rules.section,
                pull=self._rules.pull,
            )
        except InputError as error:
            reason = f"look {number}: {' '.join(str(error).split())}"
            _log.info(reason)
            return Analysed(number, None, reason, time.perf_counter() - clock)
        return Analysed(number, analysis, seconds=time.perf_counter() - clock)
