"""A virtual robot controller: modes, servos, queues and interpolation of a DX100 with MotoROS
1.9.12.

It uses neither sockets nor a clock: messages are passed to its methods, and `advance` simulates one
interpolation period. The thirteen axes are turn-table, right arm, left arm; its control groups are
0 the right arm (r1), 1 the left arm (r2), 2 the turn-table (ext_axis).

It accepts what the firmware accepts (docs/howto/deployment.md names the source, and what is
unknown).
Violations of the rules for clients are recorded in `audit`, and refused only where the firmware
refuses them. Above all: **its queues outlive the motion connection**, and are run again when the
next one is accepted.
"""

from collections import deque
from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from unwrinkle.hardware.motoros.messages import (
    Command,
    CommType,
    FeedbackBody,
    GroupPoint,
    Message,
    MessageType,
    MotionControl,
    MotionReply,
    MultiFeedback,
    MultiPoint,
    ReplyCode,
    Result,
    RobotStatusBody,
    Subcode,
    TrajectoryPoint,
    WireError,
    ping,
)
from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import InputError
from unwrinkle.models.site import GROUPS
from unwrinkle.planning.trajectory import AXES
from unwrinkle.simulation.controllers.audit import Audit, AuditLimits
from unwrinkle.simulation.controllers.group import LONGEST_TIME_S, Axes, ControlGroup
from unwrinkle.simulation.controllers.io import InputsAndOutputs
from unwrinkle.simulation.controllers.pendant import Pendant, PendantMode
from unwrinkle.simulation.controllers.reads import Unread
from unwrinkle.simulation.controllers.settings import (
    AcceptedPoint,
    Firmware,
    VirtualControllerSettings,
)

__all__ = [
    "AXES",
    "GROUP_AXES",
    "AcceptedPoint",
    "VirtualController",
    "VirtualControllerSettings",
]


#: Indices of the axes of each control group.
GROUP_AXES = (tuple(range(1, 7)), tuple(range(7, 13)), (0,))


