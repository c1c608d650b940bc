"""The problem that toppra solves: a path in scaled axes, with bounds on speed and acceleration."""

import logging

import numpy as np
import toppra
import toppra.algorithm
import toppra.constraint

from unwrinkle.models.arrays import Array
from unwrinkle.planning.timing.joint_path import JointPath

# What toppra logs as warnings is raised by the caller as an error.
logging.getLogger("toppra").setLevel(logging.ERROR)


def controllable_profile(
    path: JointPath, scale: Array, cap: Array, s: Array
) -> tuple[Array | None, Array]:
    """Find the fastest ds/dt at the grid points, from rest to rest.

    Args:
        path: the path.
        scale: (n,) of the axes; the scaled axes' acceleration is at most 1.
        cap: (N+1,) upper bounds on ds/dt.
        s: (N+1,) grid points, from 0 to 1.

    Returns:
        ds/dt (N+1,), None if there is none; and the controllable range (N+1, 2) of its square.
    """
    bound = np.ones(len(scale))
    problem = toppra.algorithm.TOPPRA(
        [
            toppra.constraint.JointAccelerationConstraint(
                np.column_stack([-bound, bound]),
                discretization_scheme=toppra.constraint.DiscretizationType.Interpolation,
            ),
            _SpeedBound(cap, len(bound)),
        ],
        _ScaledPath(path, scale),
        gridpoints=s,
        solver_wrapper="seidel",
        parametrizer="ParametrizeConstAccel",
    )
    _, speed, _, controllable = problem.compute_parameterization(0.0, 0.0, return_data=True)
    return speed, controllable


class _ScaledPath(toppra.interpolator.AbstractGeometricPath):
    """A path as toppra reads it, each axis divided by a scale (n,)."""

    def __init__(self, path: JointPath, scale: Array) -> None:
        self._path, self._scale = path, scale

    def __call__(self, path_positions, order=0):  # type: ignore[no-untyped-def]
        return self._path.spline(path_positions, nu=order) / self._scale

    @property
    def dof(self) -> int:
        return int(self._path.spline.c.shape[1])

    @property
    def path_interval(self) -> Array:
        return np.array([0.0, 1.0])

    @property
    def waypoints(self) -> None:
        return None


class _SpeedBound(toppra.constraint.LinearConstraint):
    """Upper bounds on ds/dt at the grid points (N+1,)."""

    def __init__(self, bound: Array, dof: int) -> None:
        super().__init__()
        self._bound = bound
        self.dof = dof
        self.set_discretization_type(toppra.constraint.DiscretizationType.Collocation)
        self.n_extra_vars = 0
        self.identical = False

    def compute_constraint_params(self, path, gridpoints, *_):  # type: ignore[no-untyped-def]
        """Return only bounds on the squared speed."""
        squared = np.column_stack([np.zeros(len(self._bound)), self._bound**2])
        return None, None, None, None, None, None, squared
