from .analysis import Analysis as Analysis, analyse as analyse
from .grasp_proposal import (
    GraspProposal as GraspProposal,
    NoGrasp as NoGrasp,
    propose_grasp as propose_grasp,
)
from .surface import Surface as Surface, fit_surface as fit_surface
from .targeting import flattening_target as flattening_target, garment_contour as garment_contour
from .wrinkle import Wrinkle as Wrinkle, wrinkles_of as wrinkles_of
from .wrinkledness import Wrinkledness as Wrinkledness
