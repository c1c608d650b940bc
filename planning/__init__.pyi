from . import primitives as primitives
from . import robot as robot
from . import search as search
from . import timing as timing
from . import verification as verification
from .plan import (
    FlatteningPlan as FlatteningPlan,
    GarmentSurface as GarmentSurface,
    GripperEvent as GripperEvent,
    Segment as Segment,
)
from .trajectory import SampledCubic as SampledCubic, Trajectory as Trajectory
