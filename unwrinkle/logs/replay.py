"""Replay a run log in the browser: the measured robot, the commanded grippers, and the events."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from unwrinkle.hardware.run_log.reader import LogEvent, RunLogRecords
from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell, load_cell
from unwrinkle.models.scenario import load_scenario
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.viewer.overlay import closed_page
from unwrinkle.viewer.pages import filled_page
from unwrinkle.viewer.plan_shapes import target_shapes, wrinkle_shapes
from unwrinkle.viewer.scene import CellScene, rgba, start_meshcat

#: Frames per second of the animation.
FRAME_RATE = 30.0
#: Maximum number of frames.
MOST_FRAMES = 900
#: Time at rest shown before the first and after the last motion, s.
_MARGIN = 1.0
#: Displacement between two sets of feedback above which the robot counts as moving, rad.
_MOVES = 1e-3
#: Maximum number of listed events.
_MOST_EVENTS = 40


@dataclass(frozen=True, eq=False)
class MeasuredTrack:
    """Measured posture of the robot and commanded openings of the grippers over time.

    Attributes:
        begin: start of the shown part, host's clock, s.
        times: (n,) s after the start, increasing.
        positions: (n, 13) rad.
        openings: (n, 2) m.
    """

    begin: float
    times: Array
    positions: Array
    openings: Array

    @property
    def duration(self) -> float:
        """Return the duration of the shown part, s."""
        return float(self.times[-1])

    def at(self, time: float) -> tuple[Array, Array]:
        """Return axes (13,), rad, and openings (2,), m, at a time after the start, s."""
        axes = [np.interp(time, self.times, column) for column in self.positions.T]
        blades = [np.interp(time, self.times, column) for column in self.openings.T]
        return np.array(axes), np.array(blades)


def measured_track(records: RunLogRecords, cell: Cell) -> MeasuredTrack:
    """Extract the part of a log in which the robot moves, with a margin at rest.

    Raises:
        InputError: the log has fewer than two sets of feedback.
    """
    measured = records.measured
    good = np.asarray(np.isfinite(measured.positions).all(axis=1))
    times, positions = measured.times[good], measured.positions[good]
    increasing = np.concatenate([[True], np.diff(times) > 0.0]) if len(times) else good[:0]
    times, positions = times[increasing], positions[increasing]
    if len(times) < 2:
        raise InputError(
            "the log has fewer than two sets of joint feedback, so there is nothing to show"
        )
    moved = np.flatnonzero(np.abs(np.diff(positions, axis=0)).max(axis=1) > _MOVES)
    first, last = (times[moved[0]], times[moved[-1] + 1]) if len(moved) else (times[0], times[-1])
    shown = (times >= first - _MARGIN) & (times <= last + _MARGIN)
    times, positions = times[shown], positions[shown]
    openings = _openings(records.events, times, cell)
    return MeasuredTrack(float(times[0]), times - times[0], positions, openings)


def _openings(events: tuple[LogEvent, ...], times: Array, cell: Cell) -> Array:
    """Compute the grippers' openings (n, 2), m, from the commands and the blades' speed."""
    opening, speed = float(cell.scenario.gripper.opening), float(cell.limits.gripper.velocity)
    result = np.full((len(times), 2), opening)
    value = np.full(2, opening)
    commands = [e for e in events if e.kind == "gripper" and _closed(e) is not None]
    for index, event in enumerate(commands):
        goal = np.where(np.array(_closed(event)), 0.0, opening)
        later = times >= event.time
        way = speed * np.maximum(times[later] - event.time, 0.0)[:, None]
        result[later] = value + np.clip(goal - value, -way, way)
        if index + 1 < len(commands):
            room = speed * (commands[index + 1].time - event.time)
            value = value + np.clip(goal - value, -room, room)
    return result


def _closed(event: LogEvent) -> list[bool] | None:
    closed = event.data.get("closed")
    return closed if isinstance(closed, list) and len(closed) == 2 else None


def plan_of(records: RunLogRecords) -> FlatteningPlan | None:
    """Load the plan that a log names; None if the file is missing or has changed."""
    path = records.header.get("plan_file")
    if not isinstance(path, str) or not Path(path).is_file():
        return None
    try:
        plan = FlatteningPlan.load(path)
    except InputError:
        return None
    return plan if plan.content_hash == records.header.get("plan_hash") else None


def cell_of(
    records: RunLogRecords, scenario: Path | None = None, settings: Sequence[str] = ()
) -> Cell:
    """Load the cell of a log.

    Args:
        records: records of the log.
        scenario: scenario to use instead; None for the log's own.
        settings: changes of the scenario, e.g. `("gaze=[0, -0.2]",)`.

    Raises:
        InputError: the scenario is missing or wrong.
    """
    own = records.header.get("scenario")
    if scenario is None and isinstance(own, str) and own:
        scenario = Path(own)
    return load_cell(load_scenario(scenario, settings=settings))


def replay_page(
    records: RunLogRecords, cell: Cell, plan: FlatteningPlan | None, *, title: str = ""
) -> str:
    """Build a self-contained page of the measured motion.

    Args:
        records: records of the log.
        cell: cell of the log.
        plan: executed plan, for the garment and the target; None if it is unavailable.
        title: title of the page.

    Raises:
        InputError: the log holds no motion to show.
    """
    track = measured_track(records, cell)
    meshcat = start_meshcat()
    scene = CellScene(cell, meshcat)
    if plan is not None:
        draw_plan(meshcat, plan)
    count = min(max(int(track.duration * FRAME_RATE) + 1, 2), MOST_FRAMES)
    meshcat.StartRecording(
        frames_per_second=(count - 1) / max(track.duration, 1e-3),
        set_visualizations_while_recording=False,
    )
    for time in np.linspace(0.0, track.duration, count):
        scene.move(*track.at(float(time)))
        scene.publish(float(time))
    meshcat.StopRecording()
    meshcat.PublishRecording()
    heading = "Run log" + (f": {title}" if title else "")
    before, body, after = closed_page(meshcat.StaticHtml(), heading).rpartition("</body>")
    return f"{before}{_panel(records, track, heading)}\n{body}{after}"


def draw_plan(meshcat: Any, plan: FlatteningPlan) -> None:
    """Draw the observed garment, the wrinkle and the target under `plan/`."""
    garment = plan.garment
    if garment is not None:
        meshcat.SetTriangleColorMesh(
            "plan/garment",
            garment.p_WV.T.astype(float),
            garment.triangles.T,
            garment.colours.T / 255.0,
        )
    for path, mesh, colour in (*wrinkle_shapes(plan), *target_shapes(plan)):
        meshcat.SetTriangleMesh(f"plan/{path}", mesh[0].T, mesh[1].T, rgba(colour))


def _panel(records: RunLogRecords, track: MeasuredTrack, heading: str) -> str:
    header = records.header
    facts = [
        (
            f"plan {str(header.get('plan_hash', 'unknown'))[:12]} at site "
            f"{header.get('site', 'unknown')}"
        ),
        f"begun {header.get('begun', '')}",
        "the robot is shown as measured, the grippers as commanded",
    ]
    if records.cut:
        facts.append("the log is incomplete: the program ended without closing it")
    rows = [
        (f"{event.time - track.begin:.2f} s", event.kind, event.text)
        for event in records.events[-_MOST_EVENTS:]
    ]
    return filled_page("unwrinkle.logs", "panel.html", title=heading, facts=facts, rows=rows)
