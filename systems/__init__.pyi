from . import perception as perception
from . import planning as planning
from . import station as station
from .diagram import (
    build_flattening_diagram as build_flattening_diagram,
    supervisor_state as supervisor_state,
)
from .function_system import FunctionSystem as FunctionSystem
from .supervisor import FlatteningSupervisorSystem as FlatteningSupervisorSystem
