"""Show a flattening plan in the browser, as one self-contained page or live.

The cloth is shown as observed; its response to the pull is not simulated.
"""

import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import MeshcatAnimation

from unwrinkle.models.arrays import Array
from unwrinkle.models.io.files import write_text
from unwrinkle.models.robot import Cell
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.verification.verdict import Verdict
from unwrinkle.viewer.overlay import PreviewSummary, page_with_overlay
from unwrinkle.viewer.plan_shapes import ARMS, COLOURS, target_shapes, wrinkle_shapes
from unwrinkle.viewer.playback import Playback, PlaybackStep
from unwrinkle.viewer.scene import CellScene, follow, in_first_view, rgba, start_meshcat
from unwrinkle.viewer.shapes import triad, tube
from unwrinkle.viewer.text_panel import text_panel

#: Frames per second of the animation.
FRAME_RATE = 30.0
#: Maximum number of frames; with it a page is smaller than 10 MB.
MOST_FRAMES = 900

_log = logging.getLogger(__name__)


class PlanScene:
    """A plan's cell, garment, wrinkle, arrows and poses in a Meshcat.

    `show` moves the robot along the plan.
    """

    def __init__(self, plan: FlatteningPlan, cell: Cell, meshcat: Any) -> None:
        """Send all static parts, and the robot at the plan's start.

        Raises:
            InputError: the plan was made for another robot, cell or set of limits.
        """
        plan.check_made_for(cell)
        self.playback = Playback(plan, cell)
        self._scene = CellScene(cell, meshcat)
        self._plan = plan
        self._meshcat = meshcat
        self._draw_garment()
        self._draw_poses()
        self.show(0.0)

    def show(self, time: float) -> None:
        """Move the robot to its posture at a time of the plan, s."""
        self._scene.move(self.playback.positions(time), self.playback.openings(time))
        self._scene.publish(time)

    def record(self) -> None:
        """Publish the whole motion as a repeating animation."""
        times = self.playback.frame_times(FRAME_RATE, MOST_FRAMES)
        rate = (len(times) - 1) / self.playback.duration
        self._meshcat.StartRecording(
            frames_per_second=rate, set_visualizations_while_recording=False
        )
        for t in times:
            self.show(float(t))
        self._meshcat.StopRecording()
        animation = self._meshcat.get_mutable_recording()
        animation.set_loop_mode(MeshcatAnimation.LoopMode.kLoopRepeat)
        animation.set_repetitions(1_000_000)
        self._meshcat.PublishRecording()

    def _mesh(self, path: str, mesh: tuple[Array, NDArray[np.int32]], colour: str) -> None:
        vertices, faces = mesh
        self._meshcat.SetTriangleMesh(f"plan/{path}", vertices.T, faces.T, rgba(colour))

    def _draw_garment(self) -> None:
        garment = self._plan.garment
        if garment is not None:
            self._meshcat.SetTriangleColorMesh(
                "plan/garment",
                garment.p_WV.T.astype(float),
                garment.triangles.T,
                garment.colours.T / 255.0,
            )
        for path, mesh, colour in (*wrinkle_shapes(self._plan), *target_shapes(self._plan)):
            self._mesh(path, mesh, colour)

    def _draw_poses(self) -> None:
        poses = [step for step in self.playback.steps if step.pose]
        for k, step in enumerate(poses):
            self._scene.move(self.playback.positions(step.time), self.playback.openings(step.time))
            for name, choice, X_WT in zip(ARMS, self._plan.arms, self._scene.tips(), strict=True):
                if choice is None:
                    continue
                path = f"plan/poses/{name}/{k + 1} {step.name}"
                vertices, faces, colours = triad(X_WT, 0.035, 0.0016)
                self._meshcat.SetTriangleColorMesh(f"{path}/axes", vertices.T, faces.T, colours.T)
                marker = tube(
                    X_WT[:3, 3] + np.outer([-0.006, 0.0, 0.006], X_WT[:3, 2]),
                    np.array([0.0005, 0.006, 0.0005]),
                )
                self._mesh(path.removeprefix("plan/") + "/mark", marker, COLOURS.poses[k % 7])
        first, last = poses[0].time, poses[-1].time
        tips = []
        for t in np.linspace(first, last, 200):
            self._scene.move(self.playback.positions(t), self.playback.openings(t))
            tips.append(self._scene.tips()[:, :3, 3])
        for i, name in enumerate(ARMS):
            if self._plan.arms[i] is not None:
                line = tube(np.array(tips)[:, i], 0.0012)
                self._mesh(f"tip path/{name}", line, COLOURS.arms[i])


