from .base import GripperReport as GripperReport, Grippers as Grippers
from .can_bus import CanGrippers as CanGrippers, open_can_bus as open_can_bus
from .digital_io import DigitalGrippers as DigitalGrippers
from .factory import (
    GRIPPERS as GRIPPERS,
    GripperKind as GripperKind,
    make_grippers as make_grippers,
)
