"""Checks of feedback, following error, robot status and poll times, as findings or None."""

from collections import deque

import numpy as np

from unwrinkle.hardware.controller.feedback import interval
from unwrinkle.hardware.controller.finding import FaultCause, Finding
from unwrinkle.hardware.controller_state import JointFeedback, RobotStatus
from unwrinkle.hardware.streaming.stream import GROUP_AXES, PointStream, longest_searched_lag
from unwrinkle.models.arrays import Array
from unwrinkle.models.limits import Limits
from unwrinkle.models.site import ControllerSite

#: Names of the thirteen axes, for messages.
AXIS_NAMES = ("ext_axis", *(f"{arm}_{axis}" for arm in ("r1", "r2") for axis in "slurbt"))

#: Largest excess of feedback over a position limit, rad.
LIMIT_EXCESS_RAD = 5e-3
#: A step of feedback is impossible beyond this multiple of the velocity limit ...
_JUMP_FACTOR = 1.5
#: ... and this much more, rad.
_JUMP_ROOM_RAD = 5e-3
#: Resolution of the lag search, s.
_LAG_STEP_S = 0.001
#: Allowed beyond the site's latency: one interpolation period until a point is begun, and the age
#: of the feedback, s.
LATENCY_MARGIN_S = 0.035
#: Largest difference of the control groups' lags, s: a group may begin one interpolation period
#: after another.
GROUP_LAG_SKEW_S = 0.009
#: Distance of the lags that a lag is compared with, s; at rest every lag fits.
_LAG_APART_S = 0.02
#: A lag is measured if the compared lags fit worse by this sum over the axes, rad.
_LAG_MEASURED_RAD = 2e-3
#: A lag is proposed to the user if the compared lags fit worse by this sum, rad ...
_LAG_PROPOSED_RAD = 2e-4
#: ... and if it is not greater than the least of the last lags by more than this, s.
_LAG_SPREAD_S = 0.03
#: Largest motion of a group that has not moved, rad.
_STILL_RAD = 1e-3
#: Weight of a new lag in the reported one.
_LAG_WEIGHT = 0.2


