"""Whether a trajectory may be sent at all: refused, never clamped."""

from collections.abc import Sequence

import numpy as np

from unwrinkle.hardware.streaming.sent_cubics import extremes
from unwrinkle.models.arrays import Array
from unwrinkle.models.limits import Limits
from unwrinkle.planning.trajectory import Trajectory

_RELATIVE = 1e-6  # of a limit: rounding, no excess
_AT_REST = 1e-6  # velocity at a trajectory's ends, rad/s
_INSIDE = np.linspace(0.0, 1.0, 33)


def trajectory_problem(trajectory: Trajectory, limits: Limits, axes: Sequence[str]) -> str:
    """Why a trajectory may not be sent, cubics between its samples included; empty if it may.

    Args:
        trajectory: as it would be sent.
        limits: of the axes.
        axes: their names.
    """
    if np.abs(trajectory.velocities[[0, -1]]).max() > _AT_REST:
        return "it does not start and end at rest"
    low, high = _range(trajectory)
    speed, acceleration, jerk = extremes(
        trajectory.times, trajectory.positions, trajectory.velocities
    )
    for what, value, most, unit in (
        ("position", high, limits.upper, "rad"),
        ("position", -low, -limits.lower, "rad"),
        ("velocity", speed, limits.velocity, "rad/s"),
        ("acceleration", acceleration, limits.acceleration, "rad/s²"),
        ("jerk", jerk, limits.jerk, "rad/s³"),
    ):
        over = value - most - _RELATIVE * np.abs(most)
        axis = int(over.argmax())
        if not over[axis] <= 0.0:
            return (
                f"{what} of {axes[axis]} reaches {value[axis]:.4f} {unit}, {over[axis]:.2g} beyond its limit "
                f"{most[axis]:.4f} {unit}"
            )
    return ""


def _range(trajectory: Trajectory) -> tuple[Array, Array]:
    """Lowest and highest positions of the cubics, closely."""
    q, v = trajectory.positions, trajectory.velocities
    step = np.diff(trajectory.times)[:, None]
    # Bézier's control points enclose a cubic.
    between = np.concatenate([q[:-1] + step * v[:-1] / 3.0, q[1:] - step * v[1:] / 3.0])
    low, high = q.min(axis=0), q.max(axis=0)
    if (between.min(axis=0) >= low).all() and (between.max(axis=0) <= high).all():
        return low, high
    curve = trajectory.interpolant()
    inside = curve(trajectory.times[:-1, None] + step * _INSIDE)
    return inside.min(axis=(0, 1)), inside.max(axis=(0, 1))
