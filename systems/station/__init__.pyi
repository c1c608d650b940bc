from . import drivers as drivers
from .hardware import build_hardware_station as build_hardware_station
from .loopback import (
    LoopbackStation as LoopbackStation,
    build_loopback_station as build_loopback_station,
)
from .simulated import build_sim_station as build_sim_station
from .world import SimulatedStation as SimulatedStation, StationFaults as StationFaults
