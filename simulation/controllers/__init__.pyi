from . import faults as faults
from .controller import VirtualController as VirtualController
from .server import ControllerServer as ControllerServer
from .settings import VirtualControllerSettings as VirtualControllerSettings
