"""Write a run into its folder while it goes on.

The files of a look are written as they come, its `action.json` last.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unwrinkle.closed_loop.executed_motion import ExecutionCheck
from unwrinkle.closed_loop.motion_check import check_motion
from unwrinkle.closed_loop.run import Seconds
from unwrinkle.closed_loop.station_view import StationView
from unwrinkle.flattening.state import Action, Mode, RunStatus, SupervisorState
from unwrinkle.models.arrays import Array
from unwrinkle.models.robot import Cell
from unwrinkle.perception.target import FlatteningTarget, NoTarget
from unwrinkle.runs.folder import ActionRecord, MotionRecord, RunFolder, SegmentMark

#: Period of the cloth's recording while the arms move, feedback periods.
FRAME_PERIODS = 4
#: Outcomes after which a run can be resumed from the cloth's last state.
COMPLETE = ("done", "missed", "blind", RunStatus.FLAT, RunStatus.STOPPED)
_AT_WORK = (Mode.MOVE, Mode.GRIP, Mode.RETREAT)


@dataclass(frozen=True)
class _Done:
    """An action that has ended; its effect on the cloth is recorded at the next look."""

    action: Action
    seconds: dict[str, float]
    truth: dict[str, float] | None
    check: ExecutionCheck | None


class Recorder:
    """Watcher that fills a run's folder."""

    def __init__(self, folder: RunFolder, cell: Cell) -> None:
        """Write to a folder.

        Args:
            folder: folder of the run.
            cell: cell in which motions are compared with their plans.
        """
        self._folder, self._cell = folder, cell
        self._done: _Done | None = None
        self._truth: dict[str, float] | None = None
        self._actions: list[ActionRecord] = []
        self._motion = _Motion()

    @property
    def actions(self) -> list[ActionRecord]:
        """Return the actions recorded so far, in order."""
        return list(self._actions)

    def update(
        self, before: SupervisorState, now: SupervisorState, station: StationView, seconds: Seconds
    ) -> None:
        """Write what is new; see `run.Watcher`."""
        if Mode.FAULT not in (before.mode, now.mode) and (
            before.mode in _AT_WORK or now.mode in _AT_WORK
        ):
            self._motion.sample(station)
        if now is before:
            return
        if now.mode != before.mode:
            self._event(before, now, station)
        if before.mode == Mode.LOOK and now.mode == Mode.PERCEIVE:
            self._exposed(now, station)
        self._seen(before.action, now.action, now.request.target)
        if before.mode in (Mode.CONFIRM, Mode.APPROVE) and now.mode in _AT_WORK:
            self._confirmed(now)
        if now.finished is not before.finished or now.over:
            self._ended(now, station, seconds)

    def _event(self, before: SupervisorState, now: SupervisorState, station: StationView) -> None:
        text, data = str(now.mode), dict[str, Any]()
        action = now.action
        if now.over:
            text = now.reason
        elif new := action.refusals[len(before.action.refusals) :]:
            refusal = new[-1]
            text = f"no motion for wrinkle {refusal.wrinkle + 1}: {refusal.reason}"
        elif now.mode == Mode.PLAN and action.pull is not None:
            text = f"wrinkle {action.pull.wrinkle.index + 1}, {action.pull.arms}"
        elif now.steps and now.mode in _AT_WORK:
            text = now.steps[0].name
        elif now.mode == Mode.LOOK and now.finished is not None:
            text = f"look {now.finished.look} ended: {now.finished.outcome}"
            data = {"reason": now.finished.reason} if now.finished.reason else {}
        self._folder.event(station.time, now.mode, text, data)

    def _exposed(self, now: SupervisorState, station: StationView) -> None:
        """Record a new look and, with it, the effect of the last action."""
        self._close(station)
        look = self._folder.look(now.head.number - 1)
        left, right = station.pair
        if left.pixels is not None and right.pixels is not None and left.number == now.head.number:
            look.save_pair(left.pixels, right.pixels, left.gaze)
        depth = station.depth
        if depth.capture is not None and depth.number == now.head.number:
            look.save_depth(depth.capture)
        self._truth = station.truth()
        cloth = station.cloth
        if cloth is not None:
            look.save_before(cloth)
        self._motion = _Motion()
        station.forget_motion()

    def _seen(self, before: Action, now: Action, requested: FlatteningTarget | NoTarget) -> None:
        look = self._folder.look(now.look - 1)
        perceived = now.perceived
        target = requested if isinstance(requested, FlatteningTarget) else None
        if perceived is not None and perceived is not before.perceived and perceived.range_map:
            look.save_range_map(perceived.range_map)
        observation = now.observation
        if observation is not None and (
            observation is not before.observation
            or now.pull is not before.pull
            or now.stop is not before.stop
        ):
            look.save_analysis(
                observation,
                target=None if now.pull is None else target,
                wrinkle=None if now.pull is None else now.pull.wrinkle.index,
                stop=now.stop,
            )

    def _confirmed(self, now: SupervisorState) -> None:
        planned, verified = now.action.planned, now.action.verified
        assert planned is not None and planned.result is not None and verified is not None
        plan = planned.result.plan
        assert plan is not None
        self._folder.look(now.action.look - 1).save_plan(plan, verified.verdict)

    def _ended(self, now: SupervisorState, station: StationView, seconds: Seconds) -> None:
        """Record the motion of an action that has ended.

        Its effect is recorded at the next look.
        """
        action = now.action if now.over or now.finished is None else now.finished
        if action.outcome not in COMPLETE:
            self._close(station)  # the run ends here: the action before is complete
            self._motion.save(self._folder, action, station)
            return
        motion = self._motion.save(self._folder, action, station)
        check = None
        planned = action.planned
        if motion is not None and planned is not None and planned.result is not None:
            assert planned.result.plan is not None
            check = check_motion(motion, planned.result.plan, self._cell)
        self._close(station)
        self._done = _Done(action, _stages(action, seconds), self._truth, check)
        if now.over:
            self._close(station)

    def _close(self, station: StationView) -> None:
        """Record the last action with the present state of the cloth: its look is complete."""
        done, self._done = self._done, None
        if done is None:
            return
        look = self._folder.look(done.action.look - 1)
        cloth = station.cloth
        if cloth is not None:
            look.save_after(cloth)
        record = _record(done, station.truth())
        look.save_action(record)
        self._actions.append(record)


