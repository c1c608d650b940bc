"""Interface of the two grippers, and the stroke that all of them share: sent, confirmed within a
deadline, or failed.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Protocol

from unwrinkle.hardware.steady_clock import SteadyClock
from unwrinkle.models.errors import HardwareError
from unwrinkle.models.site import GripperSite

SIDES = ("right", "left")

#: Between two reads of inputs and positions, s.
READ_PERIOD_S = 0.05
#: A stroke is done once its sensors have confirmed it for this long, s: each of them is read again
#: meanwhile.
_CONFIRM_TIME_S = 0.15


@dataclass(frozen=True)
class GripperReport:
    """State of both grippers, right and left.

    Attributes:
        command: number of the last command that both have finished.
        opening: distance between the blades, m; None without a measurement.
        closed: measured; without a sensor, as the controller has set the output.
        holding: whether cloth is between the blades; None without a sensor.
        reason: why a gripper does not answer or move; else empty.
    """

    command: int = 0
    opening: tuple[float, float] | None = None
    closed: tuple[bool, bool] = (False, False)
    holding: tuple[bool | None, bool | None] = (None, None)
    reason: str = ""


class Grippers(Protocol):
    """Both grippers, on any device."""

    @property
    def status(self) -> GripperReport:
        """State as of the last poll."""
        ...

    @property
    def found(self) -> str:
        """What the grippers report, for the user."""
        ...

    @property
    def problem(self) -> str:
        """Why the grippers cannot be commanded yet, for the user; empty if they can."""
        ...

    def command(self, number: int, closed: tuple[bool, bool]) -> None:
        """Close or open, right and left; `status` reports the result."""
        ...

    def poll(self, now: float) -> None:
        """Read, decide and write without waiting; `now` is of any clock, s."""
        ...

    def close(self) -> None:
        """Disconnect; the grippers stay as they are."""
        ...


class GripperPair(ABC):
    """A stroke of both grippers: sent, repeated at half its deadline, done when both confirm it, or
    failed.

    A stroke that is not confirmed within the site's `timeout` sets the reason in the status until
    the next command. Commands name the state, open or closed, so repeating one is harmless.
    """

    def __init__(self, site: GripperSite) -> None:
        """Prepare; nothing is sent before a command."""
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
        """State as of the last poll."""
        closed = (self._closed(0), self._closed(1))
        holding = (self._holding(0), self._holding(1))
        return GripperReport(self._finished, self._opening(), closed, holding, self._reason)

    @property
    def found(self) -> str:
        """What the grippers report, for the user."""
        words = ("closed" if closed else "open" for closed in self.status.closed)
        return ", ".join(f"{side} {word}" for side, word in zip(SIDES, words, strict=True))

    @property
    def problem(self) -> str:
        """Why the grippers cannot be commanded yet, for the user; empty if they can."""
        return ""

    def command(self, number: int, closed: tuple[bool, bool]) -> None:
        """Close or open, right and left, with the next poll; a command under way is replaced.

        Args:
            number: counts up; one that is not above the last command's changes nothing.
            closed: right and left.
        """
        if number <= self._number:
            return
        self._number, self._wanted = number, closed
        self._reason, self._sends, self._confirmed = "", 0, None

    def poll(self, now: float) -> None:
        """Read, decide and write without waiting.

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
        if elapsed >= self._site.stroke_time and now - self._confirmed >= _CONFIRM_TIME_S:
            self._finished = self._number

    @abstractmethod
    def _listen(self, now: float) -> None:
        """Read what came, and request what is due."""

    @abstractmethod
    def _send(self, index: int, closed: bool) -> None:
        """Command one gripper."""

    @abstractmethod
    def _lacks(self, index: int, closed: bool) -> str:
        """Return why one gripper is not in the commanded state; empty if it is."""

    @abstractmethod
    def _closed(self, index: int) -> bool:
        """Return whether one gripper is closed."""

    @abstractmethod
    def _holding(self, index: int) -> bool | None:
        """Return whether one gripper holds cloth; None without a sensor."""

    def _opening(self) -> tuple[float, float] | None:
        return None
