"""Replay a run in a live Meshcat: a slider for the time, a button for each action."""

import logging
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell
from unwrinkle.report.look_card import ReadLook, look_name
from unwrinkle.report.replay import draw_marks, marks_until
from unwrinkle.report.tracks import LOOK_TIME, Clip, clips_of, posture_at
from unwrinkle.runs.folder import RunFolder
from unwrinkle.runs.look_folder import readable
from unwrinkle.viewer.live_view import LiveView
from unwrinkle.viewer.scene import follow

_TIME = "time (s)"
_SPEED = "speed"
_PLAY = "play / pause"

_log = logging.getLogger(__name__)


class LiveReplay:
    """Replay of a run in a live Meshcat."""

    def __init__(self, run: RunFolder, cell: Cell, meshcat: Any) -> None:
        """Send the scene and add the controls.

        Raises:
            InputError: the run has no look.
        """
        self._looks = [ReadLook.of(folder) for folder in run.looks()]
        if not self._looks:
            raise InputError(f"{run.path}: the run ended before its first look; nothing to replay")
        motions = [(look.folder.index, readable(look.folder.motion)) for look in self._looks]
        self._clips = clips_of(motions)
        mesh = readable(run.cloth)
        faces = np.zeros((0, 3), dtype=np.int32) if mesh is None else mesh[0]
        self._vertices = 0 if mesh is None else len(mesh[1])
        self._meshcat = meshcat
        self._view = LiveView(cell, meshcat, faces)
        self._home = np.array(cell.robot.named_states["home"], dtype=float)
        self._opening = np.full(2, cell.scenario.gripper.opening)
        self._head = np.array([*cell.scenario.gaze, *cell.scenario.gaze])
        self._marks = [draw_marks(meshcat, look) for look in self._looks]
        self._marked: int | None = None
        self._shown: int | None = None
        self.duration = self._clips[-1].end + LOOK_TIME
        meshcat.AddButton(_PLAY, "Space")
        meshcat.AddSlider(_TIME, 0.0, self.duration, 0.001, 0.0)
        meshcat.AddSlider(_SPEED, 0.25, 4.0, 0.25, 1.0)
        self._jumps = {
            f"{look_name(look)}: {clip.begin:.1f} s": clip.begin
            for look, clip in zip(self._looks, self._clips, strict=True)
        }
        for name in self._jumps:
            meshcat.AddButton(name)
        self._clicks = dict.fromkeys((*self._jumps, _PLAY), 0)
        self._time, self._playing = 0.0, True
        self._show(0.0)

    def update(self, elapsed: float) -> float:
        """Follow the controls after `elapsed` seconds; return the shown time, s."""
        if self._clicked(_PLAY):
            self._playing = not self._playing
        time = self._time
        slider = float(self._meshcat.GetSliderValue(_TIME))
        if abs(slider - time) > 1.5e-3:
            time, self._playing = slider, False
        for name, begin in self._jumps.items():
            if self._clicked(name):
                time = begin
        if self._playing:
            time += elapsed * float(self._meshcat.GetSliderValue(_SPEED))
            if time > self.duration:
                time = 0.0
        if time != self._time:
            self._time = time
            self._meshcat.SetSliderValue(_TIME, time)
            self._show(time)
        return time

    def run(self, stop: Callable[[], bool] = lambda: False) -> None:
        """Follow the controls until `stop()` is true or Ctrl-C is pressed."""
        follow(self.update, stop, lambda: _log.info("live replay ended"))

    def _show(self, time: float) -> None:
        k = max(i for i, clip in enumerate(self._clips) if clip.begin <= time or i == 0)
        axes, openings = posture_at(self._clips, time, self._home)
        self._view.update(
            axes,
            self._head,
            self._opening if openings is None else openings,
            self._cloth(k, time),
            force=True,
        )
        if k != self._shown:
            look = self._looks[k]
            self._view.show_look(
                readable(look.folder.left_picture), readable(look.folder.right_picture)
            )
            outcome = "" if look.action is None else f": {look.action.outcome}"
            self._view.status([f"{look_name(look)}{outcome}"])
            self._shown = k
        marked = k if time < marks_until(self._clips[k]) else None
        if marked != self._marked:
            for i, path in enumerate(self._marks):
                self._meshcat.SetProperty(path, "visible", i == marked)
            self._marked = marked

    def _cloth(self, k: int, time: float) -> NDArray[np.float32] | None:
        """Return the cloth's frame at a time in the k-th clip, or the last one before it."""
        for clip in reversed(self._clips[: k + 1]):
            frame = _frame_at(clip, time)
            if frame is not None:
                return frame if len(frame) == self._vertices else None
        return None

    def _clicked(self, name: str) -> bool:
        clicks = int(self._meshcat.GetButtonClicks(name))
        before, self._clicks[name] = self._clicks[name], clicks
        return clicks > before


def _frame_at(clip: Clip, time: float) -> NDArray[np.float32] | None:
    motion = clip.motion
    if motion is None or not len(motion.frame_times):
        return None
    local = motion.begin + time - clip.start
    k = int(np.searchsorted(motion.frame_times, local, side="right")) - 1
    return np.asarray(motion.cloth_frames[max(k, 0)])
