"""Limits of the controller's firmware: groups that it does not move, and its speed governor."""

from collections.abc import Sequence

import numpy as np

from unwrinkle.hardware.streaming.stream import GROUP_AXES
from unwrinkle.models.arrays import Array
from unwrinkle.planning.trajectory import Trajectory

#: Largest motion of a group at rest, rad.
STILL_RAD = 1e-6


def unmoved_group(trajectories: Sequence[Trajectory], moved: Sequence[str]) -> str:
    """Return which control group trajectories move although the firmware does not; empty if there
    is none.

    Args:
        trajectories: of all axes, one or more, run one after the other.
        moved: groups that the firmware moves, the site's `groups_moved`.
    """
    for name, axes in GROUP_AXES.items():
        q = np.concatenate([trajectory.positions[:, axes] for trajectory in trajectories])
        way = float(np.ptp(q, axis=0).max())
        if name not in moved and not way <= STILL_RAD:
            hint = (
                "plan with 'turntable: fixed' in the scenario's planner section"
                if name == "ext_axis"
                else "this plan needs a firmware that does"
            )
            return (
                f"{name} is to move by {way:.3f} rad, and this controller's firmware does not move "
                f"it (controller.groups_moved: {', '.join(moved)}); {hint}"
            )
    return ""


def speed_shares(trajectories: Sequence[Trajectory], full_speed: Array) -> Array:
    """Return the greatest share of each axis' full speed at the points of trajectories, (13,).

    Args:
        trajectories: of all axes, one or more.
        full_speed: (13,) rad/s.
    """
    fastest = [np.abs(trajectory.velocities).max(axis=0) for trajectory in trajectories]
    return np.asarray(np.max(fastest, axis=0) / full_speed)
