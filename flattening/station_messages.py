"""What travels through the station's ports: the contract that every form of the station keeps.

A `FlatteningStation` has these ports, whatever stands behind it:

==============================  =====================  ===========================================
input                           type                   meaning
==============================  =====================  ===========================================
`trajectory`                    `TrajectoryCommand`    motion of all thirteen axes, or hold
`gripper.command`               `GripperCommand`       close or open
`head.command`                  `HeadCommand`          look there, then expose every camera once
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

Commands carry a number that their sender counts up: a command whose number was seen before is no
new one. Images stay as they are until the next exposure, so that whatever is computed from them is
computed once.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.errors import InputError
from unwrinkle.perception.depth.capture import Capture
from unwrinkle.perception.stereo.head import Gaze
from unwrinkle.planning.motion_mode import MotionMode
from unwrinkle.planning.trajectory import Trajectory

#: What the controller does.
IDLE, RUNNING, HOLDING, FAULT = MotionMode


@dataclass(frozen=True, eq=False)
class TrajectoryCommand:
    """Run a trajectory from where the robot rests, or hold.

    Attributes:
        number: counts up with every new command; 0 is none.
        trajectory: all thirteen axes; None holds: a braking motion along the path, then rest.
        name: for messages.
    """

    number: int = 0
    trajectory: Trajectory | None = None
    name: str = ""


@dataclass(frozen=True)
class ControllerStatus:
    """What the controller says, at its feedback rate.

    Attributes:
        state: `idle`, `running`, `holding` or `fault`.
        command: number of the last command that was accepted or refused.
        completed: number of the last command whose trajectory was run to its end.
        progress: time along the running trajectory, s.
        reason: why it refused the last command, holds, or is in fault; else empty.
    """

    state: str = IDLE
    command: int = 0
    completed: int = 0
    progress: float = 0.0
    reason: str = ""

    def __post_init__(self) -> None:
        """Refuse a state that is none of the four."""
        if self.state not in (IDLE, RUNNING, HOLDING, FAULT):
            raise InputError(f"controller state {self.state!r} is not one of its four states")


@dataclass(frozen=True)
class GripperCommand:
    """Close or open the right and the left gripper.

    Attributes:
        number: counts up with every new command; 0 is none.
        closed: wanted, right and left.
    """

    number: int = 0
    closed: tuple[bool, bool] = (False, False)


@dataclass(frozen=True)
class GripperStatus:
    """What the grippers say.

    Attributes:
        command: number of the last command that both grippers have finished.
        opening: distance between the blades, right and left, m.
        closed: whether it has been closed, right and left.
        holding: whether it has cloth between its blades, right and left.
        reason: why a gripper does not answer or does not move; else empty.
    """

    command: int = 0
    opening: tuple[float, float] = (0.0, 0.0)
    closed: tuple[bool, bool] = (False, False)
    holding: tuple[bool, bool] = (False, False)
    reason: str = ""


@dataclass(frozen=True)
class HeadCommand:
    """Turn both eyes to a gaze and, at rest there, expose every camera once.

    Attributes:
        number: counts up with every new command; 0 is none.
        gaze: wanted; the turn-table's angle in it is not commanded.
    """

    number: int = 0
    gaze: Gaze = field(default_factory=Gaze)


@dataclass(frozen=True, eq=False)
class HeadImage:
    """One eye's picture.

    Attributes:
        number: of the head command that it answers; 0 before the first.
        pixels: (h, w, 3) uint8 RGB; None where there is no picture.
        gaze: that the units reported at the exposure, with the turn-table's measured angle.
        time: of the exposure on the station's clock, s.
        reason: why there is no picture; else empty.
    """

    number: int = 0
    pixels: NDArray[np.uint8] | None = None
    gaze: Gaze = field(default_factory=Gaze)
    time: float = 0.0
    reason: str = ""


@dataclass(frozen=True, eq=False)
class DepthImage:
    """The depth camera's picture.

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
