from . import drivers as drivers, loopback as loopback
from .base import Station as Station
from .factory import make_station as make_station
from .world import SimulatedStation as SimulatedStation, StationFaults as StationFaults
