"""Show a run live in Meshcat."""

from typing import Any

from unwrinkle.closed_loop.progress import DOING
from unwrinkle.closed_loop.run import Seconds
from unwrinkle.closed_loop.setup import Loop
from unwrinkle.closed_loop.station_view import StationView
from unwrinkle.flattening.state import Mode, SupervisorState
from unwrinkle.viewer.live_view import LiveView

#: Update period of the scene while something moves, feedback periods.
FRAME_PERIODS = 2
_STILL = (Mode.PERCEIVE, Mode.DECIDE, Mode.PLAN, Mode.CONFIRM)


class LiveWatcher:
    """Watcher that shows robot, cloth, pictures, wrinkles and the plan.

    Attributes:
        closed: whether the page was open in a browser and is no longer.
    """

    def __init__(self, loop: Loop, meshcat: Any) -> None:
        """Send the cell to a Meshcat."""
        triangles = None if loop.station.cloth is None else loop.station.cloth.triangles
        self._view = LiveView(loop.station.cell, meshcat, triangles)
        self._periods = 0
        self._meshcat, self._opened = meshcat, False
        self.closed = False

    def update(
        self, before: SupervisorState, now: SupervisorState, station: StationView, seconds: Seconds
    ) -> None:
        """Show what is new; see `run.Watcher`."""
        self._periods += 1
        viewers = int(self._meshcat.GetNumActiveConnections())
        self._opened |= viewers > 0
        self.closed = self._opened and viewers == 0
        moving = now.mode not in _STILL and self._periods % FRAME_PERIODS == 0
        if moving or now.mode != before.mode:
            self._view.update(
                station.positions,
                station.head,
                station.openings,
                station.vertices,
                force=now.mode != before.mode,
            )
        if now is before:
            return
        if before.mode == Mode.LOOK and now.mode == Mode.PERCEIVE:
            left, right = station.pair
            if left.pixels is not None and right.pixels is not None:
                self._view.show_look(left.pixels, right.pixels)
            self._view.show_analysis(None)
            self._view.show_plan(None)
        action, planned = now.action, now.action.planned
        observation, pull = action.observation, action.pull
        if observation is not None and (
            observation is not before.action.observation or pull is not before.action.pull
        ):
            chosen = None if pull is None else pull.wrinkle.index
            self._view.show_analysis(observation.analysis, chosen)
        if planned is not None and planned is not before.action.planned:
            self._view.show_plan(None if planned.result is None else planned.result.plan)
        if now.mode != before.mode:
            self._view.status(_status(now, station))


def _status(now: SupervisorState, station: StationView) -> list[str]:
    doing = now.reason if now.over else DOING.get(now.mode, now.mode)
    lines = [f"look {now.action.look}, {now.policy_state.actions} actions", doing]
    truth = station.truth()
    if truth is not None:
        lines.append(
            f"true coverage {truth['coverage']:.1%}, true height {1e3 * truth['height']:.1f} mm"
        )
    return lines
