"""From a scenario to the loop that is ready to run: cell, head, cloth, station and diagram."""

import dataclasses as dc
from dataclasses import dataclass
from typing import Any

import numpy as np
import yaml
from pydrake.systems.framework import Diagram

from unwrinkle.models.cloth import load_material
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell, load_cell
from unwrinkle.models.scenario import Scenario, with_sensor
from unwrinkle.perception.head import StereoHead
from unwrinkle.perception.head_file import nominal_calibration
from unwrinkle.perception.warm_up import ensure_compiled
from unwrinkle.simulation.cloth import Cloth, ClothState, Support
from unwrinkle.simulation.outlines import outline
from unwrinkle.simulation.wrinkle_makers import start_state
from unwrinkle.systems.flattening_diagram import build_flattening_diagram
from unwrinkle.systems.judgement import Memory
from unwrinkle.systems.sim_station import StationFaults, build_sim_station

#: What `--sensor` may say, and what it means in a scenario: kind, depth camera.
SENSORS = {"stereo": ("stereo", None), "xtion": ("depth", "xtion"), "tof": ("depth", "tof")}


@dataclass(frozen=True, eq=False)
class Loop:
    """All that a run needs.

    Attributes:
        cell: the robot in its cell.
        head: the stereo head.
        cloth: the simulated garment; None where the station is not simulated.
        station: with the ports of `systems.ports`.
        diagram: station, perception, planner, verification and supervisor.
        seed: of every random choice.
    """

    cell: Cell
    head: StereoHead
    cloth: Cloth | None
    station: Diagram
    diagram: Diagram
    seed: int


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
) -> Scenario:
    """A scenario with what the user chose instead of what it says; None keeps it.

    Raises:
        InputError: a choice that no scenario can have.
    """
    if sensor is not None and sensor not in SENSORS:
        raise InputError(f"sensor {sensor!r}: known are {', '.join(SENSORS)}")
    kind, camera = SENSORS[sensor] if sensor is not None else (None, None)

    def changed(part: Any, **values: Any) -> Any:
        return dc.replace(part, **{k: v for k, v in values.items() if v is not None})

    station = scenario.station
    worn = changed(station.garment, outline=garment, start=start, texture=texture)
    result: Scenario = dc.replace(
        scenario,
        station=dc.replace(station, garment=worn),
        sensor=changed(scenario.sensor, kind=kind, depth_camera=camera, scale=scale),
        loop=changed(scenario.loop, arms=arms, mode=mode, actions=actions),
    )
    return with_sensor(result, result.sensor.kind)


def scenario_text(scenario: Scenario, name: str = "Run") -> str:
    """The scenario as a file that `load_scenario` reads."""
    return yaml.safe_dump({name: dc.asdict(scenario)}, sort_keys=False)


def simulated_cloth(cell: Cell) -> Cloth:
    """The garment of the scenario on the cell's working table.

    Raises:
        InputError: an unknown outline or material, or a garment that is bigger than the table.
    """
    garment, table = cell.scenario.station.garment, cell.scenario.table
    shape = outline(garment.outline, garment.nodes)
    size = shape.spacing * (np.array(shape.mask.shape) - 1)
    if np.any(size > np.array(table.size)):
        raise InputError(
            f"a {garment.outline} of {size[0]:.2f} x {size[1]:.2f} m is bigger than the table of "
            f"{table.size[0]:.2f} x {table.size[1]:.2f} m; choose a smaller garment or another table"
        )
    x, y, height = (float(value) for value in cell.table_centre)
    support = Support((x, y), (table.size[0], table.size[1]), height)
    return Cloth(shape, load_material(garment.material), support)


def build_loop(
    scenario: Scenario,
    *,
    seed: int = 0,
    state: ClothState | None = None,
    memory: Memory | None = None,
    faults: StationFaults | None = None,
) -> Loop:
    """Build everything.

    Args:
        scenario: with the user's choices in it.
        seed: of every random choice.
        state: of the cloth, to go on from; None lets the garment lie as the scenario starts.
        memory: of the judgement, to go on with.
        faults: what shall go wrong in the station, for tests.

    Raises:
        InputError: the scenario names what is not there, or the garment does not fit the table.
    """
    if scenario.sensor.kind == "stereo":
        ensure_compiled()  # so that this run can be repeated bit by bit
    cell = load_cell(scenario)
    head = nominal_calibration().stereo_head(cell.limits.head)
    cloth = simulated_cloth(cell)
    if state is None:
        x, y = scenario.garment_centre
        state = start_state(cloth, scenario.station.garment.start, (x, y), seed)
    station = build_sim_station(cell, cloth, state, head=head, seed=seed, faults=faults)
    diagram = build_flattening_diagram(cell, station, head, memory=memory, seed=seed)
    return Loop(cell, head, cloth, station, diagram, seed)
