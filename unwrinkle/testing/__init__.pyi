from .calibration_scene import BoardScene as BoardScene, true_head as true_head
from .drake_ik import DrakeInverseKinematics as DrakeInverseKinematics
from .observations import (
    SeenWrinkle as SeenWrinkle,
    flat_towel_map as flat_towel_map,
    observation_of as observation_of,
)
from .plans import (
    result_of as result_of,
    short_plan as short_plan,
    smooth_motion as smooth_motion,
    verdict_of as verdict_of,
)
from .scripted_station import (
    LoopRun as LoopRun,
    Script as Script,
    ScriptedStation as ScriptedStation,
    run_loop as run_loop,
    towel_capture as towel_capture,
)
from .table import GARMENT_CENTRE as GARMENT_CENTRE, TABLE as TABLE
from .targets import flattening_task as flattening_task, tasks as tasks
from .toppra_bound import (
    jerk_free_line_time as jerk_free_line_time,
    jerk_free_time as jerk_free_time,
)
from .towels import (
    RidgeErrors as RidgeErrors,
    compare as compare,
    crossed_towel as crossed_towel,
    flat_map as flat_map,
    map_of as map_of,
    ridged_towel as ridged_towel,
)
from .traced_pair import TracedPair as TracedPair, traced_pair as traced_pair
