"""Build the loop from a scenario: cell, head, cloth, station and diagram."""

import dataclasses as dc
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import yaml
from pydrake.systems.framework import Diagram

from unwrinkle.flattening.policy import PolicyState
from unwrinkle.flattening.state import SupervisorSettings
from unwrinkle.flattening.state_machine import Approve
from unwrinkle.hardware.run_log.writer import RunLog
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import load_cell
from unwrinkle.models.scenario import Scenario, StationForm, with_sensor
from unwrinkle.models.site import Site
from unwrinkle.perception.stereo.compile_cache import ensure_compiled
from unwrinkle.simulation.cloth.cloth import ClothState
from unwrinkle.systems.diagram import build_flattening_diagram
from unwrinkle.systems.station.base import Station
from unwrinkle.systems.station.factory import make_station
from unwrinkle.systems.station.world import StationFaults

#: Values of `--sensor` with the kind of sensor and the depth camera in the scenario.
SENSORS = {
    "stereo": ("stereo", None),
    "xtion": ("depth", "xtion"),
    "tof": ("depth", "tof"),
    "truth": ("truth", None),
}


@dataclass(frozen=True, eq=False)
class Loop:
    """A station, and the diagram around it.

    Attributes:
        station: with the ports that `systems.diagram` connects.
        diagram: station, perception, planner, verification and supervisor.
    """

    station: Station
    diagram: Diagram


def with_choices(
    scenario: Scenario,
    *,
    garment: str | None = None,
    start: str | None = None,
    texture: str | None = None,
    sensor: str | None = None,
    scale: float | None = None,
    arms: str | None = None,
    mode: str | None = None,
    actions: int | None = None,
    station: str | None = None,
    order: str | None = None,
) -> Scenario:
    """Return a scenario with the user's choices; None keeps the scenario's value.

    Raises:
        InputError: no scenario can have such a choice.
    """
    if sensor is not None and sensor not in SENSORS:
        raise InputError(f"sensor {sensor!r} is unknown; known are {', '.join(SENSORS)}")
    kind, camera = SENSORS[sensor] if sensor is not None else (None, None)

    def changed(part: Any, **values: Any) -> Any:
        return dc.replace(part, **{k: v for k, v in values.items() if v is not None})

    worn = changed(scenario.station.garment, outline=garment, start=start, texture=texture)
    result: Scenario = dc.replace(
        scenario,
        station=changed(scenario.station, garment=worn, form=station),
        sensor=changed(scenario.sensor, kind=kind, depth_camera=camera, scale=scale),
        loop=changed(scenario.loop, arms=arms, mode=mode, actions=actions, order=order),
    )
    return with_sensor(result, result.sensor.kind)


def scenario_text(scenario: Scenario, name: str = "Run") -> str:
    """Return the scenario as text that `load_scenario` reads."""
    return yaml.safe_dump({name: dc.asdict(scenario)}, sort_keys=False)


@contextmanager
def open_loop(
    scenario: Scenario,
    *,
    seed: int = 0,
    state: ClothState | None = None,
    policy_state: PolicyState | None = None,
    faults: StationFaults | None = None,
    site: Site | None = None,
    log: RunLog | None = None,
    approve: Approve | None = None,
) -> Iterator[Loop]:
    """Make the station of a scenario and the diagram around it; the station is closed at the end.

    Args:
        scenario: scenario with the user's choices.
        seed: seed of all random numbers.
        state: state of the cloth to resume from; None for the scenario's start.
        policy_state: state of the policy of a resumed run.
        faults: faults of the station to simulate, for tests.
        site: devices; required by the hardware station, optional for the loopback station.
        log: run log of the controller; unused in the sim station.
        approve: callback that asks the operator about each verified plan; None approves every plan,
            which the hardware station does not permit.

    Raises:
        InputError: see `make_station`.
        HardwareError: a device does not get ready.
    """
    if scenario.station.form == StationForm.SIM:
        site = None
    with make_station(
        load_cell(scenario),
        site=site,
        seed=seed,
        state=state,
        faults=faults,
        log=log,
        go=approve is not None,
    ) as station:
        yield loop_around(station, policy_state=policy_state, approve=approve)


def loop_around(
    station: Station, *, policy_state: PolicyState | None = None, approve: Approve | None = None
) -> Loop:
    """Build the diagram around a station.

    Args:
        station: of any form.
        policy_state: state of the policy of a resumed run.
        approve: see `open_loop`.

    Raises:
        InputError: the station moves a robot, and nobody approves plans.
    """
    if station.real and approve is None:
        raise InputError("the station moves a robot, so that `approve` has to ask about each plan")
    if station.cell.scenario.sensor.kind == "stereo":
        ensure_compiled()  # so that this run is reproducible bit by bit
    diagram = build_flattening_diagram(
        station.cell,
        station,
        station.head,
        settings=None if station.site is None else SupervisorSettings.of_site(station.site),
        policy_state=policy_state,
        approve=approve,
        seed=station.seed,
    )
    return Loop(station, diagram)
