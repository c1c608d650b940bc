"""Option for the posture that the robot starts from."""

import math
from typing import TYPE_CHECKING, Annotated

import typer

from unwrinkle.models.errors import InputError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from unwrinkle.models.robot import RobotDescription

StartOption = Annotated[
    str | None,
    typer.Option(
        metavar="POSTURE",
        help="Posture of the robot: a named state (e.g. ext_plus_90), or the angles of all axes in "
        "rad, turn-table, right arm, left arm, separated by commas or blanks; home if left out.",
    ),
]


def posture(text: str, robot: "RobotDescription") -> "NDArray[np.float64]":
    """Return a posture (13,), rad, from a name or from numbers.

    Raises:
        InputError: there is no such name, or the number of finite numbers is not that of the axes.
    """
    import numpy as np

    named = robot.named_states.get(text.strip())
    if named is not None:
        return np.array(named, dtype=float)
    try:
        angles = [float(part) for part in text.strip().strip("[]").replace(",", " ").split()]
    except ValueError:
        angles = []
    if len(angles) != len(robot.axes) or not all(math.isfinite(angle) for angle in angles):
        raise InputError(
            f"--start '{text}': give one of {', '.join(robot.named_states)}, or {len(robot.axes)} "
            "finite angles in rad, separated by commas or blanks"
        )
    return np.array(angles)
