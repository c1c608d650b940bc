"""Pendant and operating state of the virtual controller: key, remote, emergency stop, hold, alarm,
servos.
"""

from collections.abc import Callable
from enum import StrEnum

from unwrinkle.hardware.motoros.messages import Subcode
from unwrinkle.models.errors import InputError


class PendantMode(StrEnum):
    """Position of the pendant's key."""

    TEACH = "teach"
    PLAY = "play"


class Pendant:
    """The switches that an operator sets, and the states of servos and trajectory mode that depend
    on them.

    Attributes:
        mode: position of the key.
        remote, e_stop, hold: on or off.
        alarm: code; 0 for none.
        servo, trajectory_mode: on or off.
    """

    def __init__(self, stop: Callable[[], None], *, keeps_queue: bool = False) -> None:
        """Start in play mode with remote on and servos off.

        Args:
            stop: empties all queues; the axes brake.
            keeps_queue: whether hold, the key and the servo switch leave the queues unchanged.
        """
        self._stop = stop
        self._keeps_queue = keeps_queue
        self._lasting = False
        self.mode = PendantMode.PLAY
        self.remote = True
        self.e_stop = False
        self.hold = False
        self.servo = False
        self.trajectory_mode = False
        self.alarm = 0

    @property
    def not_ready(self) -> int:
        """Reason why no trajectory can run now: the first `Subcode` that the firmware checks; 0 if
        one can.
        """
        for wrong, code in (
            (self.alarm != 0, Subcode.NOT_READY_ALARM),
            (self.e_stop, Subcode.NOT_READY_E_STOP),
            (self.mode != PendantMode.PLAY, Subcode.NOT_READY_NOT_PLAY),
            (not self.remote, Subcode.NOT_READY_NOT_REMOTE),
            (not self.servo, Subcode.NOT_READY_SERVO_OFF),
            (self.hold, Subcode.NOT_READY_HOLD),
            (not self.trajectory_mode, Subcode.NOT_READY_NOT_STARTED),
        ):
            if wrong:
                return code
        return 0

    @property
    def not_startable(self) -> bool:
        """Whether trajectory mode cannot be started."""
        in_play = self.mode == PendantMode.PLAY and self.remote
        return self.alarm != 0 or self.e_stop or not in_play or self.hold

    def reset_alarm(self) -> bool:
        """Clear an alarm unless it is lasting; return whether there is none now."""
        if not self._lasting:
            self.alarm = 0
        return self.alarm == 0

    def press_e_stop(self) -> None:
        """Switch the servos off; the axes brake and the queues are emptied."""
        self.e_stop = True
        self._drop()

    def release_e_stop(self) -> None:
        """Release the emergency stop; servos and trajectory mode stay off."""
        self.e_stop = False

    def set_mode(self, mode: str) -> None:
        """Turn the key to "teach" or "play"; teach ends trajectory mode and switches the servos
        off.

        Raises:
            InputError: another mode.
        """
        try:
            self.mode = PendantMode(mode)
        except ValueError:
            raise InputError(f"virtual controller: mode '{mode}'; teach or play") from None
        if self.mode == PendantMode.TEACH:
            self._drop()

    def set_remote(self, remote: bool) -> None:
        """Turn remote on or off; off ends trajectory mode and switches the servos off."""
        self.remote = remote
        if not remote:
            self._drop()

    def switch_servo_off(self) -> None:
        """Switch the servos off, which ends trajectory mode."""
        self._drop()

    def raise_alarm(self, code: int = 4000, *, lasting: bool = False) -> None:
        """Show an alarm and switch the servos off; messages cannot reset a `lasting` one."""
        self.alarm, self._lasting = code, lasting
        self._drop()

    def clear_alarm(self) -> None:
        """Clear any alarm."""
        self.alarm, self._lasting = 0, False

    def press_hold(self) -> None:
        """End the controller's job, brake and empty the queues (not with the firmware of 2013); the
        servos stay on.
        """
        self.hold = True
        if not self._keeps_queue:
            self.trajectory_mode = False
            self._stop()

    def release_hold(self) -> None:
        """Release hold."""
        self.hold = False

    def _drop(self) -> None:
        self.servo = self.trajectory_mode = False
        if not self._keeps_queue:
            self._stop()
