"""Grippers on the robot controller's digital outputs and inputs."""

from unwrinkle.hardware.controller.base import DigitalIo
from unwrinkle.hardware.grippers.base import READ_PERIOD_S, SIDES, GripperPair, Grippers
from unwrinkle.models.site import GripperSite


class DigitalGrippers(GripperPair):
    """Grippers on the controller's digital outputs, with the site's inputs for their sensors."""

    def __init__(self, site: GripperSite, io: DigitalIo) -> None:
        """Use a driver's inputs and outputs; only inputs are read before a command."""
        super().__init__(site)
        self._io = io
        self._inputs = [a for a in (*site.closed_input, *site.holding_input) if a]
        self._next_read = 0.0
        self._taken: list[bool | None] = [None, None]

    @property
    def problem(self) -> str:
        """Inputs that cannot be read; empty if there are none."""
        missing = [str(a) for a in self._inputs if self._io.inputs.get(a) is None]
        if not missing:
            return ""
        why = self._io.io_problem or "no answer"
        return f"the grippers' inputs {', '.join(missing)} cannot be read ({why})"

    def close(self) -> None:
        """Do nothing; the outputs stay as they are."""

    def _listen(self, now: float) -> None:
        for index in range(2):
            written = self._io.outputs_written.get(self._site.close_output[index])
            if written is not None:
                self._taken[index] = bool(written) != self._site.inverted[index]
        if now >= self._next_read:
            self._next_read = now + READ_PERIOD_S
            for address in self._inputs:
                self._io.read_input(address)

    def _send(self, index: int, closed: bool) -> None:
        value = int(closed != self._site.inverted[index])
        self._io.write_output(self._site.close_output[index], value)

    def _lacks(self, index: int, closed: bool) -> str:
        word, side = "closed" if closed else "open", SIDES[index]
        output, value = (
            self._site.close_output[index],
            int(closed != self._site.inverted[index]),
        )
        if self._io.outputs_written.get(output) != value:
            why = self._io.io_problem or "it has not answered"
            return (
                f"the controller has not set output {output} for the {side} gripper ({why}); check "
                "the site's close_output and the I/O connection"
            )
        measured = self._sensor(self._site.closed_input[index])
        if self._site.closed_input[index] and measured != closed:
            says = "nothing" if measured is None else ("closed" if measured else "open")
            return (
                f"the {side} gripper is not {word}: input {self._site.closed_input[index]} says "
                f"{says}; check its air, its cable and the site's addresses"
            )
        if closed and self._site.holding_input[index]:
            holds = self._sensor(self._site.holding_input[index])
            if holds is None:
                return (
                    f"input {self._site.holding_input[index]} of the {side} gripper does not answer"
                )
        return ""

    def _sensor(self, address: int) -> bool | None:
        value = self._io.inputs.get(address) if address else None
        return None if value is None else bool(value)

    def _closed(self, index: int) -> bool:
        measured = self._sensor(self._site.closed_input[index])
        return bool(self._taken[index]) if measured is None else measured

    def _holding(self, index: int) -> bool | None:
        return self._sensor(self._site.holding_input[index])


def open_digital(site: GripperSite, io: DigitalIo | None, stroke: float | None) -> Grippers:
    """Use the controller's inputs and outputs; see `factory.GripperOpener`."""
    assert io is not None
    return DigitalGrippers(site, io)
