"""Comparison of the numeric kinematics (robot.yaml) with the model files.

Both must give the same tool poses.
"""

from collections.abc import Sequence

import numpy as np

from unwrinkle.models.arrays import Array
from unwrinkle.models.robot import Cell
from unwrinkle.planning.robot.kinematics import Kinematics
from unwrinkle.planning.verification.motion import Leg
from unwrinkle.planning.verification.verdict import Findings

ARMS = ("right", "left")
#: Greatest difference of a tool's position, m.
POSITION_TOLERANCE = 1e-5
#: Greatest difference of a direction cosine of a tool's axes.
DIRECTION_TOLERANCE = 1e-5
#: Samples of each leg that are compared.
_COUNT = 25


def check_kinematics(
    cell: Cell, legs: Sequence[Leg], frames: Sequence[tuple[Array, Array]], found: Findings
) -> None:
    """Compare the planner's kinematics with Drake's on samples of the motion. Adds the check
    `kinematics`.

    Args:
        cell: the cell.
        legs: the motion.
        frames: per leg the result of `CellModel.frames` at its samples.
        found: receives the check.
    """
    numbers, turntable = Kinematics(cell), cell.robot.turntable_axis
    worst, turned, where, when = -1.0, 0.0, "", 0.0
    for leg, (_, X_WT) in zip(legs, frames, strict=True):
        chosen = np.unique(np.linspace(0, len(leg.times) - 1, _COUNT).astype(int))
        q = leg.positions[chosen]
        for arm, name in enumerate(ARMS):
            X = numbers.tcp(arm, q[:, turntable], q[:, cell.robot.arms[arm].axes])
            off = X - X_WT[chosen, arm]
            distance = np.linalg.norm(off[:, :3, 3], axis=1)
            turned = max(turned, float(np.abs(off[:, :3, :3]).max()))
            i = int(np.argmax(distance))
            if not distance[i] <= worst:
                worst, where, when = float(distance[i]), f"{name} tool", float(leg.times[chosen[i]])
    if not (worst <= POSITION_TOLERANCE and turned <= DIRECTION_TOLERANCE):
        found.fail(
            "kinematics",
            f"robot.yaml and the model files give positions of the {where} {1e3 * worst:.2f} mm "
            f"apart at {when:.3f} s (axes up to {turned:.2g} rad): they describe different robots",
            when,
        )
    found.check(
        "kinematics", worst, POSITION_TOLERANCE, POSITION_TOLERANCE - worst, "m", where, when
    )