def preview_page(
    plan: FlatteningPlan,
    cell: Cell,
    summary: PreviewSummary,
    *,
    title: str = "",
    at: float | None = None,
) -> str:
    """Build the self-contained page of a plan.

    Args:
        plan: plan to show.
        cell: cell of the plan.
        summary: result of its verification.
        title: name of the capture; may be empty.
        at: time of the plan's clock at which the page opens, paused, s; None to open it playing.

    Returns:
        HTML that needs no other file and makes no request.

    Raises:
        InputError: the plan is for another cell.
    """
    meshcat = start_meshcat()
    scene = PlanScene(plan, cell, meshcat)
    scene.record()
    page = page_with_overlay(
        meshcat.StaticHtml(), plan, scene.playback, summary, COLOURS, title=title, at=at
    )
    _log.info("preview page of plan %s: %.2f MB", plan.content_hash[:12], 1e-6 * len(page))
    return page


def save_preview(
    path: str | Path, plan: FlatteningPlan, verdict: Verdict, cell: Cell, *, title: str = ""
) -> None:
    """Write a self-contained page that shows a plan, its verdict and the motion.

    Args:
        path: HTML file to write.
        plan: plan to show.
        verdict: verdict of the plan.
        cell: cell of the plan.
        title: title of the page; the file's name if left out.

    Raises:
        InputError: the file cannot be written.
    """
    page = preview_page(plan, cell, PreviewSummary.of(verdict), title=title or Path(path).stem)
    write_text(Path(path), page)


class LivePreview:
    """Plan in a live Meshcat.

    It has buttons for the poses, a slider for the time, and the hash and verdict as labels.
    """

    def __init__(
        self, plan: FlatteningPlan, cell: Cell, summary: PreviewSummary, meshcat: Any
    ) -> None:
        """Send the scene and add the controls.

        Raises:
            InputError: the plan is for another cell.
        """
        self._meshcat = meshcat
        self._scene = PlanScene(plan, cell, meshcat)
        self._steps: dict[str, PlaybackStep] = {}
        state = "verified" if summary.passed else "NOT verified"
        self.labels = (
            f"plan {plan.content_hash[:12]}: {state}",
            f"smallest clearance {summary.clearance_text}",
        )
        shade = "#14692d" if summary.passed else "#b71c1c"
        writing = [(part, shade) for text in self.labels for part in text.split(", ", 1)]
        writing.append((f"motion {plan.motion_time:.2f} s; cloth shown as observed", "#3b4654"))
        meshcat.SetObject("plan/text panel", text_panel(writing, 0.36))
        meshcat.SetTransform("plan/text panel", in_first_view(-0.66, 0.58, 3.0))
        for label in self.labels:
            meshcat.AddButton(label)
        meshcat.AddButton("play / pause", "Space")
        self._time = 0.0
        end = self._scene.playback.duration
        meshcat.AddSlider("time (s)", 0.0, end, 0.001, 0.0)
        meshcat.AddSlider("speed", 0.05, 1.0, 0.05, 1.0)
        for step in self._scene.playback.steps:
            name = f"{step.time:.2f} s: {step.name}"
            self._steps[name] = step
            meshcat.AddButton(name)
        self._clicks = {name: 0 for name in (*self._steps, "play / pause")}
        self._playing = True

    def update(self, elapsed: float) -> float:
        """Follow the controls after `elapsed` seconds; return the shown time of the plan, s."""
        if self._clicked("play / pause"):
            self._playing = not self._playing
        time = self._time
        slider = float(self._meshcat.GetSliderValue("time (s)"))
        if abs(slider - time) > 1.5e-3:
            time, self._playing = slider, False
        for name, step in self._steps.items():
            if self._clicked(name):
                time, self._playing = step.time, False
        if self._playing:
            time += elapsed * float(self._meshcat.GetSliderValue("speed"))
            if time > self._scene.playback.duration:
                time = 0.0
        if time != self._time:
            self._time = time
            self._meshcat.SetSliderValue("time (s)", time)
            self._scene.show(time)
        return time

    def run(self, stop: Callable[[], bool] = lambda: False) -> None:
        """Follow the controls until `stop()` is true or Ctrl-C is pressed."""
        follow(self.update, stop, lambda: _log.info("live preview ended"))

    def _clicked(self, name: str) -> bool:
        clicks = int(self._meshcat.GetButtonClicks(name))
        before, self._clicks[name] = self._clicks[name], clicks
        return clicks > before
