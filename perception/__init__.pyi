from . import calibration as calibration
from . import depth as depth
from . import folds as folds
from . import gaze as gaze
from . import stereo as stereo
from . import wrinkles as wrinkles
from .camera import Camera as Camera, load_camera as load_camera
from .range_map import RangeMap as RangeMap
from .sensor import NoiseProfile as NoiseProfile, noise_profile as noise_profile
from .target import (
    FlatteningTarget as FlatteningTarget,
    HandTarget as HandTarget,
    NoTarget as NoTarget,
)
