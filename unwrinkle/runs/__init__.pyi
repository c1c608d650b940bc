from .folder import RunFolder as RunFolder
from .look_folder import LookFolder as LookFolder
from .pictures import save_pictures as save_pictures
from .records import (
    ActionRecord as ActionRecord,
    MotionRecord as MotionRecord,
    RunSettings as RunSettings,
    SegmentMark as SegmentMark,
)
