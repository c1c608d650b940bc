"""Model of a controller that runs trajectories: start check, cubic interpolation, hold, speed
override.

The player follows a given path exactly: a hold and the speed override change only the rate r =
ds/dt of the path's clock s. It works for any number of axes A; a state is an immutable value, and
every method returns a new one.
"""

import dataclasses as dc
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import InputError
from unwrinkle.models.shared import Shared
from unwrinkle.planning.arrival import (
    ARRIVAL_TIME_S,
    ARRIVED_POSITION_RAD,
    ARRIVED_SPEED_RAD_S,
)
from unwrinkle.planning.motion_mode import MotionMode
from unwrinkle.planning.trajectory import LIMIT_ROUNDING, SampledCubic


@dataclass(frozen=True, eq=False)
class PlayerLimits:
    """Limits beyond which a trajectory is refused; (A,) each.

    Attributes:
        lower, upper: positions, rad.
        velocity: rad/s.
        acceleration: rad/s^2.
    """

    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array


@dataclass(frozen=True)
class PlayerSettings:
    """Tolerances of the checks, and rates of change of the path's clock.

    Attributes:
        start_tolerance: largest distance of the robot from a trajectory's first point, rad; 30
            pulses of a DX100 are about 1 mrad on the arm's axes.
        rate_acceleration: greatest change of the rate, 1/s.
        least_braking: least decrease of the rate in a hold, 1/s, even where the path itself uses up
            an axis' acceleration.
        arrived, arrived_speed: largest distance from the last point, rad, and speed, rad/s, at
            which a trajectory is completed.
        arrival_time: longest time from the trajectory's end until then, s.
        following_limit: largest following error, rad.
    """

    start_tolerance: float = 1e-3
    rate_acceleration: float = 2.5
    least_braking: float = 0.5
    arrived: float = ARRIVED_POSITION_RAD
    arrived_speed: float = ARRIVED_SPEED_RAD_S
    arrival_time: float = ARRIVAL_TIME_S
    following_limit: float = 0.1


@dataclass(frozen=True, eq=False)
class PlayerState(Shared):
    """State of the player between two steps.

    Attributes:
        mode: see `MotionMode`.
        rest: (A,) position while no trajectory runs, rad.
        trajectory: under way; None at rest.
        number, name: of the trajectory's command.
        s: time on the trajectory's clock, s.
        rate: ds/dt.
        waited: time since the trajectory's end, s.
        queued: next trajectory: number, trajectory, name.
        command: number of the last command accepted or refused.
        completed: number of the last command done: a trajectory run to its end, or a hold at rest.
        reason: why a command was refused, the robot holds, or a fault is latched; else empty.
    """

    mode: MotionMode
    rest: Array
    trajectory: SampledCubic | None = None
    number: int = 0
    name: str = ""
    s: float = 0.0
    rate: float = 0.0
    waited: float = 0.0
    queued: tuple[int, SampledCubic, str] | None = None
    command: int = 0
    completed: int = 0
    reason: str = ""


