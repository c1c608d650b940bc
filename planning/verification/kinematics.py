"""The robot's numbers (robot.yaml) against its models: both have to put the tools in the same place."""

from collections.abc import Sequence

import numpy as np

from unwrinkle.models.arrays import Array
from unwrinkle.models.robot import Cell
from unwrinkle.planning.robot.kinematics import Kinematics
from unwrinkle.planning.verification.motion import Leg
from unwrinkle.planning.verification.verdict import Findings

ARMS = ("right", "left")
#: Between a tool's poses by the numbers and by the models: of its position, m, and of its axes, rad.
PLACE, TURN = 1e-5, 1e-5
#: Samples of each leg that are compared.
_COUNT = 25


def check_kinematics(
    cell: Cell, legs: Sequence[Leg], frames: Sequence[tuple[Array, Array]], found: Findings
) -> None:
    """Compare the planner's kinematics with Drake's on samples of the motion. Adds the check `kinematics`.

    Args:
        cell: the cell.
        legs: the motion.
        frames: per leg what `CellModel.frames` gives at its samples.
        found: takes the check.
    """
    numbers = Kinematics(cell)
    worst, turned, where, when = -1.0, 0.0, "", 0.0
    for leg, (_, X_WT) in zip(legs, frames, strict=True):
        chosen = np.unique(np.linspace(0, len(leg.times) - 1, _COUNT).astype(int))
        q = leg.positions[chosen]
        for arm, name in enumerate(ARMS):
            X = numbers.tcp(arm, q[:, 0], q[:, 1 + 6 * arm : 7 + 6 * arm])
            off = X - X_WT[chosen, arm]
            distance = np.linalg.norm(off[:, :3, 3], axis=1)
            turned = max(turned, float(np.abs(off[:, :3, :3]).max()))
            i = int(np.argmax(distance))
            if not distance[i] <= worst:
                worst, where, when = float(distance[i]), f"{name} tool", float(leg.times[chosen[i]])
    if not (worst <= PLACE and turned <= TURN):
        found.fail(
            "kinematics",
            f"the robot's numbers and its models put the {where} {1e3 * worst:.2f} mm apart at {when:.3f} s (axes up to "
            f"{turned:.2g} rad): robot.yaml and the model files are not of one robot",
            when,
        )
    found.check("kinematics", worst, PLACE, PLACE - worst, "m", where, when)
