"""Sending of a path's points: one at a time, repeated while the controller is busy, a bounded time
ahead of the robot.
"""

from collections import deque
from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from unwrinkle.hardware.motoros.messages import (
    Command,
    GroupPoint,
    Message,
    MotionReply,
    MultiPoint,
    Result,
    TrajectoryPoint,
    describe,
)
from unwrinkle.hardware.motoros.motion_channel import Asked, MotionChannel
from unwrinkle.hardware.streaming.path_clock import PathClock, Sample
from unwrinkle.models.arrays import Array
from unwrinkle.models.site import ControllerSite
from unwrinkle.planning.trajectory import hermite_positions

#: Records a point that is sent: now, s, sequence, time, s, positions, rad, velocities, rad/s.
Recorder: TypeAlias = Callable[[float, int, float, Array, Array], None]

#: Axes of each control group, by the site's group names.
GROUP_AXES = {"r1": slice(1, 7), "r2": slice(7, 13), "ext_axis": slice(0, 1)}

#: Time between the two points of rest that begin every motion, s: meanwhile the queues fill. A
#: multiple of the interpolation periods of 4 and 8 ms, so that a plan's points fall on the
#: controller's clock.
START_DWELL_S = 0.104
#: Largest difference of the groups' starts, s.
LARGEST_START_SKEW_S = 0.02
#: Largest delay of a busy controller behind the host's estimate, s.
BUSY_DELAY_S = 0.02
#: Fraction of a millisecond added to a point's time, so that no rounding lets the controller cut it
#: one too low.
_TIME_MARGIN_MS = 0.4
#: Difference of two times that is rounding, s.
_ROUNDING_S = 1e-6
#: Velocity of all axes at rest, rad/s.
_NO_VELOCITY = np.zeros(13)
#: Key of a message to all groups.
_ALL = -1


def sent_time(when: float) -> float:
    """Return the time to send for a point at a whole millisecond, s: the controller cuts it to that
    millisecond.
    """
    return (round(1e3 * when) + _TIME_MARGIN_MS) / 1e3


def longest_searched_lag(site: ControllerSite) -> float:
    """Return the greatest lag of the feedback that is searched, s: well beyond the site's limit, so
    as to report it.
    """
    return max(0.5, 2.0 * site.latency)


