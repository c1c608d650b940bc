"""Check of a trajectory against the axis limits before it is sent: refused, never clamped."""

from collections.abc import Sequence

import numpy as np

from unwrinkle.models.limits import Limits
from unwrinkle.planning.trajectory import LIMIT_ROUNDING, Trajectory


def trajectory_problem(trajectory: Trajectory, limits: Limits, axes: Sequence[str]) -> str:
    """Return why a trajectory may not be sent, with the exact extremes of its cubics; empty if it
    may.

    Args:
        trajectory: as it would be sent.
        limits: of the axes.
        axes: their names.
    """
    if not trajectory.rests_at_ends:
        return "it does not start and end at rest"
    found = trajectory.extremes()
    for what, value, most, unit in (
        ("position", found.upper, limits.upper, "rad"),
        ("position", -found.lower, -limits.lower, "rad"),
        ("velocity", found.speed, limits.velocity, "rad/s"),
        ("acceleration", found.acceleration, limits.acceleration, "rad/s²"),
        ("jerk", found.jerk, limits.jerk, "rad/s³"),
    ):
        over = value - most - LIMIT_ROUNDING * np.abs(most)
        axis = int(over.argmax())
        if not over[axis] <= 0.0:
            return (
                f"{what} of {axes[axis]} reaches {value[axis]:.4f} {unit}, {over[axis]:.2g} beyond "
                f"its limit {most[axis]:.4f} {unit}"
            )
    return ""
