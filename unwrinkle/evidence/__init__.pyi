from .body_motion import BodyMotion as BodyMotion, body_motions as body_motions
from .document import write_evidence as write_evidence
from .motion import SampledMotion as SampledMotion, sampled_motion as sampled_motion
from .pack import Evidence as Evidence, collect_evidence as collect_evidence
from .stopping import HoldTravel as HoldTravel, hold_travels as hold_travels
from .swept import SweptSpace as SweptSpace, swept_space as swept_space
