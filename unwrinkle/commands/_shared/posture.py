"""Where the robot stands, as an option of commands."""

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
        help="Where the robot stands: a named state of the robot (ext_plus_90, say), or the angles of all axes in rad, "
        "turn-table, right, left arm, with commas or blanks between them; home if left out.",
    ),
]


def posture(text: str, robot: "RobotDescription") -> "NDArray[np.float64]":
    """A posture (13,) in rad from a name or from numbers.

    Raises:
        InputError: no such name, or not as many finite numbers as the robot has axes.
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
            f"--start '{text}': give one of {', '.join(robot.named_states)}, or {len(robot.axes)} finite "
            "angles in rad with commas or blanks between them"
        )
    return np.array(angles)
