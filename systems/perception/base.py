"""Base of the perception systems: images of a look in, its number and its range map out."""

import logging
import time
from abc import abstractmethod
from collections.abc import Mapping
from typing import Any

from pydrake.systems.framework import BasicVector, Context

from unwrinkle.flattening.messages import Perceived
from unwrinkle.models.errors import InputError, NoGarmentError
from unwrinkle.models.shared import Shared
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.systems.function_system import FunctionSystem

_log = logging.getLogger(__name__)


class PerceptionSystem(FunctionSystem):
    """System that computes the range map of the last look on demand.

    Outputs: `range_map` (`Perceived`); `exposed`, vector (1,), number of the last look for which
    all images have arrived (cheap to evaluate).
    """

    def __init__(
        self, inputs: Mapping[str, Shared], *, unseen: float, depends_on: int | None = None
    ) -> None:
        """Declare the ports.

        Args:
            inputs: Names of the input ports, images first, each with an example of its value.
            unseen: Lowest garment that the sensor can distinguish from the table, m.
            depends_on: Number of inputs that are images; all if left out.
        """
        super().__init__(inputs, ("range_map", Perceived()), self._perceived, depends_on=depends_on)
        self._unseen = unseen
        self._pictures = len(inputs) if depends_on is None else depends_on
        self.DeclareVectorOutputPort("exposed", 1, self._exposed, self.input_tickets)

    @abstractmethod
    def range_map(self, number: int, *inputs: Any) -> RangeMap:
        """Compute the range map of a look.

        Raises:
            NoGarmentError: The table is bare.
            InputError: An image is missing, or cannot be used.
        """

    def unseen(self, *inputs: Any) -> float:
        """Return the height of the lowest garment that the sensor detects on the table, m."""
        return self._unseen

    def _exposed(self, context: Context, output: BasicVector) -> None:
        output.SetAtIndex(0, self._number(*self.inputs(context)))

    def _number(self, *inputs: Any) -> int:
        return min(image.number for image in inputs[: self._pictures])

    def _perceived(self, *inputs: Any) -> Perceived:
        number = self._number(*inputs)
        if number == 0:
            return Perceived(reason="no look was taken yet")
        clock = time.perf_counter()
        try:
            found = self.range_map(number, *inputs)
        except InputError as error:
            reason = " ".join(str(error).split())
            _log.info("look %d: %s", number, reason)
            return Perceived(
                number,
                None,
                reason,
                empty=isinstance(error, NoGarmentError),
                unseen=self.unseen(*inputs),
                seconds=time.perf_counter() - clock,
            )
        return Perceived(number, found, seconds=time.perf_counter() - clock)
