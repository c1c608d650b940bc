from .closed_loop.one_call import flatten as flatten
from .execution.robot import Robot as Robot, connect as connect
from .flattening.flattener import (
    Flattener as Flattener,
    NoProposal as NoProposal,
    Proposal as Proposal,
)
from .flattening.observation import Observation as Observation
from .flattening.capture_to_observation import (
    StereoCapture as StereoCapture,
    load_stereo_capture as load_stereo_capture,
)
from .models.errors import (
    HardwareError as HardwareError,
    InputError as InputError,
    NoVerifiedPlanError as NoVerifiedPlanError,
    UnwrinkleError as UnwrinkleError,
)
from .models.robot import Cell as Cell, load_cell as load_cell, model_file as model_file
from .models.site import Site as Site
from .perception.camera import Camera as Camera
from .perception.depth.capture import Capture as Capture, load_capture as load_capture
from .perception.range_map import RangeMap as RangeMap
from .perception.stereo.head import StereoHead as StereoHead
from .perception.stereo.pair import StereoPair as StereoPair
from .perception.target import (
    FlatteningTarget as FlatteningTarget,
    HandTarget as HandTarget,
    NoTarget as NoTarget,
)
from .perception.wrinkles.wrinkle import Wrinkle as Wrinkle
from .planning.plan import FlatteningPlan as FlatteningPlan
from .planning.trajectory import Trajectory as Trajectory
from .planning.verification.verdict import Verdict as Verdict
from .planning.verification.verifier import verify as verify
from .runs.pictures import save_pictures as save_pictures
from .site.check import check_site as check_site
from .site.sites import find_site as find_site
from .site.virtual_process import virtual_controller as virtual_controller
from .systems.station.base import Station as Station
from .systems.station.factory import make_station as make_station
from .viewer.preview import save_preview as save_preview

__version__: str