class PointStream:
    """Sends the points of one path.

    The stream's clock is that of the points' times, which are whole milliseconds. It runs on the
    robot from the moment the first point of motion is sent, and stops while the path rests. Points
    are sent up to the site's `lead` ahead of it.

    Attributes:
        clock: of the path.
        acknowledged: points that every group has accepted.
        skew: difference of the groups' starts of the last motion, s.
        offsets: (13,) start of each axis' group after the first group's, of the last motion, s.
        problem: why the stream cannot go on; empty while it can.
        stopped: nothing more is sent.
    """

    def __init__(
        self, clock: PathClock, site: ControllerSite, channel: MotionChannel, record: Recorder
    ) -> None:
        """Prepare to send; the first `poll` sends the clock's next point.

        Args:
            clock: produces the points.
            site: of the controller.
            channel: of the motion connection.
            record: is called for every point sent.
        """
        self.clock = clock
        self._site = site
        self._channel = channel
        self._record = record
        self._sequence = 0
        self._shift = 0.0  # of times sent against the path clock's, from points of rest, s
        self._point: tuple[Sample, float] | None = (
            None  # not acknowledged yet, with its time as sent, s
        )
        self._messages: dict[int, Message] = {}  # of it, by group: those not acknowledged yet
        self._again: dict[int, float] = {}  # when to repeat those that were refused as busy, s
        self._busy = False  # a group has refused the point as busy
        self._first_sent = 0.0
        self._synchro: float | None = None  # next check of synchrony, s
        self._synchronous = site.synchro != "each"
        self._resting = True  # the last point produced is one of rest
        self._anchor: tuple[float, float] | None = (
            None  # host time and stream time, s; None while at rest
        )
        self._taken = 0.0  # time of the last point that every group has accepted, s
        self._starts: dict[int, float] = {}
        self._history: deque[tuple[float, float, Array, Array]] = deque()  # time, s, q, v
        self._arrays: tuple[Array, Array, Array, Array] | None = None
        self.acknowledged = 0
        self.skew = 0.0
        self.offsets = np.zeros(13)
        self.problem = ""
        self.stopped = False

    def executed(self, now: float) -> float:
        """Return the stream time that the robot is commanded to now, s; at most that of the last
        point accepted.
        """
        if self._anchor is None:
            return self._taken
        return min(self._raw(now), self._taken)

    def reckoned(self, now: float) -> float:
        """Return the stream time of a robot that is not limited by points accepted, s: a lagging
        robot is compared with it.
        """
        return self._taken if self._anchor is None else self._raw(now)

    def at_rest(self, now: float) -> bool:
        """Return whether all points sent have been run and the last one is one of rest."""
        if not (self._resting and self._point is None):
            return False
        return self._anchor is None or self._raw(now) >= self._taken

    def ended(self, now: float) -> bool:
        """Return whether the whole path has been run."""
        return self.clock.done and self.at_rest(now)

    def progress(self, now: float) -> float:
        """Return the time on the trajectory's own clock that the robot is commanded to now, s."""
        if not self._history:
            return 0.0
        times, s, _, _ = self._tables()
        return float(np.interp(self.executed(now), times, s))

    def commanded(self, times: Array) -> Array:
        """Return the positions (n, 13), rad, that were sent for stream times (n,), s."""
        knots, _, q, v = self._tables()
        t = np.clip(times, knots[0], knots[-1])
        if len(knots) == 1:
            return np.tile(q[0], (len(t), 1))
        return hermite_positions(knots, q, v, t)

    def commanded_to(self, times: Array) -> Array:
        """Return the positions (n, 13), rad, that were sent for stream times (n,), s, with each
        group's later start.
        """
        if not self.offsets.any():
            return self.commanded(times)
        positions = np.empty((len(times), 13))
        for axes in GROUP_AXES.values():
            positions[:, axes] = self.commanded(times - self.offsets[axes][0])[:, axes]
        return positions

    def ran_out(self, now: float) -> str:
        """Return why the controller's queue has run out during motion; empty if it has not."""
        if self._anchor is None or not self._synchronous or self.stopped:
            return ""
        if self._resting and self._point is None:
            return ""
        late = self._raw(now) - self._taken
        if late <= (BUSY_DELAY_S if self._busy else _ROUNDING_S):
            return ""
        waited = now - self._first_sent
        text = f"the points that the controller has taken ended {1e3 * late:.0f} ms ago"
        if self._point is None or waited < 0.5 * self._site.lead:
            return f"{text}: this machine or the network is too slow; nothing is sent late"
        state = "busy with" if self._busy else "silent about"
        return (
            f"{text}, and for {waited:.2f} s it has been {state} the next one "
            f"({self._sequence - 1})"
        )

    def poll(self, now: float) -> None:
        """Send the points that are due."""
        if self.problem or self.stopped:
            return
        if self._synchro is not None:
            if now >= self._synchro and self._channel.quiet:
                self._channel.control(Command.CHECK_SYNCHRO, now)
                self._synchro = float("inf")
            return
        if self._point is None:
            self._produce(now)
            return
        for group, when in list(self._again.items()):
            if now >= when:
                del self._again[group]
                self._send(group, now)

    def stop(self) -> None:
        """Send nothing more."""
        self.stopped = True

    def answered(self, asked: Asked, reply: MotionReply, now: float) -> None:
        """Process the reply to a point, or to the check of synchrony."""
        if self.stopped or self.problem:
            return
        if asked.what == Command.CHECK_SYNCHRO:
            self._checked(asked, reply, now)
            return
        if self._point is None or asked.group not in self._messages:
            return
        if reply.result == Result.BUSY:
            if now - self._first_sent > self._site.busy_limit:
                self.problem = (
                    f"the controller has been busy with point {asked.sequence} (group "
                    f"{asked.group}) for {now - self._first_sent:.2f} s, at most "
                    f"{self._site.busy_limit:g} s"
                )
            self._again[asked.group] = now + self._site.busy_retry
            self._busy = True
            return
        if reply.result != Result.SUCCESS:
            what = describe(reply.result, reply.subcode)
            self.problem = (
                f"the controller refuses point {asked.sequence} (group {asked.group}): {what}"
            )
            return
        del self._messages[asked.group]
        self._starts[asked.group] = asked.sent
        if not self._messages:
            self._all_taken(now)

    def _checked(self, asked: Asked, reply: MotionReply, now: float) -> None:
        if reply.result == Result.SUCCESS:
            self._synchro = None
            self._send_all(now)
        elif reply.result != Result.FAILURE:
            self.problem = f"the check of synchrony fails: {describe(reply.result, reply.subcode)}"
        elif now - self._first_sent > self._site.busy_limit:
            self.problem = (
                f"the groups are not in synchrony after {now - self._first_sent:.2f} s, at most "
                f"{self._site.busy_limit:g} s"
            )
        else:
            self._synchro = now + self._site.busy_retry

    def _raw(self, now: float) -> float:
        assert self._anchor is not None
        return self._anchor[1] + now - self._anchor[0]

    def _all_taken(self, now: float) -> None:
        assert self._point is not None
        starts = self._starts.values()
        if self._anchor is None and self.acknowledged > 0:
            self.skew = max(starts) - min(starts)
            self._note_offsets(min(starts))
            if self.skew > LARGEST_START_SKEW_S:
                self.problem = (
                    f"the control groups started {1e3 * self.skew:.0f} ms apart, at most "
                    f"{1e3 * LARGEST_START_SKEW_S:.0f} ms"
                )
        begin = min(starts)
        waits = (
            not self._synchronous and self._anchor is not None and self._raw(begin) > self._taken
        )
        if self.acknowledged > 0 and (self._anchor is None or waits):
            self._anchor = (begin, self._taken)
        elif self._busy and self._anchor is not None:  # it is slower than estimated
            self._anchor = (now, self.executed(now))
        self._taken = self._point[1]
        self._point, self._busy = None, False
        self.acknowledged += 1

    def _note_offsets(self, begin: float) -> None:
        for group, start in self._starts.items():
            if group != _ALL:
                self.offsets[GROUP_AXES[self._site.groups[group]]] = start - begin

    def _produce(self, now: float) -> None:
        """Send the next point if it is due."""
        last = self.clock.last
        if last is not None and self.clock.at_rest:
            self._resting = True  # also after a hold before the first point of motion
            return
        if last is not None and self._resting and self.at_rest(now):
            self._anchor = None
            self._resting = False
            self._shift += START_DWELL_S
            rest = Sample(last.time, last.positions, _NO_VELOCITY, last.s, 0.0)
            self._take(rest, rest.time + self._shift, now)
            return
        until = self.executed(now) + self._site.lead - self._shift
        for sample in self.clock.next_until(until, most=1):
            self._resting = self.clock.at_rest or sample.s == 0.0
            self._take(sample, sample.time + self._shift, now)

    def _take(self, sample: Sample, time: float, now: float) -> None:
        """Send a point."""
        q, v = sample.positions, sample.velocities
        self._point = (sample, time)
        self._remember(time, sample, now)
        self._messages = self._encoded(time, q, v)
        self._starts = {}
        self._record(now, self._sequence, time, q, v)
        self._first_sent = now
        self._sequence += 1
        if self._site.synchro == "each":
            self._synchro = now
            self.poll(now)
        else:
            self._send_all(now)

    def _encoded(self, when: float, q: Array, v: Array) -> dict[int, Message]:
        time = sent_time(when)
        groups = [GROUP_AXES[name] for name in self._site.groups]
        if self._site.profile == "ex":
            points = tuple(
                GroupPoint(k, time, tuple(q[axes]), tuple(v[axes])) for k, axes in enumerate(groups)
            )
            return {_ALL: MultiPoint(self._sequence, points).to_message()}
        return {
            k: TrajectoryPoint(k, self._sequence, time, tuple(q[axes]), tuple(v[axes])).to_message()
            for k, axes in enumerate(groups)
        }

    def _send_all(self, now: float) -> None:
        for group in self._messages:
            self._send(group, now)

    def _send(self, group: int, now: float) -> None:
        self._channel.point(self._messages[group], group, self._sequence - 1, now)

    def _remember(self, time: float, sample: Sample, now: float) -> None:
        self._history.append((time, sample.s, sample.positions, sample.velocities))
        oldest = self.executed(now) - longest_searched_lag(self._site) - 0.5
        while len(self._history) > 2 and self._history[1][0] < oldest:
            self._history.popleft()
        self._arrays = None

    def _tables(self) -> tuple[Array, Array, Array, Array]:
        """Return times, path times, positions and velocities of the points sent lately."""
        if self._arrays is None:
            times, s, q, v = zip(*self._history, strict=True)
            self._arrays = (np.array(times), np.array(s), np.array(q), np.array(v))
        return self._arrays
