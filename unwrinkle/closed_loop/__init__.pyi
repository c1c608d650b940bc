from .executed_motion import MeasuredSegment as MeasuredSegment, check_execution as check_execution
from .one_call import flatten as flatten
from .run import RunEnding as RunEnding
from .session import (
    Choices as Choices,
    Session as Session,
    begin_run as begin_run,
    resume_run as resume_run,
)
