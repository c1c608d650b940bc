"""Drake system that evaluates a pure function on demand, once per input."""

from collections.abc import Callable, Mapping
from typing import Any

from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Context, LeafSystem

from unwrinkle.models.shared import Shared


class FunctionSystem(LeafSystem):
    """System with one abstract output that is a pure function of its abstract inputs.

    The output is computed when it is evaluated, and only if an input is another object than at the
    last evaluation. Drake's own cache does not suffice: it is invalidated whenever the system that
    feeds an input updates its state, in every feedback period, even if the value stays the same.
    Seconds of stereo matching would be repeated.
    """

    def __init__(
        self,
        inputs: Mapping[str, Shared],
        output: tuple[str, Shared],
        function: Callable[..., Shared],
        *,
        depends_on: int | None = None,
    ) -> None:
        """Declare the ports.

        Args:
            inputs: Names of the input ports in order, each with an example of its value.
            output: Name of the output port, with an example of its value.
            function: Function of the inputs' values, in order.
            depends_on: Number of inputs, counted from the first, that trigger a new evaluation; all
                if left out.
        """
        super().__init__()
        self._function = function
        self._count = len(inputs) if depends_on is None else depends_on
        self._last: tuple[tuple[Any, ...], Shared] | None = None
        ports = [
            self.DeclareAbstractInputPort(name, AbstractValue.Make(example))
            for name, example in inputs.items()
        ]
        self.input_tickets = {self.input_port_ticket(port.get_index()) for port in ports}
        name, example = output
        self.DeclareAbstractOutputPort(
            name, lambda: AbstractValue.Make(example), self._calc, self.input_tickets
        )

    def inputs(self, context: Context) -> tuple[Any, ...]:
        """Return the values of all inputs, in order."""
        return tuple(
            self.get_input_port(index).Eval(context) for index in range(self.num_input_ports())
        )

    def _calc(self, context: Context, output: AbstractValue) -> None:
        values = self.inputs(context)
        key = values[: self._count]
        if self._last is None or any(
            old is not new for old, new in zip(self._last[0], key, strict=True)
        ):
            self._last = (key, self._function(*values))
        output.set_value(self._last[1])
