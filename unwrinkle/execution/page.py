"""The robot as it is measured, live in the browser while a plan is executed, with buttons to hold, resume and stop."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from unwrinkle.execution.controls import HOLD, RESUME, STOP, Instruction
from unwrinkle.hardware.controller_state import JointFeedback
from unwrinkle.logs.replay import draw_plan
from unwrinkle.models.arrays import Array
from unwrinkle.models.robot import Cell
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.viewer.scene import CellScene, in_first_view
from unwrinkle.viewer.text_panel import board

#: s between two pictures; each takes some milliseconds, of which the driver has none to spare.
PERIOD = 0.1
_BUTTONS = ((HOLD, "KeyH"), (RESUME, "KeyR"), (STOP, "KeyS"))
_SHADE = "#3b4654"


class ExecutionPage:
    """A page that follows the robot.

    Attributes:
        closed: whether it was open in a browser, and is no more.
    """

    def __init__(
        self,
        plan: FlatteningPlan,
        cell: Cell,
        meshcat: Any,
        feedback: Callable[[], JointFeedback | None],
    ) -> None:
        """Send the scene and the buttons.

        Args:
            plan: that is executed.
            cell: where.
            meshcat: to show it in.
            feedback: asks for the last of the robot.
        """
        self._meshcat, self._feedback = meshcat, feedback
        self._scene = CellScene(cell, meshcat)
        self._openings = np.full(2, cell.scenario.gripper.opening)
        draw_plan(meshcat, plan)
        for name, key in _BUTTONS:
            meshcat.AddButton(name, key)
        self._clicks = {name: 0 for name, _ in _BUTTONS}
        self._shown_at = -np.inf
        self._opened = False
        self._text = ""
        self.closed = False

    @property
    def positions(self) -> Array:
        """Of the thirteen axes as they are shown, rad."""
        return self._scene.positions()[self._scene.indices.axes]

    def update(self, now: float, text: str) -> Sequence[Instruction]:
        """Show where the robot is, some times a second.

        Args:
            now: any monotonic clock, s.
            text: what the execution does.

        Returns:
            What was said by the buttons since the last time.
        """
        if now - self._shown_at < PERIOD:
            return ()
        self._shown_at = now
        viewers = int(self._meshcat.GetNumActiveConnections())
        self._opened |= viewers > 0
        self.closed = self._opened and viewers == 0
        feedback = self._feedback()
        if feedback is not None and np.isfinite(feedback.positions).all():
            self._scene.move(feedback.positions, self._openings)
            self._scene.publish()
        if text != self._text:
            self._text = text
            self._meshcat.SetObject("execution", board([(text, _SHADE)], 0.10))
            self._meshcat.SetTransform("execution", in_first_view(-0.66, 0.58, 3.0))
        said = []
        for name in self._clicks:
            clicks = int(self._meshcat.GetButtonClicks(name))
            if clicks > self._clicks[name]:
                said.append(Instruction(name))
            self._clicks[name] = clicks
        return said
