from .base import DigitalIo as DigitalIo, Driver as Driver
from .driver import ControllerDriver as ControllerDriver
from .lock import OwnerLock as OwnerLock
from .process import DriverProcess as DriverProcess
from .thread import DriverThread as DriverThread