class _Motion:
    """Measured motion of one action, sample by sample."""

    def __init__(self) -> None:
        self._rows: list[tuple[float, Array, Array, Array]] = []
        self._frames: list[tuple[float, NDArray[np.float32]]] = []
        self._count = 0

    def sample(self, station: StationView) -> None:
        self._rows.append((station.time, station.positions, station.velocities, station.openings))
        vertices = station.vertices if self._count % FRAME_PERIODS == 0 else None
        if vertices is not None:
            self._frames.append((station.time, vertices.astype(np.float32)))
        self._count += 1

    def save(self, folder: RunFolder, action: Action, station: StationView) -> MotionRecord | None:
        if len(self._rows) < 2:
            return None
        times, q, v, openings = (np.array(column) for column in zip(*self._rows, strict=True))
        reference = _reference(times, q, action)
        logged = station.motion(times[0], times[-1])
        if logged is not None and len(logged.times) > 1:
            times, q, v = logged.times, logged.measured, logged.velocities
            reference, openings = logged.reference, logged.openings
        frames: dict[str, Any] = {}
        if self._frames:
            frames["frame_times"] = np.array([time for time, _ in self._frames])
            frames["cloth_frames"] = np.stack([vertices for _, vertices in self._frames])
        marks = tuple(SegmentMark(step.name, step.sent, step.finished) for step in action.steps)
        record = MotionRecord(times, q, v, reference, openings, marks, **frames)
        folder.look(action.look - 1).save_motion(record)
        return record


def _reference(times: Array, measured: Array, action: Action) -> Array:
    """Return the planned positions of the axes, (N, 13) rad.

    While no segment runs, they are the measured ones.
    """
    reference = measured.copy()
    planned = action.planned
    if planned is None or planned.result is None or planned.result.plan is None:
        return reference
    segments = {segment.name: segment.trajectory for segment in planned.result.plan.segments}
    for step in action.steps:
        trajectory = segments.get(step.name)
        if trajectory is None:
            continue
        inside = (times >= step.sent) & (times <= step.finished)
        since = np.clip(times[inside] - step.sent, 0.0, trajectory.duration)
        reference[inside] = trajectory.interpolant()(since)
    return reference


def _stages(action: Action, seconds: Seconds) -> dict[str, float]:
    """Return the wall-clock time of each stage, s; see `records.STAGES`."""
    perceived, analysed = action.perceived, action.analysed
    return {
        "render": seconds.of(Mode.LOOK),
        "stereo": 0.0 if perceived is None else perceived.seconds,
        "analysis": 0.0 if analysed is None else analysed.seconds,
        "planning": seconds.of(Mode.PLAN),
        "verification": seconds.of(Mode.CONFIRM),
        "motion": seconds.of(*_AT_WORK),
    }


def _record(done: _Done, truth_after: dict[str, float] | None) -> ActionRecord:
    action, check = done.action, done.check
    pulls: dict[str, float] = {}
    clearance = None
    planned, verified = action.planned, action.verified
    if planned is not None and planned.result is not None and planned.result.plan is not None:
        plan = planned.result.plan
        for name, arm in zip(("right", "left"), plan.arms, strict=True):
            if arm is not None:
                pulls[name] = arm.share * plan.target.hands[arm.side].pull_distance
    if verified is not None and verified.verdict is not None:
        smallest = verified.verdict.smallest
        clearance = verified.verdict.elsewhere if smallest is None else smallest.distance
    return ActionRecord(
        index=action.look - 1,
        outcome=action.outcome,
        reason=action.reason,
        wrinkle=None if action.pull is None else action.pull.wrinkle.index,
        arms=tuple(pulls),
        pulls=pulls,
        seconds=done.seconds,
        truth_before=done.truth,
        truth_after=truth_after,
        clearance=clearance,
        clearance_measured=None if check is None else check.clearance,
        following_error=None if check is None else check.error_after_lag,
        grip_distance_error=None if check is None else check.grip_distance_error,
        violations=() if check is None else check.violations,
        memory=action.policy_state.to_json(),
    )
