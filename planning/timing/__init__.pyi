from .optimal_smoothing import smooth_optimally as smooth_optimally
from .joint_path import JointPath as JointPath, PathLimits as PathLimits, TimedPath as TimedPath
from .path_timing import time_paths as time_paths
from .ruckig_smoothing import smooth_by_ruckig as smooth_by_ruckig
from .sampling import Samples as Samples, sample_within as sample_within
from .straight_lines import time_line as time_line
from .toppra_profile import (
    PathTimingError as PathTimingError,
    SpeedProfile as SpeedProfile,
    time_optimal_profile as time_optimal_profile,
)
