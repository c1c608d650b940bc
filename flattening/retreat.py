"""The way back from a grasp that missed."""

import numpy as np

from unwrinkle.models.errors import InputError
from unwrinkle.planning.plan import Segment
from unwrinkle.planning.trajectory import Trajectory


def reversed_in_time(trajectory: Trajectory) -> Trajectory:
    """The same motion, run backwards.

    Sample k of n is sample n-1-k with its velocity negated, and the times between samples are mirrored. The cubic
    between two samples is fixed by their positions and velocities; so the controller runs the mirrored cubics, and at
    time T - t every axis is where the forward motion has it at t, with the same speed and the same acceleration.
    """
    return Trajectory(
        trajectory.times[-1] - trajectory.times[::-1],
        trajectory.positions[::-1],
        -trajectory.velocities[::-1],
    )


def retreat(approach: Segment) -> Trajectory:
    """The time reversal of a verified approach: from the grasp pose, grippers open, to where the plan started.

    The plan's verdict covers it: the configurations are those of the approach, the grippers are as open as they were
    then, the fingers touch the working table where they did, and bounds on velocity, acceleration and jerk do not ask
    which way time runs. The strokes of the grippers at the grasp pose are covered too: they open by the way that they
    closed.

    Raises:
        InputError: the segment is not run with both grippers open from rest to rest.
    """
    if any(approach.closed):
        raise InputError("only an approach with open grippers can be run backwards")
    ends = np.abs(approach.trajectory.velocities[[0, -1]]).max()
    if ends > 1e-9:
        raise InputError(f"the approach is not from rest to rest ({ends:.3g} rad/s at an end)")
    return reversed_in_time(approach.trajectory)
