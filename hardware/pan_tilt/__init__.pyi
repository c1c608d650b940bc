from .base import PanTilt as PanTilt, PanTiltState as PanTiltState, PanTiltStatus as PanTiltStatus
from .driver import PanTiltDriver as PanTiltDriver
from .serial_port import SerialLink as SerialLink, open_serial as open_serial
