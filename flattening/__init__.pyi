from . import execution as execution
from .flattener import (
    Choice as Choice,
    Flattener as Flattener,
    NoChoice as NoChoice,
    NoProposal as NoProposal,
    Proposal as Proposal,
    Refusal as Refusal,
    analysis_report as analysis_report,
    choose as choose,
)
from .capture_to_observation import (
    StereoCapture as StereoCapture,
    load_stereo_capture as load_stereo_capture,
    map_of as map_of,
    observation_of as observation_of,
)
from .observation import (
    GarmentFeatures as GarmentFeatures,
    Observation as Observation,
    WrinkleFeatures as WrinkleFeatures,
)
from .policy import (
    Policy as Policy,
    PolicyState as PolicyState,
    PullDecision as PullDecision,
    Stop as Stop,
    decide as decide,
)
from .state import (
    Mode as Mode,
    RunStatus as RunStatus,
    SupervisorSettings as SupervisorSettings,
    SupervisorState as SupervisorState,
)
from .state_machine import StateMachine as StateMachine
from .verified_planning import VerifiedResult as VerifiedResult, plan_verified as plan_verified
