"""Drake system of the simulated cloth.

Its outputs are the state, advanced with the tools that hold the cloth, and its measures.
"""

import dataclasses as dc
from typing import Any

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import BasicVector, Context, EventStatus, LeafSystem, State

from unwrinkle.models.arrays import Array
from unwrinkle.simulation.cloth.cloth import Cloth, ClothState
from unwrinkle.simulation.cloth.measures import coverage, largest_height
from unwrinkle.systems.abstract_state import set_state_value, state_value
from unwrinkle.systems.station.grippers import Pinch, PinchAnswer


class ClothSystem(LeafSystem):
    """Advance the cloth on its table.

    While it is asleep and no tool touches it, its state stays the same object.

    Inputs: `tips` (32,), measured X_WT (2, 4, 4) of both tools; `pinch` (`Pinch`) of the grippers.
    Outputs: `cloth` (`ClothState`), `answer` (`PinchAnswer`), `coverage` and `height` (1,); the
    last two are computed on demand.
    """

    def __init__(self, cloth: Cloth, state: ClothState, *, period: float) -> None:
        """Start with a state; `period` is that of the coupling to the tools, s."""
        super().__init__()
        self.set_name("cloth")
        self._cloth, self._period = cloth, period
        self._tips = self.DeclareVectorInputPort("tips", BasicVector(32))
        self._pinch = self.DeclareAbstractInputPort("pinch", Value(Pinch()))
        self._state = self.DeclareAbstractState(Value(state))
        self._answer = self.DeclareAbstractState(Value(PinchAnswer()))
        tickets = {self.abstract_state_ticket(self._state)}
        self.DeclareAbstractOutputPort(
            "cloth",
            lambda: Value(state),
            lambda context, output: output.set_value(state_value(context, self._state)),
            tickets,
        )
        self.DeclareAbstractOutputPort(
            "answer",
            lambda: Value(PinchAnswer()),
            lambda context, output: output.set_value(state_value(context, self._answer)),
            {self.abstract_state_ticket(self._answer)},
        )
        for name, measure in (("coverage", coverage), ("height", largest_height)):
            self.DeclareVectorOutputPort(name, BasicVector(1), self._measured(measure), tickets)
        # The measured tool poses are those at the end of a step, so the first step of the cloth
        # ends one period later.
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, period, self._advance)

    def _advance(self, context: Context, state: State) -> EventStatus:
        cloth: ClothState = state_value(context, self._state)
        answer: PinchAnswer = state_value(context, self._answer)
        pinch: Pinch = self._pinch.Eval(context)
        for hand in range(2):
            if cloth.grips[hand] is not None and not pinch.closed[hand]:
                cloth = self._cloth.release(cloth, hand)
        grips = any(grip is not None for grip in cloth.grips)
        new = [pinch.asked[hand] > answer.answered[hand] for hand in range(2)]
        if cloth.asleep and not grips and not any(new):
            return EventStatus.DidNothing()
        # While the cloth is asleep its own time does not advance.
        cloth = dc.replace(cloth, time=context.get_time() - self._period)
        tips: list[Array | None] = [None, None]
        if grips or any(new):
            tips = list(np.reshape(self._tips.Eval(context), (2, 4, 4)))
        cloth = self._cloth.advance(cloth, self._period, (tips[0], tips[1]))
        for hand in range(2):
            if new[hand]:
                X_WT = tips[hand]
                assert X_WT is not None
                if not pinch.spoiled:
                    cloth = self._cloth.grip(cloth, hand, X_WT)
                answer = _answered(answer, hand, pinch.asked[hand], cloth.grips[hand] is not None)
        set_state_value(state, self._state, cloth)
        set_state_value(state, self._answer, answer)
        return EventStatus.Succeeded()

    def _measured(self, measure: Any) -> Any:
        last: list[Any] = [None, 0.0]  # state of the last measurement, and its value

        def calc(context: Context, output: BasicVector) -> None:
            state = state_value(context, self._state)
            if state is not last[0]:
                last[:] = state, float(measure(self._cloth, state))
            output.SetFromVector([last[1]])

        return calc


def _answered(answer: PinchAnswer, hand: int, number: int, holding: bool) -> PinchAnswer:
    numbers, held_now = list(answer.answered), list(answer.holding)
    numbers[hand], held_now[hand] = number, holding
    return PinchAnswer((numbers[0], numbers[1]), (held_now[0], held_now[1]))
