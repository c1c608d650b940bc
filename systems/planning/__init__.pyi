from .planner import PlannerSystem as PlannerSystem
from .verification import VerificationSystem as VerificationSystem
