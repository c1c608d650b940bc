from .path_clock import PathClock as PathClock
from .sent_cubics import StreamLimits as StreamLimits
from .stream import PointStream as PointStream
from .trajectory_check import trajectory_problem as trajectory_problem
