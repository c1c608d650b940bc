from .confirmation import Confirmation as Confirmation
from .executor import PlanExecutor as PlanExecutor
from .preflight import Preflight as Preflight
from .robot import Robot as Robot, connect as connect
from .session import ExecutionOptions as ExecutionOptions, ExecutionSession as ExecutionSession