class VirtualController:
    """The controller.

    Attributes:
        settings: of the controller.
        pendant: switches, servos and trajectory mode.
        inputs, outputs: digital ones by address, 0 or 1.
        received: accepted points of each group, oldest first.
        messages: received messages, with the controller's clock, s.
        trace: clock, s, commanded positions (13,), rad, and velocities (13,), rad/s, of each
            period.
        points: trajectory points that all groups have accepted so far.
        audit: violations of the rules for clients.
    """

    def __init__(
        self,
        settings: VirtualControllerSettings,
        start: ArrayLike,
        limits: tuple[ArrayLike, ArrayLike, ArrayLike],
    ) -> None:
        """Begin at rest in play mode, with remote on, servos off, and a motion connection.

        Args:
            settings: of the controller.
            start: (13,) positions of the axes, rad.
            limits: lower and upper positions, rad, and velocities, rad/s, each (13,).

        Raises:
            InputError: not thirteen finite numbers each.
        """
        begin, lower, upper, velocity = (
            np.array(values, dtype=float) for values in (start, *limits)
        )
        for name, array in (
            ("start", begin),
            ("lower", lower),
            ("upper", upper),
            ("velocity", velocity),
        ):
            if array.shape != (AXES,) or not np.isfinite(array).all():
                raise InputError(f"virtual controller: {name} needs {AXES} finite numbers")
        self.pendant = Pendant(self.stop, keeps_queue=settings.firmware == Firmware.OF_2013)
        self.settings = settings
        pulses = np.array(settings.pulses_per_radian)
        self._tolerance = settings.start_pulses / np.concatenate([pulses, pulses[1:]])
        period = round(1e3 * settings.period)
        self._groups: list[ControlGroup] = []
        self._limits: list[AuditLimits] = []
        for name, axes in zip(GROUPS, GROUP_AXES, strict=True):
            i = np.array(axes)
            limit = Axes(
                i,
                settings.speed_cap * velocity[i] * (1.0 + 1e-9),
                np.full(len(axes), settings.braking),
                self._tolerance[i] * (1.0 + 1e-9),
                name in settings.moved,
            )
            self._groups.append(ControlGroup(limit, begin[i], period, settings.depth))
            self._limits.append(AuditLimits(lower[i], upper[i], velocity[i]))
        self._io = InputsAndOutputs()
        self.inputs, self.outputs = self._io.inputs, self._io.outputs
        keep = settings.keep
        self.received: list[deque[AcceptedPoint]] = [deque(maxlen=keep) for _ in GROUP_AXES]
        self.messages: deque[tuple[float, Message]] = deque(maxlen=keep)
        self.trace: deque[tuple[float, Array, Array]] = deque(maxlen=keep)
        self.points = 0
        self.audit = Audit()
        self._accepted = [0] * len(GROUP_AXES)
        self._ticks = 0
        self._starting: tuple[MotionControl, float] | None = None
        self._late: list[Message] = []
        self._previous: Message | None = None  # last reply, repeated for unknown commands
        self._parted: float | None = None  # end of the motion connection, s
        rest = np.zeros(AXES)
        self._under_way = deque(
            [(begin, rest)] * (round(settings.delay / settings.period) + 1),
            maxlen=round(settings.delay / settings.period) + 1,
        )

    @property
    def time(self) -> float:
        """The controller's clock, s."""
        return self._ticks * self.settings.period

    @property
    def positions(self) -> Array:
        """Commanded positions now, (13,) rad."""
        return self._gather([group.positions for group in self._groups])

    @property
    def velocities(self) -> Array:
        """Commanded velocities now, (13,) rad/s."""
        return self._gather([group.velocities for group in self._groups])

    @property
    def axis_positions(self) -> Array:
        """Positions of the axes, (13,) rad: those commanded the settings' delay ago."""
        return self._under_way[0][0]

    @property
    def axis_velocities(self) -> Array:
        """Velocities of the axes, (13,) rad/s; see `axis_positions`."""
        return self._under_way[0][1]

    @property
    def moving(self) -> bool:
        """Whether an axis moves, or increments are queued."""
        return any(group.moving for group in self._groups) or not self._arrived

    @property
    def resting(self) -> bool:
        """Whether no axis moves, nor will before the next motion connection is made."""
        left_alone = not self.playing and not self.velocities.any() and self._arrived
        return left_alone or not self.moving

    @property
    def _arrived(self) -> bool:
        """Whether the axes are at the end of the last increment."""
        return np.array_equal(self._under_way[0][0], self._under_way[-1][0])

    @property
    def queued(self) -> tuple[int, ...]:
        """Queued increments of each group."""
        return tuple(group.count for group in self._groups)

    @property
    def queued_time(self) -> tuple[float, ...]:
        """Duration of the queued motion of each group, s."""
        return tuple(group.ahead for group in self._groups)

    @property
    def underruns(self) -> int:
        """Number of times that a group's queue ran out during motion."""
        return sum(group.underruns for group in self._groups)

    @property
    def starting(self) -> bool:
        """Whether trajectory mode is being started; the reply follows in `late_replies`."""
        return self._starting is not None

    @property
    def playing(self) -> bool:
        """Whether queued increments are run."""
        return self._parted is None or self.time < self._parted + self.settings.leaving - 1e-9

    @property
    def parting(self) -> bool:
        """Whether the motion connection has ended and its tasks still run."""
        return self._parted is not None and self.playing

    @property
    def status(self) -> RobotStatusBody:
        """Content of ROBOT_STATUS, with the axes measured at `axis_positions`."""
        return self._status(self.axis_positions)

    def _status(self, measured: Array) -> RobotStatusBody:
        off = np.abs(measured - self.positions) > self._tolerance
        return RobotStatusBody(
            drives_powered=int(self.pendant.servo),
            e_stopped=int(self.pendant.e_stop),
            error_code=self.pendant.alarm,
            in_error=int(self.pendant.alarm != 0),
            in_motion=int(any(self.queued) or bool(off.any())),
            mode=1 if self.pendant.mode == PendantMode.TEACH else 2,
            motion_possible=int(not self.pendant.not_ready),
        )

    @staticmethod
    def _gather(parts: list[Array]) -> Array:
        whole = np.empty(AXES)
        for axes, part in zip(GROUP_AXES, parts, strict=True):
            whole[list(axes)] = part
        return whole

    def stop(self) -> None:
        """Empty all queues; the axes brake."""
        for group in self._groups:
            group.clear()

    def connection_made(self) -> None:
        """Accept a motion connection: queued increments are run from now on."""
        self._parted = None
        for group in self._groups:
            group.forget()

    def connection_lost(self) -> None:
        """End the motion connection: its tasks end shortly after; the queues keep their content."""
        if self._parted is None:
            self._parted = self.time
        self._starting = None
        self._late.clear()

    def advance(self) -> None:
        """Simulate one interpolation period."""
        self._ticks += 1
        self._start_up()
        playing = self.playing and not self.pendant.not_ready
        for group in self._groups:
            if not self.playing:
                group.forget()
            if playing:
                group.work()
            group.advance(playing)
        self._under_way.append((self.positions, self.velocities))
        self.trace.append((self.time, *self._under_way[-1]))

    def late_replies(self) -> list[Message]:
        """Return the replies of requests that took time; each is returned once."""
        late, self._late = self._late, []
        return late

    def feedback(
        self, positions: ArrayLike | None = None, velocities: ArrayLike | None = None
    ) -> list[Message]:
        """Return a set of feedback: a message per group, one for all groups unless it accepts
        groups only, and the status.

        Args:
            positions, velocities: (13,) measured, rad and rad/s; None is `axis_positions`,
                `axis_velocities`.
        """
        q = self.axis_positions if positions is None else np.asarray(positions, dtype=float)
        v = self.axis_velocities if velocities is None else np.asarray(velocities, dtype=float)
        stamp = self.time if self.settings.stamps else None
        bodies = tuple(
            FeedbackBody(number, stamp, tuple(q[list(axes)]), tuple(v[list(axes)]))
            for number, axes in enumerate(GROUP_AXES)
        )
        messages = [body.to_message() for body in bodies]
        if self.settings.accepts != "groups":
            messages.append(MultiFeedback(bodies).to_message())
        return [*messages, self._status(q).to_message()]

    def handle_io(self, message: Message | Unread) -> list[Message]:
        """Return the replies to a message on the I/O connection."""
        if isinstance(message, Unread):
            return [self._io.refusal(message.subcode)]
        self.messages.append((self.time, message))
        return self._io.answer(message)

    def handle_motion(self, message: Message | Unread) -> list[Message]:
        """Return the replies to a message on the motion connection.

        The reply to START_TRAJ_MODE may follow in `late_replies`. DISCONNECT with empty queues has
        no reply, except with the firmware of 2013, and the connection ends.
        """
        if isinstance(message, Unread):
            return self._said(_unread(message, self.settings.firmware))
        self.messages.append((self.time, message))
        kind = message.type
        try:
            if kind == MessageType.PING:
                return self._said(ping(CommType.REPLY, ReplyCode.SUCCESS))
            if kind == MessageType.MOTION_CTRL:
                return self._command(MotionControl.of(message))
            if kind == MessageType.JOINT_TRAJ_PT_FULL and self.settings.accepts != "ex":
                point = TrajectoryPoint.of(_known_fields(message, (8,)))
                group, *result = self._take((point.point,), point.sequence)
                return self._said(_reply(group, point.sequence, kind, *result))
            if kind == MessageType.JOINT_TRAJ_PT_FULL_EX and self.settings.accepts != "groups":
                points = MultiPoint.of(_known_fields(message, range(12, len(message.body), 132)))
                group, *result = self._take(points.groups, points.sequence, several=True)
                return self._said(_reply(group, points.sequence, kind, *result))
        except WireError:  # invalid: the last reply is sent again
            return [] if self._previous is None else [self._previous]
        return self._said(_reply(-1, -1, kind, Result.INVALID, Subcode.INVALID_TYPE))

    def _said(self, reply: Message) -> list[Message]:
        self._previous = reply
        return [reply]

    def _take(
        self, points: tuple[GroupPoint, ...], sequence: int, several: bool = False
    ) -> tuple[int, int, int]:
        """Process points of one sequence number, in order; return group, result and sub-code of the
        reply.
        """
        if subcode := self.pendant.not_ready:
            return points[-1].group, Result.NOT_READY, subcode
        for point in points:
            if not 0 <= point.group < len(self._groups):
                return point.group, Result.INVALID, Subcode.INVALID_GROUP
            if several and self._groups[point.group].busy:
                return point.group, Result.BUSY, 0
            if point.time is None or point.positions is None or point.velocities is None:
                return point.group, Result.INVALID, Subcode.INVALID_INSUFFICIENT
            if not several and point.time >= LONGEST_TIME_S:
                return point.group, Result.INVALID, Subcode.INVALID_TIME
        for point in points:
            group = self._groups[point.group]
            if sequence < 0:
                return point.group, Result.INVALID, Subcode.INVALID_SEQUENCE
            if sequence > 0 and group.busy:
                return point.group, Result.BUSY, 0
            if subcode := group.first(point) if sequence == 0 else group.add(point):
                return point.group, Result.INVALID, subcode
            self._remember(point, sequence)
        return points[-1].group, Result.SUCCESS, 0

    def _remember(self, point: GroupPoint, sequence: int) -> None:
        assert point.time is not None and point.positions is not None
        assert point.velocities is not None
        size = len(GROUP_AXES[point.group])
        self._accepted[point.group] += 1
        self.points = min(self._accepted)
        self.audit.point(point, sequence, self._limits[point.group])
        self.received[point.group].append(
            AcceptedPoint(
                self.time,
                sequence,
                point.time,
                point.positions[:size],
                point.velocities[:size],
            )
        )

    def _command(self, asked: MotionControl) -> list[Message]:
        """Return the replies to a command."""
        if asked.command == Command.START_TRAJ_MODE:
            return self._start(asked)
        result, subcode = Result.SUCCESS, 0
        if asked.command == Command.CHECK_MOTION_READY:
            subcode = self.pendant.not_ready
            result = Result.FAILURE if subcode else Result.SUCCESS
            if self.settings.firmware == Firmware.OF_2013:
                subcode = 0  # which sends no reason
        elif asked.command == Command.CHECK_QUEUE_COUNT:
            known = 0 <= asked.group < len(self._groups)
            subcode = self.queued[asked.group] if known else -1
            result = Result.SUCCESS if known else Result.FAILURE
        elif asked.command == Command.CHECK_SYNCHRO and self.settings.synchro:
            # ASSUMED: synchronous are groups whose points are completely in their queues.
            subcode = sum(group.busy for group in self._groups)
            result = Result.FAILURE if subcode else Result.SUCCESS
        elif asked.command == Command.STOP_MOTION:
            self.stop()
            self.audit.stopped()
        elif asked.command == Command.START_SERVOS:
            result = Result.FAILURE if self.pendant.not_startable else Result.SUCCESS
            self.pendant.servo = self.pendant.servo or not self.pendant.not_startable
        elif asked.command == Command.STOP_SERVOS:
            self.pendant.switch_servo_off()
        elif asked.command == Command.RESET_ALARM:
            result = Result.SUCCESS if self.pendant.reset_alarm() else Result.FAILURE
        elif asked.command in (Command.STOP_TRAJ_MODE, Command.DISCONNECT):
            if any(self.queued):
                result = Result.FAILURE
            else:
                self.pendant.trajectory_mode = False
                self.stop()
                if (
                    asked.command == Command.DISCONNECT
                    and self.settings.firmware != Firmware.OF_2013
                ):
                    return []
        else:  # unknown: the last reply is sent again
            return [] if self._previous is None else [self._previous]
        return self._said(_reply(asked.group, asked.sequence, asked.command, result, subcode))

    def _start(self, asked: MotionControl) -> list[Message]:
        """Begin to start trajectory mode, unless it is on or cannot be started."""
        answer = asked.group, asked.sequence, asked.command
        if not self.pendant.not_ready:
            return self._said(_reply(*answer, Result.SUCCESS))
        if not (
            self.pendant.e_stop or self.pendant.hold or not self.pendant.remote
        ):  # conditions that an operator has to end
            self.pendant.reset_alarm()
        if self.pendant.not_startable:
            return self._said(_reply(*answer, Result.NOT_READY, self.pendant.not_ready))
        if self._starting is None:
            self.stop()
            for group in self._groups:
                group.rebase()
            servos = 0.0 if self.pendant.servo else self.settings.servo_time
            self._starting = asked, self.time + servos + self.settings.job_time
        return []

    def _start_up(self) -> None:
        """Continue the start of trajectory mode."""
        if self._starting is None:
            return
        asked, end = self._starting
        answer = asked.group, asked.sequence, asked.command
        if self.pendant.not_startable:
            self._late += self._said(_reply(*answer, Result.NOT_READY, self.pendant.not_ready))
            self._starting = None
            return
        if not self.pendant.servo and self.time >= end - self.settings.job_time:
            self.pendant.servo = True
        if self.time >= end:
            self.pendant.trajectory_mode = True
            self._late += self._said(_reply(*answer, Result.SUCCESS))
            self._starting = None


