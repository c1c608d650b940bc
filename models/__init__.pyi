from . import io as io
from .cloth import ClothMaterial as ClothMaterial, load_material as load_material
from .errors import (
    HardwareError as HardwareError,
    InputError as InputError,
    NoVerifiedPlanError as NoVerifiedPlanError,
    UnwrinkleError as UnwrinkleError,
)
from .limits import Limits as Limits, load_limits as load_limits
from .robot import (
    Cell as Cell,
    RobotDescription as RobotDescription,
    load_cell as load_cell,
    model_file as model_file,
)
from .scenario import Scenario as Scenario, load_scenario as load_scenario
from .shared import Shared as Shared
from .site import Site as Site, load_site as load_site
from .table import Table as Table
from .transforms import inverse as inverse, pose as pose, transformed as transformed
