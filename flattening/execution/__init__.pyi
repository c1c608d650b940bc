from .executor import begin as begin, step as step
from .settings import ExecutionSettings as ExecutionSettings, LostCloth as LostCloth
from .state import (
    ExecutionFeedback as ExecutionFeedback,
    ExecutionResult as ExecutionResult,
    ExecutionState as ExecutionState,
    OperatorWishes as OperatorWishes,
    Outcome as Outcome,
)
