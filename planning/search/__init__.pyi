from .failure import PlanFailure as PlanFailure
from .motion_search import MotionSearch as MotionSearch, SevenPoseMotion as SevenPoseMotion
from .planner import FlatteningPlanner as FlatteningPlanner, PlanResult as PlanResult
from .settings import PlannerSettings as PlannerSettings
from .transit import Transit as Transit, TransitPlanner as TransitPlanner
