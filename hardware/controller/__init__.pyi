from .base import DigitalIo as DigitalIo, Driver as Driver
from .driver import ControllerDriver as ControllerDriver
from .lock import OwnerLock as OwnerLock
from .driver_loop import DriverLoop as DriverLoop
from .process import DriverProcess as DriverProcess
