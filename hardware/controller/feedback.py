"""The state connection: complete sets of joint feedback from the groups' messages, and the robot's
status.
"""

import numpy as np

from unwrinkle.hardware.controller_state import JointFeedback, RobotStatus
from unwrinkle.hardware.motoros.messages import (
    FeedbackBody,
    Framer,
    Message,
    MessageType,
    MultiFeedback,
    RobotStatusBody,
    WireError,
)
from unwrinkle.hardware.motoros.tcp_link import TcpLink
from unwrinkle.hardware.streaming.stream import GROUP_AXES
from unwrinkle.models.errors import ConnectionLostError, ProtocolError
from unwrinkle.models.site import ControllerSite
from unwrinkle.planning.trajectory import AXES


class FeedbackReader:
    """Reads joint feedback and status, which the controller sends without a request.

    Attributes:
        feedback: newest complete set; None before the first.
        status: newest status; None before the first.
        count: complete sets so far.
        statuses: statuses so far.
    """

    def __init__(self, link: TcpLink, site: ControllerSite) -> None:
        """Read from a link, with the groups and profile of a site."""
        self._link = link
        self._site = site
        self._framer = Framer()
        self._parts: dict[int, FeedbackBody] = {}
        self.feedback: JointFeedback | None = None
        self.status: RobotStatus | None = None
        self.count = 0
        self.statuses = 0

    @property
    def missing(self) -> str:
        """Groups without feedback since the last complete set, for the user."""
        absent = [
            f"{k} ({name})" for k, name in enumerate(self._site.groups) if k not in self._parts
        ]
        return ", ".join(absent)

    def poll(self, now: float) -> list[JointFeedback]:
        """Return the complete sets that have come, oldest first, without those not newer than the
        set before.

        Raises:
            ConnectionLostError: the connection has ended.
            ProtocolError: invalid bytes, or feedback that does not fit the site's groups.
        """
        sets: list[JointFeedback] = []
        data = self._link.receive()
        if data:
            try:
                messages = self._framer.feed(data)
            except WireError as error:
                raise ProtocolError(
                    f"the controller sends garbage on the state connection ({error.name}: {error})"
                ) from None
            for message in messages:
                found = self._read(message, now)
                if found is not None:
                    sets.append(found)
        if self._link.closed:
            raise ConnectionLostError(f"the state connection has ended: {self._link.closed}")
        return sets

    def _read(self, message: Message, now: float) -> JointFeedback | None:
        try:
            if message.type == MessageType.ROBOT_STATUS:
                body = RobotStatusBody.of(message)
                self.status = RobotStatus(
                    body.drives_powered,
                    body.e_stopped,
                    body.error_code,
                    body.in_error,
                    body.in_motion,
                    body.mode,
                    body.motion_possible,
                )
                self.statuses += 1
            elif message.type == MessageType.JOINT_FEEDBACK_EX:
                return self._whole(MultiFeedback.of(message), now)
            elif message.type == MessageType.JOINT_FEEDBACK:
                return self._part(FeedbackBody.of(message), now)
        except WireError as error:
            raise ProtocolError(f"feedback that cannot be read: {error}") from None
        return None

    def _whole(self, bodies: MultiFeedback, now: float) -> JointFeedback | None:
        """Return the set of a message with all groups, which the profile `ex` uses."""
        names = self._site.groups
        found = sorted(body.group for body in bodies.groups)
        if found != list(range(len(names))):
            raise ProtocolError(
                f"the controller gives feedback of the groups {found}, the site has {len(names)}: "
                f"{', '.join(names)}; compare the site's groups with the controller's"
            )
        if self._site.profile != "ex":
            return None
        parts = {body.group: body for body in bodies.groups}
        return self._set(parts, now)

    def _part(self, body: FeedbackBody, now: float) -> JointFeedback | None:
        """Add the feedback of one group; return the set once all groups have come with the same
        time.
        """
        if not 0 <= body.group < len(self._site.groups):
            raise ProtocolError(
                f"the controller gives feedback of group {body.group}, the site has "
                f"{len(self._site.groups)} groups; compare them"
            )
        if self._site.profile == "ex":
            return None
        if body.group in self._parts:
            self._parts = {}
        self._parts = {k: part for k, part in self._parts.items() if part.time == body.time}
        self._parts[body.group] = body
        if len(self._parts) < len(self._site.groups):
            return None
        parts, self._parts = self._parts, {}
        return self._set(parts, now)

    def _set(self, parts: dict[int, FeedbackBody], now: float) -> JointFeedback | None:
        positions, reported = np.empty(AXES), np.zeros(AXES)
        stamp = parts[0].time
        last = self.feedback
        newest = None if last is None else last.stamp
        # Duplicate, overtaken, or with a time that is not a number.
        if newest is not None and stamp is not None and not stamp > newest:
            return None
        for k, name in enumerate(self._site.groups):
            axes = GROUP_AXES[name]
            size = axes.stop - axes.start
            body = parts[k]
            if body.positions is None:
                raise ProtocolError(f"feedback of group {k} ({name}) has no positions")
            if any(body.positions[size:]):
                raise ProtocolError(
                    f"feedback of group {k} ({name}) has more than {size} axes; compare the site's "
                    "groups with the controller's"
                )
            positions[axes] = body.positions[:size]
            if body.velocities is not None:
                reported[axes] = body.velocities[:size]
        velocities = reported if self._site.velocities == "reported" else np.zeros(AXES)
        if last is not None and self._site.velocities == "differences":
            step = interval(last, now, stamp, self._site.feedback_period)
            velocities = (positions - last.positions) / step
        self.count += 1
        positions.setflags(write=False)
        velocities.setflags(write=False)
        self.feedback = JointFeedback(positions, velocities, now, stamp, self.count)
        return self.feedback


def interval(last: JointFeedback, now: float, stamp: float | None, period: float) -> float:
    """Return the time between a set of feedback and the next, s, on the controller's clock where it
    sends one.

    Sets that waited for a late reader are received together, so they count as at least half a
    period apart.
    """
    if stamp is not None and last.stamp is not None:
        return max(stamp - last.stamp, 1e-3)
    return max(now - last.received, 0.5 * period)
