"""The two grippers, on the controller's digital outputs or on a CAN bus: bounded strokes, and whether cloth is held."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Protocol

from unwrinkle.hardware.steady_clock import SteadyClock
from unwrinkle.models.errors import HardwareError
from unwrinkle.models.site import GripperSite

SIDES = ("right", "left")

#: Inputs and positions are asked for this often, s.
READ_PERIOD = 0.05
#: What sensors say has to stay so for this long before a stroke counts as done, s: every sensor is read anew meanwhile.
_CONFIRM = 0.15


@dataclass(frozen=True)
class GripperReport:
    """What is known of both grippers, right and left.

    Attributes:
        command: number of the last command that both have finished.
        opening: distance between the blades, m; None where nothing measures it.
        closed: whether it is closed; where nothing tells, whether it was commanded to be.
        holding: whether it has cloth between its blades; None where nothing can tell.
        reason: why a gripper does not answer or does not move; else empty.
    """

    command: int = 0
    opening: tuple[float, float] | None = None
    closed: tuple[bool, bool] = (False, False)
    holding: tuple[bool | None, bool | None] = (None, None)
    reason: str = ""


class Grippers(Protocol):
    """Both grippers, whatever moves them."""

    @property
    def status(self) -> GripperReport:
        """What is known as of the last poll."""
        ...

    def command(self, number: int, closed: tuple[bool, bool]) -> None:
        """Close or open, right and left; the result is in `status`."""
        ...

    def poll(self, now: float) -> None:
        """Read what came, decide, and write; never waits. `now` is of any clock, s."""
        ...

    def close(self) -> None:
        """End; the grippers stay as they are."""
        ...


class DigitalIo(Protocol):
    """Inputs and outputs of the robot's controller, as its driver has them."""

    @property
    def inputs(self) -> dict[int, int | None]:
        """Last value read of each input; None where unknown."""
        ...

    @property
    def outputs_written(self) -> dict[int, int | None]:
        """Last value that the controller has taken for each output; None where it has not answered yet."""
        ...

    def write_output(self, address: int, value: int) -> None:
        """Ask for an output to be set."""
        ...

    def read_input(self, address: int) -> None:
        """Ask for an input."""
        ...


class GripperPair(ABC):
    """A stroke of both grippers: sent, once more at half its time, done when both confirm it, or failed.

    A stroke that is not confirmed within the site's `timeout` is a reason in the status; it stays
    until the next command. Commands say open or closed, never a change, so that sending one again
    does no harm.
    """

    def __init__(self, site: GripperSite) -> None:
        """Nothing is sent before a command."""
        self._site = site
        self._clock = SteadyClock()
        self._number = self._finished = 0
        self._wanted = (False, False)
        self._reason = ""
        self._sends = 0
        self._began = 0.0
        self._confirmed: float | None = None

    @property
    def status(self) -> GripperReport:
        """What is known as of the last poll."""
        closed = (self._closed(0), self._closed(1))
        holding = (self._holding(0), self._holding(1))
        return GripperReport(self._finished, self._opening(), closed, holding, self._reason)

    def command(self, number: int, closed: tuple[bool, bool]) -> None:
        """Close or open, right and left, with the next poll.

        A command whose number is not above the last one's is no new one; a new one replaces the
        one under way.
        """
        if number <= self._number:
            return
        self._number, self._wanted = number, closed
        self._reason, self._sends, self._confirmed = "", 0, None

    def poll(self, now: float) -> None:
        """Read what came, decide, and write; never waits.

        Args:
            now: of any clock, s.
        """
        now = self._clock.at(now)
        try:
            self._listen(now)
            if self._number > self._finished and not self._reason:
                self._stroke(now)
        except HardwareError as error:
            self._reason = self._reason or f"grippers: {error}"

    def _stroke(self, now: float) -> None:
        if self._sends == 0:
            self._began = now
        elapsed = now - self._began
        if self._sends == 0 or (self._sends == 1 and elapsed > 0.5 * self._site.timeout):
            self._sends += 1
            for index in range(2):
                self._send(index, self._wanted[index])
        lacking = [text for index in range(2) if (text := self._lacks(index, self._wanted[index]))]
        if lacking:
            self._confirmed = None
            if elapsed > self._site.timeout:
                self._reason = f"after {self._site.timeout:g} s {'; '.join(lacking)}"
            return
        if self._confirmed is None:
            self._confirmed = now
        if elapsed >= self._site.stroke_time and now - self._confirmed >= _CONFIRM:
            self._finished = self._number

    @abstractmethod
    def _listen(self, now: float) -> None:
        """Take what came, and ask for what is to be known."""

    @abstractmethod
    def _send(self, index: int, closed: bool) -> None:
        """Command one gripper."""

    @abstractmethod
    def _lacks(self, index: int, closed: bool) -> str:
        """What is missing for one gripper to have done as commanded; empty if nothing."""

    @abstractmethod
    def _closed(self, index: int) -> bool:
        """Whether one gripper is closed."""

    @abstractmethod
    def _holding(self, index: int) -> bool | None:
        """Whether one gripper holds cloth; None if nothing can tell."""

    def _opening(self) -> tuple[float, float] | None:
        return None
