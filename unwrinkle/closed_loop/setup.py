"""Build the loop from a scenario: cell, head, cloth, station and diagram."""

import dataclasses as dc
import datetime
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import yaml
from pydrake.systems.framework import Diagram

from unwrinkle.flattening.policy import PolicyState
from unwrinkle.flattening.state import SupervisorSettings
from unwrinkle.flattening.state_machine import Approve
from unwrinkle.hardware.run_log.writer import RunLog
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell, load_cell
from unwrinkle.models.scenario import Scenario, resolve, with_sensor
from unwrinkle.models.site import Site, loopback_site
from unwrinkle.perception.stereo.compile_cache import ensure_compiled
from unwrinkle.perception.stereo.head import StereoHead
from unwrinkle.perception.stereo.head_file import load_calibration, nominal_calibration
from unwrinkle.simulation.cloth.cloth import Cloth, ClothState
from unwrinkle.simulation.cloth.initial_states import start_state
from unwrinkle.site.preflight_checks import check_calibration
from unwrinkle.systems.diagram import build_flattening_diagram
from unwrinkle.systems.station.hardware import build_hardware_station
from unwrinkle.systems.station.loopback import build_loopback_station
from unwrinkle.systems.station.simulated import build_sim_station
from unwrinkle.systems.station.world import (
    SimulatedStation,
    StationFaults,
    simulated_cloth,
)

#: Forms of the station other than the plain simulation.
LOOPBACK = "loopback"
HARDWARE = "hardware"
#: Values of `--sensor` with the kind of sensor and the depth camera in the scenario.
SENSORS = {
    "stereo": ("stereo", None),
    "xtion": ("depth", "xtion"),
    "tof": ("depth", "tof"),
    "truth": ("truth", None),
}


@dataclass(frozen=True, eq=False)
class Loop:
    """Everything that a run needs.

    Attributes:
        cell: robot and cell.
        head: stereo head.
        cloth: solver of the simulated garment; None if the station is not simulated.
        station: station with the ports that `systems.diagram` connects.
        diagram: station, perception, planner, verification and supervisor.
        seed: seed of all random numbers.
        real: whether the station's devices run in real time, so that the diagram must not be
            faster.
        close: function that closes the station's devices; repeated calls have no effect.
    """

    cell: Cell
    head: StereoHead
    cloth: Cloth | None
    station: Diagram
    diagram: Diagram
    seed: int
    real: bool = False
    close: Callable[[], None] = lambda: None


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


def build_loop(
    scenario: Scenario,
    *,
    seed: int = 0,
    state: ClothState | None = None,
    policy_state: PolicyState | None = None,
    faults: StationFaults | None = None,
    site: Site | None = None,
    log: RunLog | None = None,
    approve: Approve | None = None,
) -> Loop:
    """Build cell, station and diagram.

    Args:
        scenario: scenario with the user's choices.
        seed: seed of all random numbers.
        state: state of the cloth to resume from; None for the scenario's start.
        policy_state: state of the policy of a resumed run.
        faults: faults of the station to simulate, for tests.
        site: devices; required by the hardware station, optional for the loopback station.
        log: run log of the controller; unused in the sim station.
        approve: callback that asks the operator about each verified plan; None approves every plan.

    Raises:
        InputError: the scenario names something unknown, the garment does not fit the table, or the
            site is missing or lacks a device.
        HardwareError: a device does not get ready.
    """
    if scenario.sensor.kind == "stereo":
        ensure_compiled()  # so that this run is reproducible bit by bit
    form = scenario.station.form
    if form == HARDWARE:
        return _on_hardware(
            scenario, seed=seed, policy_state=policy_state, site=site, log=log, approve=approve
        )
    cell = load_cell(scenario)
    head = nominal_calibration().stereo_head(cell.limits.head)
    cloth = simulated_cloth(cell)
    if state is None:
        x, y = scenario.garment_centre
        state = start_state(cloth, scenario.station.garment.start, (x, y), seed)
    settings, close = SupervisorSettings(), lambda: None
    station: SimulatedStation
    if form == LOOPBACK:
        site = site or loopback_site()
        settings = SupervisorSettings.of_site(site)
        station = build_loopback_station(
            cell, cloth, state, head=head, seed=seed, faults=faults, site=site, log=log
        )
        close = station.close
    else:
        station = build_sim_station(cell, cloth, state, head=head, seed=seed, faults=faults)
    diagram = build_flattening_diagram(
        cell,
        station,
        head,
        settings=settings,
        policy_state=policy_state,
        approve=approve,
        seed=seed,
    )
    return Loop(
        cell=cell,
        head=head,
        cloth=cloth,
        station=station,
        diagram=diagram,
        seed=seed,
        close=close,
    )


def _on_hardware(
    scenario: Scenario,
    *,
    seed: int,
    policy_state: PolicyState | None,
    site: Site | None,
    log: RunLog | None,
    approve: Approve | None,
) -> Loop:
    """Build the loop around a site's devices, with the site's speed and calibration.

    Raises:
        InputError: there is no operator to approve plans, the site is under commissioning, or its
            calibration is missing or too old.
    """
    if site is None:
        raise InputError(
            "the hardware station needs --site FILE; examples are in models/data/sites"
        )
    if approve is None:
        raise InputError(
            f"the hardware station moves the robot of site {site.name}: add --go to permit this, "
            "or rehearse with --station loopback"
        )
    if site.commissioning:
        raise InputError(
            f"site {site.name} is under commissioning: run single plans with `unwrinkle execute` "
            "first; then set commissioning: false"
        )
    if scenario.sensor.kind == "stereo":
        check_calibration(site, datetime.date.today())
    cell = load_cell(scenario)
    calibration = (
        load_calibration(resolve(site.calibration)) if site.calibration else nominal_calibration()
    )
    head = calibration.stereo_head(cell.limits.head)
    station = build_hardware_station(cell, site, head=head, log=log)
    diagram = build_flattening_diagram(
        cell,
        station,
        head,
        settings=SupervisorSettings.of_site(site),
        policy_state=policy_state,
        approve=approve,
        seed=seed,
    )
    return Loop(
        cell=cell,
        head=head,
        cloth=None,
        station=station,
        diagram=diagram,
        seed=seed,
        real=True,
        close=station.close,
    )
