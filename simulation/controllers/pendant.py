"""The virtual controller's pendant: key, remote, emergency stop, hold, alarm, servos."""

from unwrinkle.hardware.motoros.wire import Subcode
from unwrinkle.models.errors import InputError

TEACH, PLAY = "teach", "play"


class Pendant:
    """What the operator sets, and what follows from it.

    Attributes:
        mode: "teach" or "play".
        remote, e_stop, hold: on or off.
        alarm: a code; 0 none.
        servo, trajectory_mode: on or off.
    """

    def __init__(self, keeps_queue: bool = False) -> None:
        """In play mode, remote, servos off; `keeps_queue`: hold and the mode key leave the queues as they are."""
        self._keeps_queue = keeps_queue
        self.mode, self.remote = PLAY, True
        self.e_stop = self.hold = self.servo = self.trajectory_mode = False
        self.alarm, self._lasting = 0, False

    @property
    def not_ready(self) -> int:
        """Why no trajectory can run now, a `Subcode`, the first that the firmware looks at; 0 if one can."""
        for wrong, code in (
            (self.alarm != 0, Subcode.NOT_READY_ALARM),
            (self.e_stop, Subcode.NOT_READY_E_STOP),
            (self.mode != PLAY, Subcode.NOT_READY_NOT_PLAY),
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
        """Whether something keeps trajectory mode from being started."""
        wrong = self.alarm != 0 or self.e_stop or self.mode != PLAY or not self.remote
        return wrong or self.hold

    def stop(self) -> None:
        """Let nothing move on."""
        raise NotImplementedError

    def reset_alarm(self) -> bool:
        """Clear an alarm that does not last; whether there is none now."""
        if not self._lasting:
            self.alarm = 0
        return self.alarm == 0

    def press_e_stop(self) -> None:
        """Servos off; the axes brake, whatever was queued is gone."""
        self.e_stop = True
        self._drop()

    def release_e_stop(self) -> None:
        """Only that: servos and trajectory mode stay off."""
        self.e_stop = False

    def set_mode(self, mode: str) -> None:
        """Turn the pendant's key to "teach" or "play"; teach ends trajectory mode and switches the servos off."""
        if mode not in (TEACH, PLAY):
            raise InputError(f"virtual controller: mode '{mode}'; teach or play")
        self.mode = mode
        if mode == TEACH:
            self._drop()

    def set_remote(self, remote: bool) -> None:
        """Turn remote on or off; off ends trajectory mode and switches the servos off."""
        self.remote = remote
        if not remote:
            self._drop()

    def switch_servo_off(self) -> None:
        """As the pendant does."""
        self._drop()

    def raise_alarm(self, code: int = 4000, *, lasting: bool = False) -> None:
        """Servos off, and an alarm; a lasting one is not reset by messages."""
        self.alarm, self._lasting = code, lasting
        self._drop()

    def clear_alarm(self) -> None:
        """As the pendant does."""
        self.alarm, self._lasting = 0, False

    def press_hold(self) -> None:
        """The controller's job ends, the axes brake, whatever was queued is gone; not so in 2013. The servos stay on."""
        self.hold = True
        if not self._keeps_queue:
            self.trajectory_mode = False
            self.stop()

    def release_hold(self) -> None:
        """Trajectories may come again."""
        self.hold = False

    def _drop(self) -> None:
        self.servo = self.trajectory_mode = False
        if not self._keeps_queue:
            self.stop()
