"""Compare a measured motion with its plan: tracking errors, clearances and limits."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar

from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell
from unwrinkle.planning.plan import FlatteningPlan, Segment
from unwrinkle.planning.trajectory import AXES
from unwrinkle.planning.verification.clearance import check_clearances
from unwrinkle.planning.verification.model import CellModel
from unwrinkle.planning.verification.motion import Leg
from unwrinkle.planning.verification.verdict import NEAR_BY_DESIGN, Findings
from unwrinkle.planning.verification.verifier import cell_model

#: Maximum lag that is identified, s.
LONGEST_LAG = 0.100
#: Step of the coarse search for the lag, s.
LAG_STEP = 0.004
#: Share by which a measured axis may exceed a limit, to allow for errors of measurement.
TOLERANCE = 0.01


@dataclass(frozen=True, eq=False)
class MeasuredSegment:
    """One segment of a plan as executed, on its own clock.

    Attributes:
        name: name of the plan's segment.
        times: (n,) s, increasing; 0 is the segment's start.
        positions: (n, 13) measured, rad.
        velocities: (n, 13) measured, rad/s.
        reference: (n, 13) reference positions of the controller at these times, rad.
        openings: (n, 2) measured openings of the grippers, m.

    Raises:
        InputError: shapes disagree, time does not increase, or a value is not finite.
    """

    name: str
    times: Array
    positions: Array
    velocities: Array
    reference: Array
    openings: Array

    def __post_init__(self) -> None:
        """Check the arrays."""
        count = len(self.times)
        columns = {"positions": AXES, "velocities": AXES, "reference": AXES, "openings": 2}
        for name, width in columns.items():
            value = getattr(self, name)
            if value.shape != (count, width) or not np.isfinite(value).all():
                raise InputError(
                    f"measured {self.name}: {name} {value.shape} must be ({count}, {width}), finite"
                )
        if count < 2 or not np.isfinite(self.times).all() or np.any(np.diff(self.times) <= 0.0):
            raise InputError(
                f"measured {self.name}: at least two increasing, finite times are needed, got "
                f"{count}"
            )


@dataclass(frozen=True)
class ExecutionCheck:
    """Deviation of a motion from its plan.

    Attributes:
        lag: largest lag of a segment behind its reference, s; one value for all axes.
        error: largest difference at the same time, rad.
        error_after_lag: largest difference after each segment's lag is removed, rad.
        worst_axis: axis of that difference.
        grip_distance_error: largest difference between the measured and the planned distance of the
            grippers, at the same place of the path while both hold cloth, m; 0 if they never do.
        clearance: smallest distance between bodies that must not touch, m; None if none came near.
        clearance_pair: names of these bodies.
        violations: violated limits of position and velocity, and violated clearances.
    """

    lag: float
    error: float
    error_after_lag: float
    worst_axis: str
    grip_distance_error: float
    clearance: float | None
    clearance_pair: tuple[str, str] | None
    violations: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """Return plain numbers and strings."""
        return asdict(self)


def check_execution(
    plan: FlatteningPlan, cell: Cell, measured: Sequence[MeasuredSegment]
) -> ExecutionCheck:
    """Compare a measured motion with its plan.

    Args:
        plan: plan that was executed.
        cell: robot and cell.
        measured: executed segments; a segment that is not in the plan (a retreat) is checked for
            clearances and limits, and for its tracking.

    Raises:
        InputError: nothing was measured.
    """
    if not measured:
        raise InputError("there is no measured motion to check")
    lags, each = zip(*map(_following, measured), strict=True)
    errors = np.max(each, axis=0)
    same_time = max(float(np.abs(m.positions - m.reference).max()) for m in measured)
    axis = int(np.argmax(errors))
    model = cell_model(cell)
    planned = {segment.name: segment for segment in plan.segments}
    legs = [_leg(m, planned.get(m.name)) for m in measured]
    frames = [model.frames(leg.positions) for leg in legs]
    found = Findings()
    taking_part = (plan.arms[0] is not None, plan.arms[1] is not None)
    report = check_clearances(model, legs, [X for X, _ in frames], taking_part, found)
    near = [pair for pair in report.clearances if pair.kind not in NEAR_BY_DESIGN]
    smallest = min(near, key=lambda pair: pair.distance, default=None)
    grip = 0.0
    if plan.dual:
        for m, lag, (_, X_WT) in zip(measured, lags, frames, strict=True):
            segment = planned.get(m.name)
            if segment is not None and all(segment.closed):
                grip = max(grip, _grip_distance_error(model, m, X_WT, lag))
    violations = [violation.message for violation in found.violations]
    violations += _limit_violations(cell, measured)
    return ExecutionCheck(
        lag=max(lags),
        error=same_time,
        error_after_lag=float(errors[axis]),
        worst_axis=cell.robot.axes[axis],
        grip_distance_error=grip,
        clearance=None if smallest is None else smallest.distance,
        clearance_pair=None if smallest is None else smallest.bodies,
        violations=tuple(violations),
    )


def _following(m: MeasuredSegment) -> tuple[float, Array]:
    """Return the lag that minimises a segment's error, s, and the errors left (13,), rad."""
    asked = CubicSpline(m.times, m.reference)

    def errors(lag: float) -> Array:
        late = np.clip(m.times - lag, m.times[0], m.times[-1])
        return np.asarray(np.abs(m.positions - asked(late)).max(axis=0))

    def worst(lag: float) -> float:
        return float(errors(lag).max())

    # The error has one minimum, but is constant where the motion is over: search a coarse grid
    # first.
    grid = np.arange(0.0, LONGEST_LAG, LAG_STEP)
    best = float(min(grid, key=worst))
    bounds = (max(0.0, best - LAG_STEP), best + LAG_STEP)
    found = minimize_scalar(worst, bounds=bounds, method="bounded", options={"xatol": 1e-6})
    lag = float(found.x) if found.fun < worst(best) else best
    return lag, errors(lag)