class TrajectoryPlayer:
    """The rules by which a `PlayerState` changes."""

    def __init__(
        self, limits: PlayerLimits, axes: tuple[str, ...], settings: PlayerSettings | None = None
    ) -> None:
        """Use limits and settings; `axes` are the names for messages.

        Raises:
            InputError: a limit does not have one number per axis.
        """
        for item in dc.fields(limits):
            if np.shape(getattr(limits, item.name)) != (len(axes),):
                raise InputError(f"trajectory player: {item.name} needs {len(axes)} numbers")
        self._limits = limits
        self._axes = axes
        self.settings = settings or PlayerSettings()

    def at_rest(self, positions: ArrayLike) -> PlayerState:
        """Return the state of a robot at rest at positions (A,), rad.

        Raises:
            InputError: not one finite number per axis.
        """
        rest = np.array(positions, dtype=float)
        if rest.shape != (len(self._axes),) or not np.isfinite(rest).all():
            raise InputError(f"trajectory player: start {rest.shape} is no finite posture")
        rest.setflags(write=False)
        return PlayerState(MotionMode.IDLE, rest)

    def accept(
        self,
        state: PlayerState,
        number: int,
        trajectory: SampledCubic | None,
        measured: Array,
        name: str = "",
    ) -> PlayerState:
        """Accept or refuse a command; a number seen before changes nothing.

        Args:
            state: before the command.
            number: counts up.
            trajectory: to run; None holds.
            measured: (A,) position of the robot, rad.
            name: of the trajectory, for messages.

        Returns:
            The state after the command. A refusal does not change the motion and states its reason.
                One trajectory that starts at the end of the running one is queued.
        """
        if number <= state.command:
            return state
        state = dc.replace(state, command=number)
        if trajectory is None:
            return self._hold(state, number, "hold commanded")
        label = f"trajectory {number}" + (f" ({name})" if name else "")
        problem = self._problem(state, trajectory, np.asarray(measured, dtype=float))
        if problem:
            return dc.replace(state, reason=f"{label} refused: {problem}")
        if state.mode == MotionMode.RUNNING:
            return dc.replace(state, queued=(number, trajectory, name), reason="")
        return dc.replace(_started(state, number, trajectory, name), reason="")

    def advance(
        self,
        state: PlayerState,
        step: float,
        override: float,
        measured: Array,
        speed: Array,
    ) -> PlayerState:
        """Advance by one control period.

        Args:
            state: at the begin of the period.
            step: the period, s.
            override: commanded rate, 0 to 1; another value holds.
            measured, speed: (A,) of the robot now, rad and rad/s.

        Returns:
            The state at the end of the period; see `reference`.
        """
        if state.trajectory is None:
            return state
        problem = self._following(state, measured)
        if problem and state.mode != MotionMode.FAULT:
            state = dc.replace(state, mode=MotionMode.FAULT, reason=problem, queued=None)
        if state.mode == MotionMode.RUNNING and not 0.0 <= override <= 1.0:
            state = self._hold(state, 0, f"speed override is {override}, not within 0 to 1")
        target = override if state.mode == MotionMode.RUNNING else 0.0
        trajectory = state.trajectory
        assert trajectory is not None
        if state.s >= trajectory.duration:
            return self._arriving(state, step, measured, speed)
        if state.s == 0.0 and state.mode == MotionMode.RUNNING:
            rate = before = target  # at rest, so any rate may begin
        else:
            before, rate = state.rate, self._next_rate(state, trajectory, step, target)
        s = min(state.s + 0.5 * (before + rate) * step, trajectory.duration)
        state = dc.replace(state, s=s, rate=rate)
        if state.mode != MotionMode.RUNNING and rate == 0.0:
            return self._stopped(state, trajectory)
        return state

    def reference(self, state: PlayerState, ahead: float = 0.0) -> tuple[Array, Array]:
        """Return the commanded position, rad, and velocity, rad/s, (A,).

        Args:
            state: of the player.
            ahead: time after the state, s, at its present rate.
        """
        if state.trajectory is None:
            return state.rest, np.zeros_like(state.rest)
        s = min(state.s + ahead * state.rate, state.trajectory.duration)
        q, slope = state.trajectory.at(s)
        return q, slope * (0.0 if s >= state.trajectory.duration else state.rate)

    def _problem(self, state: PlayerState, trajectory: SampledCubic, measured: Array) -> str:
        """Return why a trajectory is refused; empty if it is not."""
        if state.mode == MotionMode.FAULT:
            return f"the controller is in fault ({state.reason})"
        if state.mode == MotionMode.HOLDING:
            return "the robot is still braking"
        if state.mode == MotionMode.RUNNING and state.queued is not None:
            return f"one runs and number {state.queued[0]} waits already"
        if trajectory.positions.shape[1] != len(self._axes):
            return f"it has {trajectory.positions.shape[1]} axes, the robot {len(self._axes)}"
        if not trajectory.finite:
            return "a number in it is not finite"
        if not trajectory.rests_at_ends:
            return "it does not start and end at rest"
        place, what = measured, "the robot stands"
        if state.mode == MotionMode.RUNNING and state.trajectory is not None:
            place, what = state.trajectory.positions[-1], "another one runs, which ends"
        if not np.isfinite(place).all():
            return "the robot's measured position is not finite"
        off = np.abs(trajectory.positions[0] - place)
        axis = int(off.argmax())
        if off[axis] > self.settings.start_tolerance:
            return (
                f"{what} {1e3 * off[axis]:.2f} mrad off its start on {self._axes[axis]}, at most "
                f"{1e3 * self.settings.start_tolerance:.2f} mrad; plan from where it stands"
            )
        return self._excess(trajectory)

    def _excess(self, trajectory: SampledCubic) -> str:
        found = trajectory.extremes()
        limits = self._limits
        for what, value, most in (
            ("position", found.upper, limits.upper),
            ("position", -found.lower, -limits.lower),
            ("velocity", found.speed, limits.velocity),
            ("acceleration", found.acceleration, limits.acceleration),
        ):
            over = value - most - LIMIT_ROUNDING * np.abs(most)
            axis = int(over.argmax())
            if not over[axis] <= 0.0:
                return (
                    f"{what} of {self._axes[axis]} reaches {value[axis]:.4f}, {over[axis]:.4f} "
                    f"beyond its limit {most[axis]:.4f} (rad, s)"
                )
        return ""

    def _hold(self, state: PlayerState, number: int, reason: str) -> PlayerState:
        """Begin to brake; at rest, a hold is completed at once."""
        if state.mode == MotionMode.FAULT:
            return state
        if state.trajectory is None:
            return dc.replace(state, mode=MotionMode.IDLE, completed=number, reason="")
        return dc.replace(state, mode=MotionMode.HOLDING, number=number, queued=None, reason=reason)

    def _next_rate(
        self, state: PlayerState, trajectory: SampledCubic, step: float, target: float
    ) -> float:
        """Return the rate at the end of the period: towards the target, within the axes'
        acceleration limits.

        The joint acceleration q_ss r^2 + q_s r' bounds r' for every axis (path time scaling);
        braking has a least value, so that a hold always comes to rest.
        """
        rate, settings = state.rate, self.settings
        if rate == target:
            return rate
        slope, bend, _ = trajectory.derivatives(state.s)
        used = bend * rate * rate
        speed = np.maximum(np.abs(slope), 1e-9)
        towards = np.sign(target - rate) * np.sign(slope)
        most = float(((self._limits.acceleration - towards * used) / speed).min())
        if target < rate:
            change = min(settings.rate_acceleration, max(most, settings.least_braking))
            return max(target, rate - change * step)
        change = min(settings.rate_acceleration, max(most, 0.0))
        return min(target, rate + change * step)

    def _stopped(self, state: PlayerState, trajectory: SampledCubic) -> PlayerState:
        rest = trajectory.at(state.s)[0]
        rest.setflags(write=False)
        done = (
            state.number if state.mode == MotionMode.HOLDING and state.number else state.completed
        )
        mode = MotionMode.IDLE if state.mode == MotionMode.HOLDING else MotionMode.FAULT
        reason = state.reason
        if state.mode == MotionMode.HOLDING:
            reason += f"; at rest {state.s:.2f} s into {state.name or 'the trajectory'}"
        return dc.replace(
            state, mode=mode, rest=rest, trajectory=None, rate=0.0, completed=done, reason=reason
        )

    def _arriving(
        self, state: PlayerState, step: float, measured: Array, speed: Array
    ) -> PlayerState:
        """Wait at the end of the trajectory until the robot has arrived."""
        trajectory = state.trajectory
        assert trajectory is not None
        if state.mode != MotionMode.RUNNING:
            return self._stopped(state, trajectory)
        end = trajectory.positions[-1]
        off = np.abs(measured - end).max()
        if off <= self.settings.arrived and np.abs(speed).max() <= self.settings.arrived_speed:
            done = dc.replace(state, mode=MotionMode.IDLE, rest=end, trajectory=None, rate=0.0)
            done = dc.replace(done, completed=state.number)
            if state.queued is not None:
                number, follow_up, name = state.queued
                return _started(done, number, follow_up, name)
            return done
        waited = state.waited + step
        if waited > self.settings.arrival_time:
            reason = f"the robot is {1e3 * off:.2f} mrad off the end of {state.name or 'its path'}"
            return dc.replace(
                state, mode=MotionMode.FAULT, rest=end, trajectory=None, rate=0.0, reason=reason
            )
        return dc.replace(state, waited=waited, rate=0.0)

    def _following(self, state: PlayerState, measured: Array) -> str:
        """Return why the following error is a fault; empty if it is not."""
        error: NDArray[Any] = np.abs(measured - self.reference(state)[0])
        axis = int(error.argmax())
        if error[axis] <= self.settings.following_limit:
            return ""
        return (
            f"following error of {self._axes[axis]} is {1e3 * error[axis]:.0f} mrad, at most "
            f"{1e3 * self.settings.following_limit:.0f}"
        )


def _started(state: PlayerState, number: int, trajectory: SampledCubic, name: str) -> PlayerState:
    return dc.replace(
        state,
        mode=MotionMode.RUNNING,
        trajectory=trajectory,
        number=number,
        name=name,
        s=0.0,
        rate=0.0,
        waited=0.0,
        queued=None,
    )
