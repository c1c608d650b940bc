"""Check the robot's posture: limits and clearances, and a move that resolves a problem."""

from dataclasses import dataclass

import numpy as np

from unwrinkle.models.arrays import Array
from unwrinkle.models.robot import Cell
from unwrinkle.planning.verification.clearance import check_clearances
from unwrinkle.planning.verification.motion import Leg
from unwrinkle.planning.verification.verdict import Findings, PairClearance
from unwrinkle.planning.verification.verifier import cell_model

#: Excess over a limit that still counts as on it, rad: the resolution of an encoder.
_LIMIT_TOLERANCE = 1e-3
#: Single-axis moves that are tried as a way out, degrees.
_ESCAPES = (2.0, 5.0, 10.0, 20.0)
#: Maximum loss of clearance on the way out, m.
_CLEARANCE_LOSS = 5e-4


@dataclass(frozen=True)
class PostureCheck:
    """Result of the check of a posture.

    Attributes:
        problems: one sentence for each problem; empty for a good posture.
        margin: smallest distance less its padding, m; infinite if no two bodies are near.
    """

    problems: tuple[str, ...]
    margin: float


def check_posture(cell: Cell, positions: Array, closed: tuple[bool, bool]) -> PostureCheck:
    """Check a posture of the robot at rest.

    Args:
        cell: robot and cell.
        positions: (13,) rad, finite.
        closed: whether the right and the left gripper are closed.
    """
    limits, problems = cell.limits, []
    low, high = limits.lower - _LIMIT_TOLERANCE, limits.upper + _LIMIT_TOLERANCE
    for i in np.flatnonzero((positions < low) | (positions > high)):
        side = "below" if positions[i] < low[i] else "above"
        limit = limits.lower[i] if side == "below" else limits.upper[i]
        problems.append(
            f"{cell.robot.axes[i]} is at {np.degrees(positions[i]):.2f} deg, "
            f"{np.degrees(abs(positions[i] - limit)):.2f} deg {side} its limit "
            f"{np.degrees(limit):.1f} deg"
        )
    found = _clearances(cell, positions, closed)
    return PostureCheck((*problems, *found.problems), found.margin)


def escape(cell: Cell, positions: Array, closed: tuple[bool, bool]) -> str:
    """Suggest the smallest single-axis move that resolves the problems of a posture.

    Nothing is moved.

    Args:
        cell: robot and cell.
        positions: (13,) rad, of a posture with problems.
        closed: whether the right and the left gripper are closed.

    Returns:
        One sentence for the operator.
    """
    limits, axes = cell.limits, cell.robot.axes
    inside = np.clip(positions, limits.lower, limits.upper)
    out = np.flatnonzero(np.abs(inside - positions) > _LIMIT_TOLERANCE)
    if len(out):
        moves = ", ".join(
            f"{axes[i]} by {np.degrees(inside[i] - positions[i]):+.2f} deg" for i in out
        )
        return f"jog the robot back within its limits with the pendant: {moves}"
    begin = _clearances(cell, positions, closed).margin
    for degrees in _ESCAPES:
        best: tuple[float, str] | None = None
        for i in range(len(axes)):
            for sign in (1.0, -1.0):
                way = [_moved(positions, i, sign * degrees * share) for share in (0.5, 1.0)]
                if not limits.lower[i] <= way[-1][i] <= limits.upper[i]:
                    continue
                middle, end = (_clearances(cell, q, closed) for q in way)
                if end.problems or middle.margin < begin - _CLEARANCE_LOSS:
                    continue
                if best is None or end.margin > best[0]:
                    best = (end.margin, f"{axes[i]} by {sign * degrees:+.0f} deg")
        if best is not None:
            return f"jog the robot clear with the pendant, e.g. {best[1]}; nothing moves by itself"
    return (
        f"no move of a single axis by up to {_ESCAPES[-1]:.0f} deg clears the robot: jog it home "
        "with the pendant, watching the nearest bodies"
    )


def _moved(positions: Array, axis: int, degrees: float) -> Array:
    moved = positions.copy()
    moved[axis] += np.radians(degrees)
    return moved


def _clearances(cell: Cell, positions: Array, closed: tuple[bool, bool]) -> PostureCheck:
    """Check the distances of a posture as those of a motion of zero speed."""
    model, found = cell_model(cell), Findings()
    blades = [0.0 if state else cell.scenario.gripper.opening for state in closed]
    rows = np.tile(np.concatenate([positions, blades]), (2, 1))
    leg = Leg("standing", np.array([0.0, 0.01]), rows, np.zeros((2, 15)), False, None)
    report = check_clearances(model, [leg], [model.frames(rows)[0]], (False, False), found)
    margin = min((pair.margin for pair in report.clearances), default=np.inf)
    problems = [
        _too_near(pair) for pair in report.clearances if found.violations and pair.margin < 0.0
    ]
    # A violation without a pair of negative margin must be reported as well.
    problems = problems or [violation.message for violation in found.violations]
    return PostureCheck(tuple(problems), float(margin))


def _too_near(pair: PairClearance) -> str:
    names, distance = " and ".join(pair.bodies), 1e3 * pair.distance
    apart = f"are {distance:.1f} mm apart" if distance >= 0.0 else f"overlap by {-distance:.1f} mm"
    return f"{names} {apart}, at least {1e3 * pair.required:.0f} mm of distance is required"
