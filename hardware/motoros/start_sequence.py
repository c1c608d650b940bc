"""The requests that bring the controller from rest to trajectory mode: servos, job, synchrony of
the groups.
"""

from unwrinkle.hardware.motoros.messages import Command, MotionReply, Result, Subcode, describe
from unwrinkle.hardware.motoros.motion_channel import Asked, MotionChannel
from unwrinkle.models.site import ControllerSite

#: Between two checks of readiness, s.
_RETRY_S = 0.05


class StartSequence:
    """Starts trajectory mode and checks that the controller is ready for the first point.

    Attributes:
        done: points may be sent.
        problem: why trajectory mode cannot be used; empty while the sequence goes on.
    """

    def __init__(
        self, site: ControllerSite, channel: MotionChannel, in_mode: bool, earliest: float
    ) -> None:
        """Prepare.

        Args:
            site: of the controller.
            channel: of the motion connection.
            in_mode: trajectory mode is on already.
            earliest: time of the first request, s.
        """
        self._site = site
        self._channel = channel
        self._steps: list[int] = [] if in_mode else [Command.START_TRAJ_MODE]
        self._steps.append(Command.CHECK_MOTION_READY)
        if site.synchro != "off":
            self._steps.append(Command.CHECK_SYNCHRO)
        self._when = earliest
        self._asked: int | None = None  # sequence number of the request under way
        self._begun: float | None = None  # first request of the present step, s
        self.done = False
        self.problem = ""

    def poll(self, now: float) -> None:
        """Send the request that is due."""
        if self.done or self.problem or self._asked is not None or now < self._when:
            return
        if self._begun is None:
            self._begun = now
        self._asked = self._channel.control(self._steps[0], now, self._site.start_timeout)

    def answered(self, asked: Asked, reply: MotionReply, now: float) -> None:
        """Process a reply; replies to other requests are ignored."""
        if self._asked is None or asked.sequence != self._asked:
            return
        self._asked = None
        if reply.result == Result.SUCCESS:
            self._steps.pop(0)
            self._begun = None
            self.done = not self._steps
            return
        patient = asked.what != Command.START_TRAJ_MODE and reply.result == Result.FAILURE
        assert self._begun is not None
        if patient and now - self._begun < self._site.start_timeout:
            self._when = now + _RETRY_S
            return
        what = {
            Command.START_TRAJ_MODE: "trajectory mode cannot be started",
            Command.CHECK_MOTION_READY: "the controller does not become ready",
        }.get(Command(asked.what), "the groups do not get into synchrony")
        # The sub-code of CHECK_MOTION_READY states what is missing.
        result = Result.NOT_READY if patient and reply.subcode >= 5000 else reply.result
        self.problem = f"{what}: {describe(result, reply.subcode)}"
        if asked.what == Command.START_TRAJ_MODE and reply.subcode == Subcode.NOT_READY_SERVO_OFF:
            # The firmware reports the first missing condition, not what prevents the servos from
            # being switched on.
            self.problem += "; is hold pressed, or a safety circuit open?"
