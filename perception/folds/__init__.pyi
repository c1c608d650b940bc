from .borders import Borders as Borders
from .flaps import Flap as Flap
from .garment_state import (
    FoldAnalysis as FoldAnalysis,
    GarmentState as GarmentState,
    analyse_folds as analyse_folds,
)
from .height_image import HeightImage as HeightImage, height_image as height_image
from .learn_garment import learn_garment as learn_garment
from .ridge_kinds import RidgeKind as RidgeKind
