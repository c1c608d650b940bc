"""Drake's optimisation-based inverse kinematics in place of the closed form, to compare with."""

import numpy as np
from pydrake.math import RotationMatrix
from pydrake.multibody.inverse_kinematics import InverseKinematics
from pydrake.solvers import SnoptSolver

from unwrinkle.models.arrays import Array
from unwrinkle.models.robot import Cell, build_robot_diagram, position_indices
from unwrinkle.planning.robot.kinematics import InverseSolution, Kinematics

_TOLERANCE = 1e-7


class DrakeInverseKinematics(Kinematics):
    """One SNOPT solution per pose, started from the one before; no other branches, no collision."""

    def __init__(self, cell: Cell) -> None:
        """Build the plant of the cell."""
        super().__init__(cell)
        self._diagram = build_robot_diagram(cell)
        self._plant = self._diagram.plant()
        self._axes = position_indices(cell, self._plant).axes
        self._rest = self._plant.GetPositions(self._plant.CreateDefaultContext())
        self._solver = SnoptSolver()
        self._last = [np.zeros(6), np.zeros(6)]

    def inverse(
        self,
        arm: int,
        turntable: Array | float,
        X_WT: Array,
        *,
        iterations: int = 6,
        tolerance: float = 1e-9,
    ) -> InverseSolution:
        """Return at most one branch (index 0) per pose.

        Arguments as `Kinematics.inverse`, the last two unused.
        """
        count = len(X_WT)
        turns = np.broadcast_to(np.asarray(turntable, dtype=float), count)
        q = np.zeros((count, 8, 6))
        found = np.zeros((count, 8), dtype=bool)
        for i in range(count):
            solution = self.solve(arm, float(turns[i]), X_WT[i], self._last[arm])
            if solution is not None:
                q[i, 0], found[i, 0] = solution, True
                self._last[arm] = solution
        return InverseSolution(q, found, found)

    def solve(self, arm: int, turntable: float, X_WT: Array, guess: Array) -> Array | None:
        """Return the angles (6,) of one arm for one pose within the limits, or None.

        Args:
            arm: 0 right, 1 left.
            turntable: rad, held.
            X_WT: (4, 4) pose of the tool centre point.
            guess: (6,) rad to start from.
        """
        own = self._axes[1 + 6 * arm : 7 + 6 * arm]
        problem = InverseKinematics(self._plant, with_joint_limits=True)
        program, q = problem.prog(), problem.q()
        start = self._rest.copy()
        start[self._axes[0]] = turntable
        start[own] = guess
        held = np.setdiff1d(np.arange(len(start)), own)
        program.AddBoundingBoxConstraint(start[held], start[held], q[held])
        gripper = self._plant.GetModelInstanceByName(("r1_gripper", "r2_gripper")[arm])
        tcp, world = self._plant.GetFrameByName("tcp", gripper), self._plant.world_frame()
        p = X_WT[:3, 3]
        problem.AddPositionConstraint(tcp, np.zeros(3), world, p - _TOLERANCE, p + _TOLERANCE)
        # The constraint bounds a cosine, so that the solver's own tolerance leaves about a
        # milliradian.
        problem.AddOrientationConstraint(
            world, RotationMatrix(X_WT[:3, :3]), tcp, RotationMatrix(), 10.0 * _TOLERANCE
        )
        result = self._solver.Solve(program, start, None)
        return np.asarray(result.GetSolution(q)[own]) if result.is_success() else None
