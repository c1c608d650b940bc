"""Drake system of the head's two simulated pan-tilt units.

Modelled are whole steps, bounded speed and acceleration, and rest errors.
"""

from dataclasses import dataclass

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from unwrinkle.flattening.station_messages import HeadCommand
from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import InputError
from unwrinkle.models.limits import HeadLimits
from unwrinkle.models.shared import Shared
from unwrinkle.perception.stereo.head import Gaze, StereoHead
from unwrinkle.simulation.devices.pan_tilt import REPEATABILITY
from unwrinkle.systems.abstract_state import set_state_value, state_value

#: ASSUMED: acceleration of an axis, rad/s^2.
ACCELERATION = 20.0
#: ASSUMED: time for which the mount vibrates after a motion, s.
STILL_AFTER = 0.10


@dataclass(frozen=True, eq=False)
class HeadStatus(Shared):
    """Report of the pan-tilt units.

    Attributes:
        number: number of the last command, accepted or refused.
        still: whether both units rest.
        angles: (4,) reported angles: left pan, tilt, right pan, tilt, rad.
        reason: why the command was refused; empty if it was not.
    """

    number: int
    still: bool
    angles: Array
    reason: str = ""


@dataclass(frozen=True, eq=False)
class _Turn(Shared):
    """Motion of all four axes: reported and true angles (4,) at both ends, rad.

    `begin` is its start, s.
    """

    number: int
    begin: float
    reported: tuple[Array, Array]
    true: tuple[Array, Array]
    reason: str = ""


class HeadSystem(LeafSystem):
    """Simulate both pan-tilt units of the head.

    Inputs: `command`. Outputs: `status` (`HeadStatus`), `position` (4,) as reported, `desired`
    (8,): true angles and rates for the servos. An axis stops off the reported angle by an error
    that is drawn anew for each motion (see `simulation.devices.pan_tilt`).
    """

    def __init__(
        self,
        head: StereoHead,
        limits: HeadLimits,
        start: tuple[float, float],
        *,
        seed: int,
        period: float,
        repeatability: float = REPEATABILITY,
    ) -> None:
        """Start at rest.

        Args:
            head: stereo head, with the steps and limits of its units.
            limits: speeds of the axes.
            start: pan and tilt of both units, rad.
            seed: seed of the rest errors.
            period: period of the units' control, s.
            repeatability: standard deviation of the rest error, steps.
        """
        super().__init__()
        self.set_name("head")
        self._eyes = (head.left, head.right)
        self._speed = np.array(2 * [limits.pan.velocity, limits.tilt.velocity])
        self._seed, self._repeatability = seed, repeatability
        self._step = np.repeat([eye.unit.step for eye in self._eyes], 2)
        rest = self._whole_steps(np.array([*start, *start]))
        self._command = self.DeclareAbstractInputPort("command", Value(HeadCommand()))
        begin = _Turn(0, -1e3, (rest, rest), (rest, rest))
        self._state = self.DeclareAbstractState(Value(begin))
        tickets = {self.abstract_state_ticket(self._state), self.time_ticket()}
        first = HeadStatus(0, True, rest)
        self.DeclareAbstractOutputPort("status", lambda: Value(first), self._status, tickets)
        self.DeclareVectorOutputPort("position", BasicVector(4), self._position, tickets)
        self.DeclareVectorOutputPort("desired", BasicVector(8), self._desired, tickets)
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._advance)

    def _advance(self, context: Context, state: State) -> None:
        turn: _Turn = state_value(context, self._state)
        command: HeadCommand = self._command.Eval(context)
        if command.number > turn.number:
            set_state_value(state, self._state, self._turned(turn, command, context.get_time()))

    def _turned(self, turn: _Turn, command: HeadCommand, now: float) -> _Turn:
        share, _ = self._progress(turn, now)
        reported = self._whole_steps(_between(turn.reported, share))
        true = _between(turn.true, share)
        try:
            for eye, angles in zip(
                self._eyes, (command.gaze.left, command.gaze.right), strict=True
            ):
                eye.unit.check(*angles, f"{eye.name} eye")
        except InputError as refusal:
            # A refused command moves nothing.
            return _Turn(command.number, now, (reported, reported), (true, true), str(refusal))
        wanted = self._whole_steps(np.array([*command.gaze.left, *command.gaze.right]))
        moves = wanted != reported
        rng = np.random.default_rng([self._seed, command.number])
        most = 3.0 * self._repeatability
        error = np.clip(self._repeatability * rng.standard_normal(4), -most, most)
        goal = np.where(moves, wanted + error * self._step, true)
        return _Turn(command.number, now, (reported, wanted), (true, goal))

    def _whole_steps(self, angles: Array) -> Array:
        """Return the nearest whole steps within the limits, rad."""
        limits = np.array(
            [ends for eye in self._eyes for ends in (eye.unit.pan, eye.unit.tilt)]
        ).reshape(4, 2)
        steps = np.rint(angles / self._step)
        steps -= steps * self._step > limits[:, 1]
        steps += steps * self._step < limits[:, 0]
        return np.asarray(steps * self._step)

    def _progress(self, turn: _Turn, now: float) -> tuple[Array, Array]:
        """Return the completed share (4,) and its rate (1/s) of trapezoidal speed profiles."""
        way = np.abs(turn.true[1] - turn.true[0])
        way = np.maximum(way, 1e-12)
        peak = np.minimum(self._speed, np.sqrt(way * ACCELERATION))
        ramp = peak / ACCELERATION
        whole = way / peak + ramp
        t = np.clip(now - turn.begin, 0.0, whole)
        left = whole - t
        done = np.where(
            t < ramp,
            0.5 * ACCELERATION * t * t,
            np.where(left < ramp, way - 0.5 * ACCELERATION * left * left, peak * (t - 0.5 * ramp)),
        )
        rate = np.minimum(peak, ACCELERATION * np.minimum(t, left))
        return done / way, rate / way

    def _status(self, context: Context, output: Value) -> None:
        turn: _Turn = state_value(context, self._state)
        now = context.get_time()
        share, _ = self._progress(turn, now)
        before, _ = self._progress(turn, now - STILL_AFTER)
        angles = self._whole_steps(_between(turn.reported, share))
        output.set_value(HeadStatus(turn.number, bool((before >= 1.0).all()), angles, turn.reason))

    def _position(self, context: Context, output: BasicVector) -> None:
        turn: _Turn = state_value(context, self._state)
        share, _ = self._progress(turn, context.get_time())
        output.SetFromVector(self._whole_steps(_between(turn.reported, share)))

    def _desired(self, context: Context, output: BasicVector) -> None:
        turn: _Turn = state_value(context, self._state)
        share, rate = self._progress(turn, context.get_time())
        q, v = _between(turn.true, share), rate * (turn.true[1] - turn.true[0])
        output.SetFromVector(np.concatenate([q[:2], v[:2], q[2:], v[2:]]))


def reported_gaze(angles: Array, ext_axis: float) -> Gaze:
    """Build the gaze from the reported angles (4,) of the units and the turn-table's angle, rad."""
    pan, tilt, right_pan, right_tilt = (float(angle) for angle in angles)
    return Gaze(pan, tilt, right_pan, right_tilt, float(ext_axis))


def _between(ends: tuple[Array, Array], share: Array) -> Array:
    return np.asarray(np.where(share >= 1.0, ends[1], ends[0] + share * (ends[1] - ends[0])))
