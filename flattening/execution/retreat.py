"""Retreat from a missed grasp: the time reversal of the verified approach."""

import numpy as np

from unwrinkle.models.errors import InputError
from unwrinkle.planning.plan import Segment
from unwrinkle.planning.trajectory import Trajectory


def reversed_in_time(trajectory: Trajectory) -> Trajectory:
    """Return the motion reversed in time.

    Sample k of n is sample n-1-k with its velocity negated, and the times between samples are
    mirrored. The cubic between two samples is fixed by their positions and velocities; so the
    controller runs the mirrored cubics, and at time T - t every axis is where the forward motion
    has it at t, with the same speed and the same acceleration.
    """
    return Trajectory(
        trajectory.times[-1] - trajectory.times[::-1],
        trajectory.positions[::-1],
        -trajectory.velocities[::-1],
    )


def retreat(approach: Segment) -> Trajectory:
    """Return the time reversal of a verified approach: from the grasp pose, with open grippers, to
    the start of the plan.

    The plan's verdict covers it: the configurations are those of the approach, with the same
    opening of the grippers and the same contacts of the fingers with the table, and bounds on
    velocity, acceleration and jerk are the same in both directions of time. The strokes of the
    grippers at the grasp pose are covered too: they open as they closed.

    Raises:
        InputError: the segment does not run from rest to rest with both grippers open.
    """
    if any(approach.closed):
        raise InputError("only an approach with open grippers can be run backwards")
    ends = np.abs(approach.trajectory.velocities[[0, -1]]).max()
    if ends > 1e-9:
        raise InputError(f"the approach is not from rest to rest ({ends:.3g} rad/s at an end)")
    return reversed_in_time(approach.trajectory)
