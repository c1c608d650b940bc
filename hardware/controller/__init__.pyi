from .driver import ControllerDriver as ControllerDriver
from .lock import OwnerLock as OwnerLock
from .process import DriverProcess as DriverProcess
from .thread import DriverThread as DriverThread
