from . import cameras as cameras
from . import controller as controller
from . import grippers as grippers
from . import motoros as motoros
from . import pan_tilt as pan_tilt
from . import run_log as run_log
from . import streaming as streaming
from .controller_state import (
    DriverStatus as DriverStatus,
    JointFeedback as JointFeedback,
    RobotStatus as RobotStatus,
)
from .equipment import Equipment as Equipment, connected as connected
