"""Drake system of the two simulated grippers.

Their blades close at their speed, stop at cloth, and detect it.
"""

import dataclasses as dc
from dataclasses import dataclass

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from unwrinkle.flattening.station_messages import GripperCommand, GripperStatus
from unwrinkle.models.errors import InputError
from unwrinkle.models.limits import GripperLimits
from unwrinkle.models.shared import Shared
from unwrinkle.systems.abstract_state import set_state_value, state_value

#: Tolerance of the opening, m.
_OPENING_TOLERANCE = 2e-4
#: Tolerance of rounding at the end of a motion, m.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class Pinch(Shared):
    """Action of the grippers on the cloth.

    Attributes:
        asked: number of the command for which the blades have reached the cloth's thickness, right
            and left; 0 before that.
        closed: commanded state, right and left; an open gripper releases the cloth.
        spoiled: this closing is scripted to miss.
    """

    asked: tuple[int, int] = (0, 0)
    closed: tuple[bool, bool] = (False, False)
    spoiled: bool = False


@dataclass(frozen=True)
class PinchAnswer(Shared):
    """Whether cloth was between the blades for the command `answered`, right and left."""

    answered: tuple[int, int] = (0, 0)
    holding: tuple[bool, bool] = (False, False)


@dataclass(frozen=True)
class _JawMotion(Shared):
    """Motion of one gripper: opening `origin` (m) at time `begin` (s), towards `goal` (m)."""

    origin: float
    begin: float
    goal: float
    closed: bool = False
    asked: int = 0
    settled: bool = True

    def opening(self, time: float, speed: float) -> tuple[float, float]:
        """Return the opening (m) and its rate (m/s) at a time, s."""
        way = self.goal - self.origin
        done = speed * (time - self.begin)
        if done >= abs(way) - _ROUNDING:
            return self.goal, 0.0
        return self.origin + float(np.copysign(done, way)), float(np.copysign(speed, way))


@dataclass(frozen=True)
class _Jaws(Shared):
    command: int
    done: int
    closings: int
    pair: tuple[_JawMotion, _JawMotion]


class GripperSystem(LeafSystem):
    """Simulate both grippers.

    Inputs: `command`; `opening` (2,) measured, m; `answer` (`PinchAnswer`) of the cloth.
    Outputs: `status`; `pinch` (`Pinch`) for the cloth; `desired` (4,) for the servos.
    """

    def __init__(
        self,
        limits: GripperLimits,
        opening: float,
        thickness: float,
        *,
        period: float,
        misses: frozenset[int] = frozenset(),
    ) -> None:
        """Start open.

        Args:
            limits: stroke and speed.
            opening: opening of an open gripper, m.
            thickness: thickness of the cloth, at which blades that hold cloth stop, m.
            period: period of the grippers' control, s.
            misses: numbers of the closings, from 1, that fail to catch cloth.

        Raises:
            InputError: the opening is beyond the stroke, or not above the cloth's thickness.
        """
        super().__init__()
        self.set_name("grippers")
        if not 0.0 < thickness < opening <= limits.stroke:
            raise InputError(
                f"grippers: opening {opening} m must be within the stroke {limits.stroke} m and "
                f"above the cloth's thickness {thickness} m"
            )
        self._speed, self._open, self._thickness = limits.velocity, opening, thickness
        self._misses = misses
        self._command = self.DeclareAbstractInputPort("command", Value(GripperCommand()))
        self._opening = self.DeclareVectorInputPort("opening", BasicVector(2))
        self._answer = self.DeclareAbstractInputPort("answer", Value(PinchAnswer()))
        jaw = _JawMotion(opening, 0.0, opening)
        self._state = self.DeclareAbstractState(Value(_Jaws(0, 0, 0, (jaw, jaw))))
        state = self.abstract_state_ticket(self._state)
        self.DeclareAbstractOutputPort("status", lambda: Value(GripperStatus()), self._status)
        self.DeclareAbstractOutputPort("pinch", lambda: Value(Pinch()), self._pinch, {state})
        self.DeclareVectorOutputPort(
            "desired", BasicVector(4), self._desired, {state, self.time_ticket()}
        )
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._advance)

    def _advance(self, context: Context, state: State) -> None:
        jaws: _Jaws = state_value(context, self._state)
        now = context.get_time()
        command: GripperCommand = self._command.Eval(context)
        if command.number > jaws.command:
            jaws = self._commanded(jaws, command, now)
        if jaws.done == jaws.command:
            set_state_value(state, self._state, jaws)
            return
        measured = self._opening.Eval(context)
        answer: PinchAnswer = self._answer.Eval(context)
        right, left = (
            self._moved(jaw, jaws.command, float(measured[hand]), answer, hand, now)
            for hand, jaw in enumerate(jaws.pair)
        )
        done = jaws.command if right.settled and left.settled else jaws.done
        set_state_value(state, self._state, dc.replace(jaws, pair=(right, left), done=done))

    def _commanded(self, jaws: _Jaws, command: GripperCommand, now: float) -> _Jaws:
        closings, pair = jaws.closings, list(jaws.pair)
        if any(c and not jaw.closed for c, jaw in zip(command.closed, pair, strict=True)):
            closings += 1
        for hand, closed in enumerate(command.closed):
            jaw = pair[hand]
            if closed != jaw.closed:
                origin = jaw.opening(now, self._speed)[0]
                goal = self._thickness if closed else self._open
                pair[hand] = _JawMotion(origin, now, goal, closed, 0, False)
        return _Jaws(command.number, jaws.done, closings, (pair[0], pair[1]))

    def _moved(
        self,
        jaw: _JawMotion,
        number: int,
        measured: float,
        answer: PinchAnswer,
        hand: int,
        now: float,
    ) -> _JawMotion:
        there = abs(measured - jaw.goal) < _OPENING_TOLERANCE
        if jaw.settled or not there:
            return jaw
        if not jaw.closed or jaw.goal == 0.0:
            return dc.replace(jaw, settled=True)
        if jaw.asked == 0:
            return dc.replace(jaw, asked=number)
        if answer.answered[hand] != jaw.asked:
            return jaw
        if answer.holding[hand]:
            return dc.replace(jaw, settled=True)
        return dc.replace(jaw, origin=jaw.goal, begin=now, goal=0.0)

    def _status(self, context: Context, output: Value) -> None:
        jaws: _Jaws = state_value(context, self._state)
        answer: PinchAnswer = self._answer.Eval(context)
        right, left = (float(value) for value in self._opening.Eval(context))
        closed = tuple(jaw.closed and jaw.settled for jaw in jaws.pair)
        holding = tuple(c and jaw.goal > 0.0 for c, jaw in zip(closed, jaws.pair, strict=True))
        output.set_value(
            GripperStatus(
                command=jaws.done,
                opening=(right, left),
                closed=(closed[0], closed[1]),
                holding=(holding[0] and answer.holding[0], holding[1] and answer.holding[1]),
            )
        )

    def _pinch(self, context: Context, output: Value) -> None:
        jaws: _Jaws = state_value(context, self._state)
        right, left = jaws.pair
        output.set_value(
            Pinch((right.asked, left.asked), (right.closed, left.closed), self._spoiled(jaws))
        )

    def _spoiled(self, jaws: _Jaws) -> bool:
        return jaws.closings in self._misses

    def _desired(self, context: Context, output: BasicVector) -> None:
        jaws: _Jaws = state_value(context, self._state)
        desired = [jaw.opening(context.get_time(), self._speed) for jaw in jaws.pair]
        output.SetFromVector(np.array(desired).ravel())
