"""Drake system of the analysis: a range map in, the policy's observation out."""

import logging
import time

from unwrinkle.flattening.capture_to_observation import observation_of
from unwrinkle.flattening.messages import Analysed, Perceived
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell
from unwrinkle.systems.function_system import FunctionSystem

_log = logging.getLogger(__name__)


class AnalysisSystem(FunctionSystem):
    """Find the wrinkles. Input: `range_map` (`Perceived`); output: `analysis` (`Analysed`)."""

    def __init__(self, cell: Cell) -> None:
        """Keep the cell, whose scenario holds the table and the rules."""
        super().__init__({"range_map": Perceived()}, ("analysis", Analysed()), self._analyse)
        self._cell = cell

    def _analyse(self, perceived: Perceived) -> Analysed:
        number = perceived.number
        if perceived.range_map is None:
            return Analysed(number, None, perceived.reason)
        clock = time.perf_counter()
        try:
            observation = observation_of(perceived.range_map, self._cell)
        except InputError as error:
            reason = f"look {number}: {' '.join(str(error).split())}"
            _log.info(reason)
            return Analysed(number, None, reason, time.perf_counter() - clock)
        return Analysed(number, observation, seconds=time.perf_counter() - clock)
