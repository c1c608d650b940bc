"""Show the cell in a live Meshcat, with sliders for its joints and buttons for its named states."""

import logging
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from pydrake.multibody.meshcat import JointSliders

from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell
from unwrinkle.viewer.overlay import closed_page
from unwrinkle.viewer.scene import ILLUSTRATION, PROXIMITY, WHOLE_CELL, CellScene, look

#: Polling period of the controls, s.
_POLL_PERIOD = 1.0 / 30.0
_TOGGLES = {"show / hide bodies": ILLUSTRATION, "show / hide collision shapes": PROXIMITY}

_log = logging.getLogger(__name__)


class CellView:
    """View of a cell, with its collision shapes in red over its bodies."""

    def __init__(self, cell: Cell, meshcat: Any, *, state: str = "home") -> None:
        """Send the cell, with the robot in a named state.

        Raises:
            InputError: the robot has no such named state, or the cell's models cannot be read.
        """
        states = cell.robot.named_states
        if state not in states:
            raise InputError(f"there is no state {state!r}; the robot has {', '.join(states)}")
        self._states = {name: np.array(axes, dtype=float) for name, axes in states.items()}
        self._meshcat = meshcat
        self._scene = CellScene(cell, meshcat, proximity_visible=True)
        look(meshcat, WHOLE_CELL)
        self._opening = float(cell.scenario.gripper.opening)
        self._q = self._positions(state)
        self._show(self._q)
        self._sliders: Any = None
        self._clicks: dict[str, int] = {}
        self._shown = dict.fromkeys(_TOGGLES.values(), True)

    def page(self) -> str:
        """Return a self-contained page of the cell in the present posture."""
        return closed_page(self._meshcat.StaticHtml(), "The cell")

    def add_controls(self) -> None:
        """Add a slider for each joint and buttons for layers and named states."""
        self._sliders = JointSliders(self._meshcat, self._scene.plant, self._q)
        for name in (*_TOGGLES, *self._states):
            self._meshcat.AddButton(name)
            self._clicks[name] = 0

    def update(self) -> Array:
        """Follow the controls once; return the shown positions of the plant."""
        for name, layer in _TOGGLES.items():
            if self._clicked(name):
                self._shown[layer] = not self._shown[layer]
                self._meshcat.SetProperty(layer, "visible", self._shown[layer])
        for name in self._states:
            if self._clicked(name):
                self._sliders.SetPositions(self._positions(name))
        context = self._sliders.CreateDefaultContext()
        q = np.asarray(self._sliders.get_output_port().Eval(context), dtype=float)
        if not np.array_equal(q, self._q):
            self._q = q
            self._show(q)
        return q

    def run(self, stop: Callable[[], bool] = lambda: False) -> None:
        """Follow the controls until `stop()` is true or Ctrl-C is pressed."""
        try:
            while not stop():
                time.sleep(_POLL_PERIOD)
                self.update()
        except KeyboardInterrupt:
            _log.info("the view of the cell ended")

    def _positions(self, state: str) -> Array:
        self._scene.move(self._states[state], np.full(2, self._opening))
        return self._scene.positions()

    def _show(self, q: Array) -> None:
        self._scene.set_positions(q)
        self._scene.publish()

    def _clicked(self, name: str) -> bool:
        clicks = int(self._meshcat.GetButtonClicks(name))
        before, self._clicks[name] = self._clicks[name], clicks
        return clicks > before