class Monitor:
    """Checks what a driver reads, and keeps statistics of the motion.

    Attributes:
        late: polls later than the site allows, since the motion began.
        following_error: largest distance of an axis from its commanded path with the lag removed,
            rad.
        lag: of the feedback behind the commands, s; smoothed, 0 before it was measured.
    """

    def __init__(self, site: ControllerSite, limits: Limits) -> None:
        """Check with a site's settings and the robot's limits."""
        self._site = site
        self._limits = limits
        self._lags = np.arange(0.0, longest_searched_lag(site) + 0.5 * _LAG_STEP_S, _LAG_STEP_S)
        self._allowed = int((self._lags <= site.latency + LATENCY_MARGIN_S).sum())
        self._fits: deque[float] = deque(maxlen=6)
        self._begin: Array | None = None
        self.late = 0
        self.following_error = 0.0
        self.lag = 0.0

    def restart(self) -> None:
        """Reset the statistics for a new trajectory."""
        self._fits.clear()
        self._begin = None
        self.late = 0
        self.following_error = 0.0
        self.lag = 0.0

    def polled(self, gap: float, streaming: bool) -> Finding | None:
        """Check the time since the last poll, s."""
        if not gap >= 0.0:
            return Finding(
                FaultCause.CLOCK, f"the host's clock went back by {-gap:.3f} s; use a monotonic one"
            )
        if not gap > self._site.late:
            return None
        self.late += 1
        if not streaming or self.late <= self._site.late_budget:
            return None
        return Finding(
            FaultCause.LATE,
            f"the driver was polled late {self.late} times (by more than "
            f"{1e3 * self._site.late:.0f} ms), at most {self._site.late_budget}; is this machine "
            "too busy?",
            brake=True,
        )

    def plausible(self, feedback: JointFeedback, last: JointFeedback | None) -> Finding | None:
        """Check a set of feedback by itself and against the one before."""
        q = feedback.positions
        if not np.isfinite(q).all():
            axis = AXIS_NAMES[int(np.argmin(np.isfinite(q)))]
            return Finding(FaultCause.FEEDBACK, f"feedback of {axis} is not a finite number")
        beyond = np.maximum(q - self._limits.upper, self._limits.lower - q)
        axis_index = int(beyond.argmax())
        if beyond[axis_index] > LIMIT_EXCESS_RAD:
            low, high = self._limits.lower[axis_index], self._limits.upper[axis_index]
            hint = "; are these degrees?" if np.abs(q).max() > 4.0 else ""
            return Finding(
                FaultCause.FEEDBACK,
                f"feedback says {AXIS_NAMES[axis_index]} stands at {q[axis_index]:.4f} rad, its "
                f"limits are {low:.4f} and {high:.4f} rad{hint}",
            )
        if last is None:
            return None
        period = self._site.feedback_period
        step = max(interval(last, feedback.received, feedback.stamp, period), period)
        room = _JUMP_FACTOR * self._limits.velocity * step + _JUMP_ROOM_RAD
        over = np.abs(q - last.positions) - room
        axis_index = int(over.argmax())
        if over[axis_index] > 0.0:
            moved = abs(q[axis_index] - last.positions[axis_index])
            degrees = (np.abs(np.radians(q) - last.positions) <= room).all()
            hint = "are these degrees?" if degrees else "check its encoder"
            return Finding(
                FaultCause.JUMP,
                f"feedback of {AXIS_NAMES[axis_index]} jumped by {moved:.4f} rad in "
                f"{1e3 * step:.0f} ms, at most {room[axis_index]:.4f} rad is possible; {hint}",
            )
        return None

    def follows(self, feedback: JointFeedback, stream: PointStream) -> Finding | None:
        """Check the following error, with one lag for all axes within the site's latency."""
        site, lags = self._site, self._lags
        off = np.abs(
            stream.commanded_to(stream.reckoned(feedback.received) - lags) - feedback.positions
        )
        # One lag fits all axes together, so that an axis off its path is not taken for a lagging
        # one.
        sums = off.sum(axis=1)
        best = int(sums[: self._allowed].argmin())
        fits = int(sums.argmin())
        self._begin = feedback.positions if self._begin is None else self._begin
        errors = self._errors(off, best)
        error = float(errors.max())
        if self._shows(sums, fits, _LAG_MEASURED_RAD):
            lag = float(lags[fits])
            self._fits.append(lag)
            self.lag = lag if self.lag == 0.0 else self.lag + _LAG_WEIGHT * (lag - self.lag)
        self.following_error = max(self.following_error, error)
        if error <= site.following:
            return None
        axis = int(errors.argmax())
        text = (
            f"{AXIS_NAMES[axis]} is {error:.4f} rad off its path at "
            f"{stream.progress(feedback.received):.3f} s, at "
            f"most {site.following:g} rad (lags up to {1e3 * site.latency:.0f} ms taken out)"
        )
        name, axes = next((n, a) for n, a in GROUP_AXES.items() if a.start <= axis < a.stop)
        if np.abs(feedback.positions - self._begin)[axes].max() < _STILL_RAD:
            text += (
                f"; {name} has not moved at all: does the firmware move it "
                "(controller.groups_moved)?"
            )
        elif off[fits].max() <= site.following and self._proposes(sums, fits):
            text += (
                f"; a lag of {1e3 * lags[fits]:.0f} ms would fit: if that is the controller's own, "
                "set controller.latency above it"
            )
        return Finding(FaultCause.FOLLOWING, text)

    @staticmethod
    def _errors(off: Array, best: int) -> Array:
        """Return the distances (13,) of the axes from their path, rad, each group at its own lag
        within `GROUP_LAG_SKEW_S` of the best.
        """
        near = round(GROUP_LAG_SKEW_S / _LAG_STEP_S)
        window = off[max(best - near, 0) : best + near + 1]
        errors = np.empty(off.shape[1])
        for axes in GROUP_AXES.values():
            errors[axes] = window[int(window[:, axes].max(axis=1).argmin()), axes]
        return errors

    def _proposes(self, sums: Array, fits: int) -> bool:
        """Return whether a lag may be the controller's own: distinct, and not growing."""
        grows = len(self._fits) > 0 and float(self._lags[fits]) - min(self._fits) > _LAG_SPREAD_S
        return self._shows(sums, fits, _LAG_PROPOSED_RAD) and not grows

    @staticmethod
    def _shows(sums: Array, fits: int, by: float) -> bool:
        """Return whether the best lag, an index of `sums` (n,), rad, fits better than those
        `_LAG_APART_S` away.
        """
        apart = round(_LAG_APART_S / _LAG_STEP_S)
        if fits + apart >= len(sums):  # longer lags were not searched
            return False
        others = [k for k in (fits - apart, fits + apart) if k >= 0]
        return bool(min(sums[others]) > sums[fits] + by)

    def stands(self, feedback: JointFeedback, positions: Array) -> str:
        """Return why the robot does not stand at positions (13,), rad; empty if it does."""
        off, most = np.abs(feedback.positions - positions), np.array(self._site.start_tolerances)
        axis = int((off / most).argmax())
        if off[axis] <= most[axis]:
            return ""
        return (
            f"the robot stands {1e3 * off[axis]:.2f} mrad off on {AXIS_NAMES[axis]}, at most "
            f"{1e3 * most[axis]:.2f} mrad; plan from where it stands"
        )

    def robot(self, status: RobotStatus | None, moving: bool) -> Finding | None:
        """Check the robot's status while a trajectory is under way; `moving`: motion was possible
        before.
        """
        if status is None:
            return None
        if status.problem:
            return Finding(FaultCause.ROBOT, status.problem)
        if moving and status.drives_powered == 0:
            text = "the servos are off: was remote turned off, or a safety circuit opened?"
            return Finding(FaultCause.ROBOT, text)
        if moving and status.motion_possible == 0:
            return Finding(
                FaultCause.ROBOT,
                "the controller says that motion is not possible any more: hold pressed, remote "
                "off, or its job ended?",
            )
        return None
