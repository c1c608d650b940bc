"""Live page of an execution.

It shows the measured robot in the browser, with buttons to hold, resume and stop.
"""

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
from unwrinkle.viewer.text_panel import text_panel

#: Update period, s; each update takes some milliseconds of the thread that the driver shares.
PERIOD = 0.1
_BUTTONS = ((HOLD, "KeyH"), (RESUME, "KeyR"), (STOP, "KeyS"))
_SHADE = "#3b4654"


class ExecutionPage:
    """Page that follows the robot.

    Attributes:
        closed: whether the page was open in a browser and is no longer.
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
            plan: plan that is executed.
            cell: robot and cell.
            meshcat: Meshcat to show it in.
            feedback: function that returns the robot's last feedback.
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
        """Return the shown positions of the axes (13,), rad."""
        return self._scene.positions()[self._scene.indices.axes]

    def update(self, now: float, text: str) -> Sequence[Instruction]:
        """Show the robot's posture, at most once per `PERIOD`.

        Args:
            now: time of any monotonic clock, s.
            text: activity of the execution.

        Returns:
            Instructions of the buttons since the last call.
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
            self._meshcat.SetObject("execution", text_panel([(text, _SHADE)], 0.10))
            self._meshcat.SetTransform("execution", in_first_view(-0.66, 0.58, 3.0))
        instructions = []
        for name in self._clicks:
            clicks = int(self._meshcat.GetButtonClicks(name))
            if clicks > self._clicks[name]:
                instructions.append(Instruction(name))
            self._clicks[name] = clicks
        return instructions
