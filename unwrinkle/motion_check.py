"""How well a motion that was carried out kept to its plan: following error, distance of the grippers, clearance."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from unwrinkle.models.robot import Cell
from unwrinkle.planning.kinematics import Kinematics
from unwrinkle.planning.plan import FlatteningPlan, Segment
from unwrinkle.planning.trajectory import Trajectory
from unwrinkle.planning.verification_clearance import check_clearances
from unwrinkle.planning.verification_model import CellModel
from unwrinkle.planning.verification_motion import Leg
from unwrinkle.planning.verification_verdict import MEANT, Findings
from unwrinkle.run_records import MotionRecord, SegmentMark

Array = NDArray[np.float64]

#: The station is not later than this behind its command, s.
MOST_LAG = 0.2


@dataclass(frozen=True)
class MotionFigures:
    """Figures of one action's motion; None where the motion has no such part.

    Attributes:
        following_error: largest distance of an axis from the plan, once each segment's lag is taken away, rad.
        lag: largest of the segments' lags, s.
        grip_distance_error: largest difference of the grippers' distance from the plan's while both pull, m.
        clearance: smallest distance of two bodies that must not touch, along the measured motion, m.
    """

    following_error: float | None = None
    lag: float | None = None
    grip_distance_error: float | None = None
    clearance: float | None = None


class MotionCheck:
    """Compares motions with their plans, in one cell."""

    def __init__(self, cell: Cell) -> None:
        """Build the cell's models (some tenths of a second)."""
        self._kinematics = Kinematics(cell)
        self._model = CellModel(cell)

    def figures(self, motion: MotionRecord, plan: FlatteningPlan) -> MotionFigures:
        """Figures of a motion that carried out a plan, or its approach and the way back."""
        segments = {segment.name: segment for segment in plan.segments}
        errors: list[float] = []
        lags: list[float] = []
        grip = None
        legs = []
        for mark in motion.segments:
            part = _part(motion, mark)
            if part is None:
                continue
            times, q, _ = part
            segment = segments.get(mark.name)
            lag = 0.0
            if segment is not None:
                error, lag = following_error(times - mark.begin, q, segment.trajectory)
                errors.append(error)
                lags.append(lag)
                if mark.name == "pull" and plan.dual:
                    wanted = _at(segment.trajectory, times - mark.begin - lag)
                    grip = float(np.abs(self._distance(q) - self._distance(wanted)).max())
            legs.append(_leg(motion, mark, part, _contact(mark, segment, lag)))
        taking_part = (plan.arms[0] is not None, plan.arms[1] is not None)
        return MotionFigures(
            max(errors, default=None),
            max(lags, default=None),
            grip,
            self._clearance(legs, taking_part) if legs else None,
        )

    def _distance(self, q: Array) -> Array:
        """Between the tool centre points, (n,) m."""
        tips = self._kinematics.tcp_positions(q)
        return np.asarray(np.linalg.norm(tips[..., 0, :] - tips[..., 1, :], axis=-1))

    def _clearance(self, legs: list[Leg], taking_part: tuple[bool, bool]) -> float:
        frames = [self._model.frames(leg.positions)[0] for leg in legs]
        report = check_clearances(self._model, legs, frames, taking_part, Findings())
        pairs = [pair.distance for pair in report.clearances if pair.kind not in MEANT]
        return float(min(pairs, default=report.elsewhere))


def following_error(times: Array, measured: Array, trajectory: Trajectory) -> tuple[float, float]:
    """How far a measured motion is from the one that was commanded, and how late.

    Args:
        times: (n,) since the command, s.
        measured: (n, 13) rad.
        trajectory: that was commanded.

    Returns:
        Largest distance of an axis, rad, with the lag (s) for which that is smallest.
    """

    def error(lag: float) -> float:
        return float(np.abs(measured - _at(trajectory, times - lag)).max())

    # The error has one minimum, but is flat where the motion is over: a coarse grid first.
    coarse = np.linspace(0.0, MOST_LAG, 41)
    best = coarse[int(np.argmin([error(lag) for lag in coarse]))]
    step = coarse[1]
    found = minimize_scalar(
        error,
        bounds=(max(0.0, best - step), best + step),
        method="bounded",
        options={"xatol": 1e-6},
    )
    return min((error(best), float(best)), (float(found.fun), float(found.x)))


def _at(trajectory: Trajectory, times: Array) -> Array:
    return np.asarray(trajectory.interpolant()(np.clip(times, 0.0, trajectory.duration)))


def _part(motion: MotionRecord, mark: SegmentMark) -> tuple[Array, Array, Array] | None:
    """Times, positions and velocities of a part with at least two samples."""
    inside = (motion.times >= mark.begin) & (motion.times <= mark.end)
    inside[1:] &= np.diff(motion.times) > 0.0
    if np.count_nonzero(inside) < 2:
        return None
    return motion.times[inside], motion.measured[inside], motion.velocities[inside]


def _contact(mark: SegmentMark, segment: Segment | None, lag: float) -> tuple[float, float] | None:
    """When fingers may touch the table; a stroke of the grippers, and the way back, may all along."""
    if segment is None:
        return mark.begin, mark.end
    begin, end = segment.contact
    if end <= begin:
        return None
    return mark.begin + lag + begin, max(mark.end, mark.begin + lag + end)


def _leg(
    motion: MotionRecord,
    mark: SegmentMark,
    part: tuple[Array, Array, Array],
    contact: tuple[float, float] | None,
) -> Leg:
    times, q, v = part
    blades = np.column_stack([np.interp(times, motion.times, side) for side in motion.openings.T])
    return Leg(
        mark.name,
        times,
        np.hstack([q, blades]),
        np.hstack([v, np.zeros((len(times), 2))]),
        mark.name == "pull",
        contact,
    )