def _known_fields(message: Message, places: Iterable[int]) -> Message:
    """Return the message without undefined bits of valid fields, which the firmware ignores."""
    body = bytearray(message.body)
    for place in places:
        body[place : place + 4] = (body[place] & 15).to_bytes(4, "little")
    return Message(message.type, message.comm, message.reply, bytes(body))


def _reply(group: int, sequence: int, command: int, result: int, subcode: int = 0) -> Message:
    """Return a motion reply; its header states success for every result."""
    answer = MotionReply(group, sequence, command, result, subcode)
    return answer.to_message(reply=ReplyCode.SUCCESS)


def _unread(unread: Unread, firmware: str) -> Message:
    """Return the reply to bytes that are not a complete message; it repeats the bytes where its
    numbers would be.

    Its group is 0, except with the firmware of 2013.
    """
    head = unread.head
    known = {
        MessageType.MOTION_CTRL: (0, 4, 8),
        MessageType.JOINT_TRAJ_PT_FULL: (0, 4, None),
        MessageType.JOINT_TRAJ_PT_FULL_EX: (None, 4, None),
    }
    places = known.get(MessageType(head.type)) if head.type in known else None
    if places is None:
        return _reply(-1, -1, head.type, Result.INVALID, unread.subcode)
    body = head.body.ljust(12, b"\0")
    group, sequence, command = (
        int.from_bytes(body[place : place + 4], "little", signed=True)
        if place is not None
        else value
        for place, value in zip(places, (0, 0, head.type), strict=True)
    )
    group = group if firmware == Firmware.OF_2013 else 0
    return _reply(group, sequence, command, Result.INVALID, unread.subcode)
