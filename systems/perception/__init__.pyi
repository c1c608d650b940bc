from .analysis import AnalysisSystem as AnalysisSystem
from .depth import DepthPerceptionSystem as DepthPerceptionSystem
from .ground_truth import TruePerceptionSystem as TruePerceptionSystem
from .stereo import StereoPerceptionSystem as StereoPerceptionSystem
