from .feedback import FeedbackFaults as FeedbackFaults
from .kinds import Faults as Faults, ServerFault as ServerFault
