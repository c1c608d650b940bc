"""Station in its `sim` form: robot, grippers, head, cameras and cloth are simulated.

The ports are those of the other forms. In addition, a simulated station has these outputs:

==================  ==============================================================
output              meaning
==================  ==============================================================
`truth.cloth`       `ClothState`
`truth.coverage`    vector (1,): share of the flat garment's area covered from above
`truth.height`      vector (1,): m, largest height above the flat-lying cloth
`truth.tips`        vector (32,): X_WT (2, 4, 4) of the right and the left tool
==================  ==============================================================
"""

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import DiagramBuilder

from unwrinkle.models.robot import Cell
from unwrinkle.perception.stereo.head import StereoHead
from unwrinkle.simulation.arms.trajectory_player import PlayerSettings
from unwrinkle.simulation.cloth.cloth import Cloth, ClothState
from unwrinkle.systems.station.arm_controller import ArmControllerSystem
from unwrinkle.systems.station.world import (
    ControlsBuilder,
    SimulatedStation,
    StationControls,
    StationFaults,
    World,
    start_posture,
)


def build_sim_station(
    cell: Cell,
    cloth: Cloth,
    state: ClothState,
    *,
    head: StereoHead,
    seed: int,
    start: NDArray[np.floating] | None = None,
    faults: StationFaults | None = None,
    player: PlayerSettings | None = None,
) -> SimulatedStation:
    """Build the simulated station, a diagram called "station".

    Args:
        cell: robot and cell; its scenario states the periods, the sensor and the garment's texture.
        cloth: solver of the cloth.
        state: initial state of the cloth.
        head: true stereo head.
        seed: seed of the head's rest errors, the texture and the images' noise.
        start: (13,) initial posture of the axes, rad; home if left out.
        faults: faults to simulate; none if left out.
        player: settings of the arms' controller; the defaults if left out.

    Raises:
        InputError: the start is no posture or beyond the limits, a period is no multiple of the
            cloth's time step, or a texture, sensor or fault is unknown.
    """
    return SimulatedStation(
        cell,
        cloth,
        state,
        head,
        seed=seed,
        start=start_posture(cell, cloth, start),
        faults=faults or StationFaults(),
        controls=_controls(player),
    )


def _controls(player: PlayerSettings | None) -> ControlsBuilder:
    """Return a builder of direct controls.

    The trajectory player drives the axes, commands go to the simulated devices.
    """

    def build(builder: DiagramBuilder, world: World) -> StationControls:
        settings = world.cell.scenario.station
        controller = builder.AddSystem(
            ArmControllerSystem(
                world.cell,
                world.start,
                step=settings.plant_step,
                feedback_period=settings.feedback_period,
                settings=player,
            )
        )
        measured = world.measured
        for name in ("position", "velocity"):
            builder.Connect(measured[name], controller.GetInputPort(name))
        return StationControls(
            inputs={
                "trajectory": controller.GetInputPort("trajectory"),
                "gripper.command": world.grippers.GetInputPort("command"),
                "head.command": world.units.GetInputPort("command"),
                "speed_override": controller.GetInputPort("speed_override"),
            },
            outputs={
                "joints.position_measured": measured["position"],
                "joints.velocity_measured": measured["velocity"],
                "controller.status": controller.GetOutputPort("status"),
                "gripper.status": world.grippers.GetOutputPort("status"),
                "head.position_measured": world.units.GetOutputPort("position"),
            },
            desired=controller.GetOutputPort("desired"),
            reference=controller.GetOutputPort("reference"),
            head=world.units.GetOutputPort("status"),
        )

    return build