def _leg(m: MeasuredSegment, segment: Segment | None) -> Leg:
    """Convert a measured segment to a leg of the verification, with the plan's contact window."""
    contact = None
    if segment is not None and segment.contact[1] > segment.contact[0]:
        begin, end = segment.contact
        # The arms lag behind, and stay in contact after the end of a segment that ends in contact.
        ends = end >= segment.trajectory.duration - 1e-6
        contact = (begin, float(m.times[-1]) if ends else end + LONGEST_LAG)
    elif segment is None:
        contact = (float(m.times[0]), float(m.times[-1]))
    return Leg(
        m.name,
        m.times,
        np.hstack([m.positions, m.openings]),
        np.hstack([m.velocities, np.gradient(m.openings, m.times, axis=0)]),
        segment is not None and any(segment.closed),
        contact,
    )


def _grip_distance_error(model: CellModel, m: MeasuredSegment, X_WT: Array, lag: float) -> float:
    """Return the largest error of the grippers' distance, with the lag removed, m."""
    late = np.clip(m.times - lag, m.times[0], m.times[-1])
    asked = np.hstack([CubicSpline(m.times, m.reference)(late), m.openings])
    _, X_WT_asked = model.frames(asked)
    distances = [
        np.linalg.norm(X[:, 0, :3, 3] - X[:, 1, :3, 3], axis=1) for X in (X_WT, X_WT_asked)
    ]
    return float(np.abs(distances[0] - distances[1]).max())


def _limit_violations(cell: Cell, measured: Sequence[MeasuredSegment]) -> list[str]:
    limits, axes = cell.limits, cell.robot.axes
    room = TOLERANCE * (limits.upper - limits.lower)
    violations = []
    for m in measured:
        low, high = m.positions.min(axis=0), m.positions.max(axis=0)
        for i in np.flatnonzero((low < limits.lower - room) | (high > limits.upper + room)):
            violations.append(
                f"{m.name}: {axes[i]} moved between {low[i]:.4f} and {high[i]:.4f} rad, its limits "
                f"are {limits.lower[i]:.4f} and {limits.upper[i]:.4f} rad"
            )
        fastest = np.abs(m.velocities).max(axis=0)
        for i in np.flatnonzero(fastest > (1.0 + TOLERANCE) * limits.velocity):
            violations.append(
                f"{m.name}: {axes[i]} moved at {fastest[i]:.3f} rad/s, its limit is "
                f"{limits.velocity[i]:.3f} rad/s"
            )
    return violations
