"""What may not be: feedback too old or impossible, an axis off its path, a robot that may not move, a driver that is late."""

from collections import deque

import numpy as np

from unwrinkle.hardware.controller.feedback import interval
from unwrinkle.hardware.controller.finding import FaultCause, Finding
from unwrinkle.hardware.controller_state import JointFeedback, RobotStatus
from unwrinkle.hardware.streaming.stream import GROUP_AXES, PointStream, most_lag
from unwrinkle.models.arrays import Array
from unwrinkle.models.limits import Limits
from unwrinkle.models.site import ControllerSite

#: Names of the thirteen axes, for messages.
AXIS_NAMES = ("ext_axis", *(f"{arm}_{axis}" for arm in ("r1", "r2") for axis in "slurbt"))

#: Beyond a limit by so much is impossible, rad.
BEYOND = 5e-3
#: An axis that moves faster than so many times its limit, and so much more, has not moved: its encoder is wrong.
_JUMP_FACTOR, _JUMP_ROOM = 1.5, 5e-3
#: Lags are sought in steps of this, s.
_LAG_STEP = 0.001
#: Beyond the site's latency: an interpolation period until a point is begun, and the age of the feedback itself, s.
LATENCY_ROOM = 0.035
#: A control group may be begun an interpolation period after another, so its lag may be another one by this, s.
GROUP_SKEW = 0.009
#: A proposed lag fits better than lags _LAG_APART shorter and longer by this, and was within the spread all along, rad and s.
_FITS_BETTER, _SPREAD = 2e-4, 0.03
#: A group that was seen to move less has stood still, rad.
_STILL = 1e-3
#: A lag shows if lags so much shorter and longer (s) fit worse by so much (rad); at rest every lag fits.
_LAG_APART, _LAG_SHOWS = 0.02, 2e-3
#: Share of a new lag in the one that is told.
_LAG_SHARE = 0.2


