"""From a motion to samples: timing of its pieces and transits, segments and gripper events on one
clock.
"""

from itertools import pairwise

import numpy as np

from unwrinkle.models.arrays import Array
from unwrinkle.models.robot import Cell
from unwrinkle.models.scenario import Smoothing
from unwrinkle.planning.plan import GripperEvent, PoseMark, Segment
from unwrinkle.planning.robot.kinematics import Kinematics
from unwrinkle.planning.search.key_poses import PIECES, POSES
from unwrinkle.planning.search.motion_search import SevenPoseMotion
from unwrinkle.planning.search.settings import PlannerSettings
from unwrinkle.planning.search.transit import Transit
from unwrinkle.planning.sent_samples import MILLISECONDS, whole_millisecond, whole_milliseconds
from unwrinkle.planning.timing.joint_path import JointPath, PathLimits, TimedPath
from unwrinkle.planning.timing.path_timing import time_paths
from unwrinkle.planning.timing.sampling import Samples, sample_within, sampling_period
from unwrinkle.planning.timing.straight_lines import time_line
from unwrinkle.planning.timing.toppra_profile import (
    PathTimingError,
    deciding_limit,
    time_optimal_profile,
)
from unwrinkle.planning.trajectory import Trajectory

#: Wait after the grippers' stroke: their controller reports "closed" early by about this, s.
_SETTLE = 0.25


class MotionTiming:
    """Times motions under one cell's limits."""

    def __init__(self, cell: Cell, settings: PlannerSettings, kinematics: Kinematics) -> None:
        """Use the cell's limits, less the settings' margin, and the scenario's smoothing."""
        self._limits, self._settings, self._kinematics = cell.limits, settings, kinematics
        self._axes = cell.robot.axes
        self._smoothing = Smoothing(cell.scenario.timing.smoothing)
        self._period = sampling_period(settings.sample_time, cell.scenario.speed)

    def pieces(self, motion: SevenPoseMotion) -> list[TimedPath]:
        """The motion's three pieces, each from rest to rest; the tools' speed is capped where they
        hold cloth.

        Raises:
            PathTimingError: a piece cannot be timed, or takes longer than the settings allow; it
                names the axis and the place.
        """
        limits, keep = self._limits, 1.0 - self._settings.margin
        paths, bounds = [], []
        for (name, _, _), points in zip(PIECES, motion.paths, strict=True):
            holding = name == "pull"
            tips = self._kinematics.tcp_positions(points) if holding else None
            paths.append(JointPath.through(points, tips))
            bounds.append(
                PathLimits(
                    keep * limits.velocity,
                    keep * limits.acceleration,
                    keep * limits.jerk,
                    keep * limits.tip_speed_holding if holding else None,
                )
            )
        try:
            timed = time_paths(paths, bounds, self._smoothing)
            for i, piece in enumerate(timed):
                if not piece.duration <= self._settings.longest:
                    raise self._too_long(piece, bounds[i], i)
        except PathTimingError as error:
            raise error.named(PIECES[error.path][0], self._axes) from error
        return timed

    def _too_long(self, piece: TimedPath, bounds: PathLimits, index: int) -> PathTimingError:
        """The error of a piece that takes longer than the settings allow, with the limit that
        decides its time.
        """
        limit = deciding_limit(piece.path, bounds, time_optimal_profile(piece.path, bounds))
        return PathTimingError(
            limit,
            f"makes it take {piece.duration:.3g} s, at most {self._settings.longest:.3g} s are "
            "allowed; check the limits and the speed",
            index,
        )

    def segments(
        self, motion: SevenPoseMotion, pieces: list[TimedPath], ways: tuple[Transit, Transit]
    ) -> tuple[tuple[Segment, ...], tuple[GripperEvent, ...]]:
        """The motion as samples between gripper events, on one clock, all of it on whole
        milliseconds.

        Args:
            motion: what was searched.
            pieces: its timed pieces.
            ways: from the start to the plan pose, and from the leave pose to home.

        Raises:
            NoVerifiedPlanError: a transit takes longer than the settings allow, or rounding alone
                breaks the limits.
        """
        gripper = self._limits.gripper
        shortest = gripper.stroke / gripper.velocity + _SETTLE
        dwell = float(np.ceil(MILLISECONDS * shortest - 1e-6)) / MILLISECONDS
        taking_part = (motion.hands[0] is not None, motion.hands[1] is not None)
        opened = (False, False)
        there, back = (self._line_samples(way) for way in ways)
        samples = [
            _held(points, sample_within(piece, self._period, self._limits))
            for points, piece in zip(motion.paths, pieces, strict=True)
        ]
        joined = [_joined([there, samples[0]]), samples[1], _joined([samples[2], back])]
        segments: list[Segment] = []
        events: list[GripperEvent] = []
        clock = 0.0
        for i, (name, _, _) in enumerate(PIECES):
            begin = float(there[0][-1]) if i == 0 else 0.0
            end = whole_millisecond(begin + float(samples[i][0][-1]))
            marks = _marks(motion, i, samples[i], begin)
            state = taking_part if name == "pull" else opened
            trajectory = Trajectory(*joined[i])
            segments.append(Segment(name, clock, trajectory, state, marks, (begin, end)))
            clock = whole_millisecond(clock + trajectory.duration)
            if i + 1 < len(PIECES):
                events.append(GripperEvent(clock, taking_part if i == 0 else opened, dwell))
                clock = whole_millisecond(clock + dwell)
        return tuple(segments), tuple(events)

    def _line_samples(self, way: Transit) -> Samples:
        """Straight joint lines with a stop at every corner."""
        margin, period = self._settings.margin, self._period
        longest = self._settings.longest
        lines = [
            time_line(a, b, self._limits, margin, period, longest) for a, b in pairwise(way.points)
        ]
        return _joined([(t, q, v) for t, q, v, _ in lines])


def _held(points: Array, samples: Samples) -> Samples:
    """Samples in which the axes that a path holds still are still, without the rounding of its
    spline.
    """
    t, q, v = samples
    still = np.all(points == points[0], axis=0)
    q[:, still], v[:, still] = points[0, still], 0.0
    return t, q, v


def _marks(
    motion: SevenPoseMotion, piece: int, samples: Samples, begin: float
) -> tuple[PoseMark, ...]:
    """When a piece passes its poses; the middle one where the arms come nearest to it."""
    t, q, _ = samples
    middle = motion.paths[piece][motion.corner_index[piece]]
    nearest = int(np.linalg.norm(q - middle, axis=1).argmin())
    _, first, last = PIECES[piece]
    times = (0.0, float(t[nearest]), float(t[-1]))
    marks = [
        PoseMark(n, whole_millisecond(begin + x))
        for n, x in zip(POSES[first : last + 1], times, strict=True)
    ]
    return tuple(
        marks if piece == 0 else marks[1:]
    )  # later pieces begin where the one before ended


def _joined(parts: list[Samples]) -> Samples:
    """Samples one after the other; each part starts where the one before rests."""
    times, positions, velocities = ([x] for x in parts[0])
    for t, q, v in parts[1:]:
        times.append(t[1:] + times[-1][-1])
        positions.append(q[1:])
        velocities.append(v[1:])
    return (
        whole_milliseconds(np.concatenate(times)),
        np.concatenate(positions),
        np.concatenate(velocities),
    )
