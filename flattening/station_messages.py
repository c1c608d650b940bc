"""Messages at the ports of the station: the contract that every form of the station keeps.

A station has these ports, in simulation and on the robot:

==============================  =====================  ===========================================
input                           type                   meaning
==============================  =====================  ===========================================
`trajectory`                    `TrajectoryCommand`    motion of all thirteen axes, or hold
`gripper.command`               `GripperCommand`       close or open
`head.command`                  `HeadCommand`          gaze, then one exposure of every camera
`speed_override`                vector (1,)            0 to 1, share of the planned speed
==============================  =====================  ===========================================

==============================  =====================  ===========================================
output                          type                   meaning
==============================  =====================  ===========================================
`joints.position_measured`      vector (13,)           rad: turn-table, right arm, left arm
`joints.velocity_measured`      vector (13,)           rad/s
`controller.status`             `ControllerStatus`
`gripper.status`                `GripperStatus`
`head.position_measured`        vector (4,)            rad: left pan, tilt, right pan, tilt
`head.left_image`               `HeadImage`            of the last exposure
`head.right_image`              `HeadImage`            of the last exposure
`depth_camera.image`            `DepthImage`           of the last exposure
==============================  =====================  ===========================================

Commands carry a number that their sender counts up; a command with a known number is ignored.
Images do not change until the next exposure, so that everything computed from them is computed
once.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.shared import Shared
from unwrinkle.perception.depth.capture import Capture
from unwrinkle.perception.stereo.head import Gaze
from unwrinkle.planning.motion_mode import MotionMode
from unwrinkle.planning.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class TrajectoryCommand(Shared):
    """Command to run a trajectory from rest, or to hold.

    Attributes:
        number: counts up with every new command; 0 is none.
        trajectory: of all axes; None holds: braking along the path, then rest.
        name: for messages.
    """

    number: int = 0
    trajectory: Trajectory | None = None
    name: str = ""


@dataclass(frozen=True)
class ControllerStatus(Shared):
    """Status of the controller, at its feedback rate.

    Attributes:
        state: `idle`, `running`, `holding` or `fault`.
        command: number of the last command that was accepted or refused.
        completed: number of the last command whose trajectory was run to its end.
        progress: time along the running trajectory, s.
        reason: of a refusal of the last command, of a hold or a fault; else empty.
    """

    state: MotionMode = MotionMode.IDLE
    command: int = 0
    completed: int = 0
    progress: float = 0.0
    reason: str = ""


@dataclass(frozen=True)
class GripperCommand(Shared):
    """Command to close or open the right and the left gripper.

    Attributes:
        number: counts up with every new command; 0 is none.
        closed: wanted, right and left.
    """

    number: int = 0
    closed: tuple[bool, bool] = (False, False)


@dataclass(frozen=True)
class GripperStatus(Shared):
    """Status of the grippers.

    Attributes:
        command: number of the last command that both grippers have finished.
        opening: distance between the blades, right and left, m.
        closed: whether it is closed, right and left.
        holding: whether there is cloth between its blades, right and left.
        reason: of a gripper that does not answer or does not move; else empty.
    """

    command: int = 0
    opening: tuple[float, float] = (0.0, 0.0)
    closed: tuple[bool, bool] = (False, False)
    holding: tuple[bool, bool] = (False, False)
    reason: str = ""


@dataclass(frozen=True)
class HeadCommand(Shared):
    """Command to turn both eyes to a gaze and, at rest there, to expose every camera once.

    Attributes:
        number: counts up with every new command; 0 is none.
        gaze: wanted; the turn-table's angle in it is not commanded.
    """

    number: int = 0
    gaze: Gaze = field(default_factory=Gaze)


@dataclass(frozen=True, eq=False)
class HeadImage(Shared):
    """Picture of one eye.

    Attributes:
        number: of the head command that it answers; 0 before the first.
        pixels: (h, w, 3) uint8 RGB; None without a picture.
        gaze: reported by the units at the exposure, with the measured angle of the turn-table.
        time: of the exposure on the station's clock, s.
        reason: why there is no picture; else empty.
    """

    number: int = 0
    pixels: NDArray[np.uint8] | None = None
    gaze: Gaze = field(default_factory=Gaze)
    time: float = 0.0
    reason: str = ""


@dataclass(frozen=True, eq=False)
class DepthImage(Shared):
    """Picture of the depth camera.

    Attributes:
        number: of the head command that it answers; 0 before the first.
        capture: depth with its camera, pose and colour; None where there is no picture.
        time: of the exposure on the station's clock, s.
        reason: why there is no picture; else empty.
    """

    number: int = 0
    capture: Capture | None = None
    time: float = 0.0
    reason: str = ""
