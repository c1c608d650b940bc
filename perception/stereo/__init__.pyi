from .compile_cache import ensure_compiled as ensure_compiled
from .head import Eye as Eye, Gaze as Gaze, PanTiltUnit as PanTiltUnit, StereoHead as StereoHead
from .head_file import (
    HeadAngles as HeadAngles,
    HeadCalibration as HeadCalibration,
    load_calibration as load_calibration,
    load_head_angles as load_head_angles,
    nominal_calibration as nominal_calibration,
    nominal_head as nominal_head,
)
from .matching import Disparity as Disparity, match as match
from .pair import StereoPair as StereoPair, load_pair as load_pair
from .range_mapping import match_pair as match_pair, range_map_from_pair as range_map_from_pair
