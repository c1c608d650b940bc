"""Where the robot stands: within its limits, clear of everything, and how to get out where it is not."""

import re
from dataclasses import dataclass

import numpy as np

from unwrinkle.models.arrays import Array
from unwrinkle.models.robot import Cell
from unwrinkle.planning.verification.clearance import check_clearances
from unwrinkle.planning.verification.motion import Leg
from unwrinkle.planning.verification.verdict import Findings
from unwrinkle.planning.verification.verifier import cell_model

#: Beyond a limit by no more than this counts as on it: the resolution of an encoder, rad.
_ON_LIMIT = 1e-3
#: Single-axis moves that are tried as a way out, degrees.
_ESCAPES = (2.0, 5.0, 10.0, 20.0)
#: On the way out nothing may come nearer than it is by more than this, m.
_NEARER = 5e-4
#: A posture has no time.
_TIME = re.compile(r" at \d+\.\d+ s")


@dataclass(frozen=True)
class Posture:
    """What is wrong with a posture.

    Attributes:
        problems: a sentence each; empty for a good one.
        margin: smallest distance over its padding, m; infinite where nothing is near.
    """

    problems: tuple[str, ...]
    margin: float


def check_posture(cell: Cell, positions: Array, closed: tuple[bool, bool]) -> Posture:
    """Check a posture of the robot at rest.

    Args:
        cell: where.
        positions: (13,) rad, finite.
        closed: whether the right and the left gripper are closed.
    """
    limits, problems = cell.limits, []
    low, high = limits.lower - _ON_LIMIT, limits.upper + _ON_LIMIT
    for i in np.flatnonzero((positions < low) | (positions > high)):
        side = "below" if positions[i] < low[i] else "above"
        limit = limits.lower[i] if side == "below" else limits.upper[i]
        problems.append(
            f"{cell.robot.axes[i]} stands at {np.degrees(positions[i]):.2f} deg, "
            f"{np.degrees(abs(positions[i] - limit)):.2f} deg {side} its limit {np.degrees(limit):.1f} deg"
        )
    found = _clearances(cell, positions, closed)
    return Posture((*problems, *found.problems), found.margin)


def escape(cell: Cell, positions: Array, closed: tuple[bool, bool]) -> str:
    """Suggest the smallest move of one axis that makes a posture good; nothing is moved.

    Args:
        cell: where.
        positions: (13,) rad, of a posture with problems.
        closed: whether the right and the left gripper are closed.

    Returns:
        A sentence.
    """
    limits, axes = cell.limits, cell.robot.axes
    inside = np.clip(positions, limits.lower, limits.upper)
    out = np.flatnonzero(np.abs(inside - positions) > _ON_LIMIT)
    if len(out):
        moves = ", ".join(
            f"{axes[i]} by {np.degrees(inside[i] - positions[i]):+.2f} deg" for i in out
        )
        return f"jog it back within its limits with the pendant: {moves}"
    begin = _clearances(cell, positions, closed).margin
    for degrees in _ESCAPES:
        best: tuple[float, str] | None = None
        for i in range(len(axes)):
            for sign in (1.0, -1.0):
                way = [_moved(positions, i, sign * degrees * share) for share in (0.5, 1.0)]
                if not limits.lower[i] <= way[-1][i] <= limits.upper[i]:
                    continue
                middle, end = (_clearances(cell, q, closed) for q in way)
                if end.problems or middle.margin < begin - _NEARER:
                    continue
                if best is None or end.margin > best[0]:
                    best = (end.margin, f"{axes[i]} by {sign * degrees:+.0f} deg")
        if best is not None:
            return f"jog it clear with the pendant, for instance {best[1]}; nothing moves by itself"
    return (
        f"no move of a single axis by up to {_ESCAPES[-1]:.0f} deg clears it: jog it home with the "
        "pendant, in sight of the nearest bodies"
    )


def _moved(positions: Array, axis: int, degrees: float) -> Array:
    moved = positions.copy()
    moved[axis] += np.radians(degrees)
    return moved


def _clearances(cell: Cell, positions: Array, closed: tuple[bool, bool]) -> Posture:
    """Distances of a posture, as of a motion that stands still."""
    model, found = cell_model(cell), Findings()
    blades = [0.0 if state else cell.scenario.gripper.opening for state in closed]
    rows = np.tile(np.concatenate([positions, blades]), (2, 1))
    leg = Leg("standing", np.array([0.0, 0.01]), rows, np.zeros((2, 15)), False, None)
    report = check_clearances(model, [leg], [model.frames(rows)[0]], (False, False), found)
    margin = min((pair.margin for pair in report.clearances), default=np.inf)
    texts = (violation.message for violation in found.violations)
    return Posture(tuple(_TIME.sub("", text) for text in texts), float(margin))
