"""A virtual robot controller: modes, servos, queues and interpolation of a DX100 with MotoROS.

It knows no sockets and no clock: messages are handed to it, and `advance` moves it on by one
interpolation period. The thirteen axes are turn-table, right arm, left arm; its control groups are
0 the right arm (r1), 1 the left arm (r2), 2 the turn-table (ext_axis).
"""

from collections import deque

import numpy as np
from numpy.typing import ArrayLike, NDArray

from unwrinkle.hardware.wire import (
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
from unwrinkle.models.errors import InputError
from unwrinkle.simulation._controller_group import Axes, ControlGroup
from unwrinkle.simulation._controller_io import InputsAndOutputs
from unwrinkle.simulation._controller_pendant import PLAY, TEACH, Pendant
from unwrinkle.simulation._controller_settings import AcceptedPoint, VirtualControllerSettings

__all__ = [
    "AXES",
    "GROUP_AXES",
    "PLAY",
    "TEACH",
    "AcceptedPoint",
    "VirtualController",
    "VirtualControllerSettings",
]

Array = NDArray[np.float64]

AXES = 13
#: The axes of each control group.
GROUP_AXES = (tuple(range(1, 7)), tuple(range(7, 13)), (0,))


class VirtualController(Pendant):
    """The controller.

    Attributes:
        settings: of it.
        inputs, outputs: digital ones by address, 0 or 1.
        received: the points that were accepted, of each group, oldest first.
        messages: what was handed to it, with its clock.
        trace: clock, positions (13,) and velocities (13,) of each period.
        points: trajectory points accepted so far, by all groups.
        mode, remote, e_stop, hold, alarm, servo, trajectory_mode: see `Pendant`.
    """

    def __init__(
        self,
        settings: VirtualControllerSettings,
        start: ArrayLike,
        limits: tuple[ArrayLike, ArrayLike, ArrayLike],
    ) -> None:
        """Stand at `start` (13,) rad in play mode, remote, servos off.

        Args:
            settings: of it.
            start: where the axes stand.
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
        super().__init__()
        self.settings = settings
        tolerance = settings.start_pulses / settings.pulses_per_radian
        self._groups = []
        for axes in GROUP_AXES:
            i, one = np.array(axes), np.ones(len(axes))
            limit = Axes(
                i,
                lower[i],
                upper[i],
                velocity[i],
                settings.braking * one,
                tolerance * one * (1.0 + 1e-9),
            )
            self._groups.append(ControlGroup(limit, begin[i], settings.period, settings.depth))
        self._io = InputsAndOutputs()
        self.inputs, self.outputs = self._io.inputs, self._io.outputs
        keep = settings.keep
        self.received: list[deque[AcceptedPoint]] = [deque(maxlen=keep) for _ in GROUP_AXES]
        self.messages: deque[tuple[float, Message]] = deque(maxlen=keep)
        self.trace: deque[tuple[float, Array, Array]] = deque(maxlen=keep)
        self.points = 0
        self._accepted = [0] * len(GROUP_AXES)
        self._ticks = 0
        self._starting: tuple[MotionControl, float] | None = None
        self._late: list[Message] = []

    # ------------------------------------------------------------ state

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
    def moving(self) -> bool:
        """Whether an axis moves or an increment waits."""
        return any(group.moving for group in self._groups)

    @property
    def queued(self) -> tuple[int, ...]:
        """Increments that wait in each group."""
        return tuple(group.count for group in self._groups)

    @property
    def underruns(self) -> int:
        """How often a group's queue ran out in motion."""
        return sum(group.underruns for group in self._groups)

    @property
    def starting(self) -> bool:
        """Whether trajectory mode is being started; its reply comes from `late_replies`."""
        return self._starting is not None

    @property
    def status(self) -> RobotStatusBody:
        """What ROBOT_STATUS tells."""
        possible = self.not_startable if self.settings.possible_early else self.not_ready
        return RobotStatusBody(
            drives_powered=int(self.servo),
            e_stopped=int(self.e_stop),
            error_code=self.alarm,
            in_error=int(self.alarm != 0),
            in_motion=int(self.moving),
            mode=1 if self.mode == TEACH else 2,
            motion_possible=int(not possible),
        )

    @staticmethod
    def _gather(parts: list[Array]) -> Array:
        whole = np.empty(AXES)
        for axes, part in zip(GROUP_AXES, parts, strict=True):
            whole[list(axes)] = part
        return whole

    def stop(self) -> None:
        """Empty all queues at once; the axes brake."""
        for group in self._groups:
            group.clear()

    def connection_lost(self) -> None:
        """The motion connection has ended: empty all queues, and forget a start under way."""
        self.stop()
        self._starting = None
        self._late.clear()

    # ------------------------------------------------------------ time

    def advance(self) -> None:
        """Move on by one interpolation period."""
        self._ticks += 1
        self._start_up()
        for group in self._groups:
            group.advance()
        self.trace.append((self.time, self.positions, self.velocities))

    def late_replies(self) -> list[Message]:
        """Replies that took the controller time; each is given once."""
        late, self._late = self._late, []
        return late

    def feedback(
        self, positions: ArrayLike | None = None, velocities: ArrayLike | None = None
    ) -> list[Message]:
        """One set of feedback: one message per group, one for all unless it knows groups alone, the status.

        Args:
            positions, velocities: (13,) measured, rad and rad/s; where left out, those commanded.
        """
        q = self.positions if positions is None else np.asarray(positions, dtype=float)
        v = self.velocities if velocities is None else np.asarray(velocities, dtype=float)
        stamp = self.time if self.settings.stamps else None
        bodies = tuple(
            FeedbackBody(number, stamp, tuple(q[list(axes)]), tuple(v[list(axes)]))
            for number, axes in enumerate(GROUP_AXES)
        )
        messages = [body.to_message() for body in bodies]
        if self.settings.accepts != "groups":
            messages.append(MultiFeedback(bodies).to_message())
        return [*messages, self.status.to_message()]

    # ------------------------------------------------------------ messages

    def handle_io(self, message: Message) -> list[Message]:
        """Answer a message on the connection for inputs and outputs."""
        self.messages.append((self.time, message))
        return self._io.answer(message)

    def handle_motion(self, message: Message) -> list[Message]:
        """Answer a message on the motion connection; START_TRAJ_MODE is answered by `late_replies`."""
        self.messages.append((self.time, message))
        kind = message.type
        if message.comm != CommType.REQUEST:
            return [_reply(-1, -1, kind, Result.INVALID, Subcode.INVALID_HEADER)]
        try:
            if kind == MessageType.PING:
                return [ping(CommType.REPLY, ReplyCode.SUCCESS)]
            if kind == MessageType.MOTION_CTRL:
                return self._command(MotionControl.of(message))
            if kind == MessageType.JOINT_TRAJ_PT_FULL and self.settings.accepts != "ex":
                point = TrajectoryPoint.of(message)
                result = self._take((point.point,), point.sequence)
                return [_reply(point.group, point.sequence, kind, *result)]
            if kind == MessageType.JOINT_TRAJ_PT_FULL_EX and self.settings.accepts != "groups":
                points = MultiPoint.of(message)
                result = self._take_all(points)
                return [_reply(-1, points.sequence, kind, *result)]
        except WireError as error:
            subcode = Subcode.INVALID_GROUP if error.name == "groups" else Subcode.INVALID_DATA
            return [_reply(-1, -1, kind, Result.INVALID, subcode)]
        return [_reply(-1, -1, kind, Result.INVALID, Subcode.INVALID_TYPE)]

    def _take_all(self, points: MultiPoint) -> tuple[int, int]:
        """Take a point of all groups; every group has to be there."""
        if sorted(point.group for point in points.groups) != list(range(len(self._groups))):
            return Result.INVALID, Subcode.INVALID_GROUP
        return self._take(points.groups, points.sequence)

    def _take(self, points: tuple[GroupPoint, ...], sequence: int) -> tuple[int, int]:
        """Take points of one sequence number, all or none; the result and its subcode."""
        if any(not 0 <= point.group < len(self._groups) for point in points):
            return Result.INVALID, Subcode.INVALID_GROUP
        if subcode := self.not_ready:
            return Result.NOT_READY, subcode
        for point in points:
            group = self._groups[point.group]
            if group.busy or (sequence == 0 and group.moving):
                return Result.BUSY, 0
        for point in points:
            if subcode := self._groups[point.group].problem(point, sequence):
                return Result.INVALID, subcode
        for point in points:
            self._groups[point.group].add(point, sequence)
            self._remember(point, sequence)
        return Result.SUCCESS, 0

    def _remember(self, point: GroupPoint, sequence: int) -> None:
        assert point.time is not None and point.positions is not None
        assert point.velocities is not None
        size = len(GROUP_AXES[point.group])
        self._accepted[point.group] += 1
        self.points = min(self._accepted)
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
        """Answer a command about motion."""
        if asked.command == Command.START_TRAJ_MODE:
            return self._start(asked)
        result, subcode = Result.SUCCESS, 0
        if not -1 <= asked.group < len(self._groups):
            result, subcode = Result.INVALID, Subcode.INVALID_GROUP
        elif asked.command == Command.CHECK_MOTION_READY:
            subcode = self.not_ready
            result = Result.FAILURE if subcode else Result.SUCCESS
        elif asked.command == Command.CHECK_QUEUE_COUNT:
            subcode = max(self.queued) if asked.group < 0 else self.queued[asked.group]
        elif asked.command == Command.CHECK_SYNCHRO and self.settings.synchro:
            # ASSUMED: drained are groups whose points are wholly in their queues.
            subcode = sum(group.busy for group in self._groups)
            result = Result.FAILURE if subcode else Result.SUCCESS
        elif asked.command == Command.STOP_MOTION:
            self.stop()
        elif asked.command == Command.START_SERVOS:
            subcode = self.not_startable
            result = Result.NOT_READY if subcode else Result.SUCCESS
            self.servo = self.servo or not subcode
        elif asked.command == Command.STOP_SERVOS:
            self.switch_servo_off()
        elif asked.command == Command.RESET_ALARM:
            result = Result.SUCCESS if self.reset_alarm() else Result.FAILURE
        elif asked.command == Command.STOP_TRAJ_MODE:
            if any(self.queued):
                result = Result.FAILURE
            else:
                self.trajectory_mode = False
                self.stop()
        elif asked.command != Command.DISCONNECT:
            result, subcode = Result.INVALID, Subcode.INVALID_COMMAND
        return [_reply(asked.group, asked.sequence, asked.command, result, subcode)]

    def _start(self, asked: MotionControl) -> list[Message]:
        """Begin to start trajectory mode, unless it is on or cannot be."""
        answer = asked.group, asked.sequence, asked.command
        if not self.not_ready:
            return [_reply(*answer, Result.SUCCESS)]
        self.reset_alarm()
        if subcode := self.not_startable:
            return [_reply(*answer, Result.NOT_READY, subcode)]
        if self._starting is None:
            self.stop()
            servos = 0.0 if self.servo else self.settings.servo_time
            self._starting = asked, self.time + servos + self.settings.job_time
        return []

    def _start_up(self) -> None:
        """Go on with the start of trajectory mode."""
        if self._starting is None:
            return
        asked, end = self._starting
        answer = asked.group, asked.sequence, asked.command
        if subcode := self.not_startable:
            self._late.append(_reply(*answer, Result.NOT_READY, subcode))
            self._starting = None
            return
        if not self.servo and self.time >= end - self.settings.job_time:
            self.servo = True
        if self.time >= end:
            self.trajectory_mode = True
            self._late.append(_reply(*answer, Result.SUCCESS))
            self._starting = None


def _reply(group: int, sequence: int, command: int, result: int, subcode: int = 0) -> Message:
    taken = result in (Result.SUCCESS, Result.BUSY)
    code = ReplyCode.SUCCESS if taken else ReplyCode.FAILURE
    return MotionReply(group, sequence, command, result, subcode).to_message(reply=code)