class Monitor:
    """Judges what a driver sees; remembers only how late and how far off it was.

    Attributes:
        late: polls that came later than the site allows.
        following_error: largest distance of an axis from where it was sent, rad, the lag taken out.
        lag: that fits the motion best, s.
    """

    def __init__(self, site: ControllerSite, limits: Limits) -> None:
        """Judge by a site's settings and the robot's limits."""
        self._site = site
        self._limits = limits
        self._lags = np.arange(0.0, most_lag(site) + 0.5 * _LAG_STEP, _LAG_STEP)
        self._allowed = int((self._lags <= site.latency + LATENCY_ROOM).sum())
        self._fits: deque[float] = deque(maxlen=6)
        self._begin: Array | None = None
        self.late = 0
        self.following_error = 0.0
        self.lag = 0.0

    def restart(self) -> None:
        """Forget what was seen of the trajectory before."""
        self._fits.clear()
        self._begin = None
        self.late = 0
        self.following_error = 0.0
        self.lag = 0.0

    def polled(self, gap: float, streaming: bool) -> Finding | None:
        """Judge the time since the poll before, s."""
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
            f"the driver was polled late {self.late} times (by more than {1e3 * self._site.late:.0f} ms), at most "
            f"{self._site.late_budget}; is this machine too busy?",
            brake=True,
        )

    def plausible(self, feedback: JointFeedback, last: JointFeedback | None) -> Finding | None:
        """Judge a set of feedback by itself and by the one before."""
        q = feedback.positions
        if not np.isfinite(q).all():
            axis = AXIS_NAMES[int(np.argmin(np.isfinite(q)))]
            return Finding(FaultCause.FEEDBACK, f"feedback of {axis} is not a finite number")
        beyond = np.maximum(q - self._limits.upper, self._limits.lower - q)
        axis_index = int(beyond.argmax())
        if beyond[axis_index] > BEYOND:
            low, high = self._limits.lower[axis_index], self._limits.upper[axis_index]
            hint = "; are these degrees?" if np.abs(q).max() > 4.0 else ""
            return Finding(
                FaultCause.FEEDBACK,
                f"feedback says {AXIS_NAMES[axis_index]} stands at {q[axis_index]:.4f} rad, its limits are "
                f"{low:.4f} and {high:.4f} rad{hint}",
            )
        if last is None:
            return None
        period = self._site.feedback_period
        step = max(interval(last, feedback.received, feedback.stamp, period), period)
        room = _JUMP_FACTOR * self._limits.velocity * step + _JUMP_ROOM
        over = np.abs(q - last.positions) - room
        axis_index = int(over.argmax())
        if over[axis_index] > 0.0:
            moved = abs(q[axis_index] - last.positions[axis_index])
            degrees = (np.abs(np.radians(q) - last.positions) <= room).all()
            hint = "are these degrees?" if degrees else "check its encoder"
            return Finding(
                FaultCause.JUMP,
                f"feedback of {AXIS_NAMES[axis_index]} jumped by {moved:.4f} rad in {1e3 * step:.0f} ms, at most "
                f"{room[axis_index]:.4f} rad is possible; {hint}",
            )
        return None

    def follows(self, feedback: JointFeedback, stream: PointStream) -> Finding | None:
        """Judge how the robot follows what was sent: one lag for all axes, within the site's latency."""
        site, lags = self._site, self._lags
        off = np.abs(
            stream.commanded_to(stream.reckoned(feedback.received) - lags) - feedback.positions
        )
        # The lag that fits the axes together; one axis that is off does not hide behind the others.
        sums = off.sum(axis=1)
        best = int(sums[: self._allowed].argmin())
        fits = int(sums.argmin())
        self._begin = feedback.positions if self._begin is None else self._begin
        errors = self._errors(off, best)
        error = float(errors.max())
        if self._shows(sums, fits, _LAG_SHOWS):
            lag = float(lags[fits])
            self._fits.append(lag)
            self.lag = lag if self.lag == 0.0 else self.lag + _LAG_SHARE * (lag - self.lag)
        self.following_error = max(self.following_error, error)
        if error <= site.following:
            return None
        axis = int(errors.argmax())
        text = (
            f"{AXIS_NAMES[axis]} is {error:.4f} rad off its path at {stream.progress(feedback.received):.3f} s, at "
            f"most {site.following:g} rad (lags up to {1e3 * site.latency:.0f} ms taken out)"
        )
        name, axes = next((n, a) for n, a in GROUP_AXES.items() if a.start <= axis < a.stop)
        if np.abs(feedback.positions - self._begin)[axes].max() < _STILL:
            text += f"; {name} has not moved at all: does the firmware move it (controller.groups_moved)?"
        elif off[fits].max() <= site.following and self._proposes(sums, fits):
            text += (
                f"; a lag of {1e3 * lags[fits]:.0f} ms would fit: if that is the controller's own, "
                "set controller.latency above it"
            )
        return Finding(FaultCause.FOLLOWING, text)

    @staticmethod
    def _errors(off: Array, best: int) -> Array:
        """Distances (13,) of the axes at the lag that fits them together, each group's own lag within `GROUP_SKEW`, rad."""
        near = round(GROUP_SKEW / _LAG_STEP)
        window = off[max(best - near, 0) : best + near + 1]
        errors = np.empty(off.shape[1])
        for axes in GROUP_AXES.values():
            errors[axes] = window[int(window[:, axes].max(axis=1).argmin()), axes]
        return errors

    def _proposes(self, sums: Array, fits: int) -> bool:
        """Whether a lag is the controller's own for all that is known: it stands out, and it does not grow."""
        grows = len(self._fits) > 0 and float(self._lags[fits]) - min(self._fits) > _SPREAD
        return self._shows(sums, fits, _FITS_BETTER) and not grows

    @staticmethod
    def _shows(sums: Array, fits: int, by: float) -> bool:
        """Whether the lag that fits best, an index, is told from others by the distances (n,) of all lags, rad."""
        apart = round(_LAG_APART / _LAG_STEP)
        if fits + apart >= len(sums):  # longer ones were not looked at
            return False
        others = [k for k in (fits - apart, fits + apart) if k >= 0]
        return bool(min(sums[others]) > sums[fits] + by)

    def stands(self, feedback: JointFeedback, positions: Array) -> str:
        """Why the robot does not stand where it has to be for a motion to begin; empty if it does."""
        off, most = np.abs(feedback.positions - positions), np.array(self._site.start_tolerances)
        axis = int((off / most).argmax())
        if off[axis] <= most[axis]:
            return ""
        return (
            f"the robot stands {1e3 * off[axis]:.2f} mrad off on {AXIS_NAMES[axis]}, at most "
            f"{1e3 * most[axis]:.2f} mrad; plan from where it stands"
        )

    def robot(self, status: RobotStatus | None, moving: bool) -> Finding | None:
        """Judge the robot's status while a trajectory is under way; `moving`: it was possible before."""
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
                "the controller says that motion is not possible any more: hold pressed, remote off, or its job ended?",
            )
        return None
