"""The station in its `sim` form: robot, grippers, head, cameras and cloth, all simulated.

The ports are those of `systems.ports`; besides, simulation alone tells the truth:

==================  ==============================================================
output              meaning
==================  ==============================================================
`truth.cloth`       `ClothState`
`truth.coverage`    vector (1,): share of the flat garment's area covered from above
`truth.height`      vector (1,): m, largest height above the flat-lying cloth
`truth.tips`        vector (32,): X_WT (2, 4, 4) of the right and the left tool
==================  ==============================================================
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort
from pydrake.systems.primitives import Multiplexer, VectorLogSink

from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell
from unwrinkle.perception.head import StereoHead
from unwrinkle.simulation.cloth import Cloth, ClothState
from unwrinkle.simulation.trajectory_player import PlayerSettings
from unwrinkle.systems.arm_controller import ArmController
from unwrinkle.systems.arm_plant import (
    ArmPlant,
    ToolPoses,
    add_selections,
    build_arm_plant,
    connect_servos,
)
from unwrinkle.systems.camera_system import CameraSystem
from unwrinkle.systems.cloth_system import ClothSystem
from unwrinkle.systems.gripper_system import GripperSystem
from unwrinkle.systems.head_system import HeadSystem
from unwrinkle.systems.motion_log import MotionLog

Array = NDArray[np.float64]


@dataclass(frozen=True)
class StationFaults:
    """What shall go wrong, for tests of what notices it.

    Attributes:
        misses: which closings of the grippers (the first is 1) fail to catch cloth.
        cameras: which exposures (the first is 1) fail, and how: see `camera_system.FAULTS`.
    """

    misses: frozenset[int] = frozenset()
    cameras: Mapping[int, str] = field(default_factory=dict)


class SimStation(Diagram):
    """A simulated station. Build it with `build_sim_station`.

    Attributes:
        cloth: the cloth's solver, for the meaning of `truth.cloth`.
        motion_log: the measured motion; give it the root context.
        plant: the robot's plant, for limits and names.
    """

    def __init__(
        self,
        cell: Cell,
        cloth: Cloth,
        state: ClothState,
        head: StereoHead,
        seed: int,
        start: Array,
        faults: StationFaults,
        player: PlayerSettings | None,
    ) -> None:
        """See `build_sim_station`."""
        super().__init__()
        self.cloth = cloth
        builder = DiagramBuilder()
        settings = cell.scenario.station
        arm = build_arm_plant(cell, settings.plant_step)
        self.plant = builder.AddNamedSystem("plant", arm.plant)
        measured = add_selections(builder, arm)
        controller = builder.AddSystem(
            ArmController(
                cell,
                start,
                step=settings.plant_step,
                feedback_period=settings.feedback_period,
                settings=player,
            )
        )
        grippers = builder.AddSystem(
            GripperSystem(
                cell.limits.gripper,
                cell.scenario.gripper.opening,
                cloth.material.thickness,
                period=settings.cloth_step,
                misses=faults.misses,
            )
        )
        gaze = cell.scenario.gaze
        unit = HeadSystem(
            head,
            cell.limits.head,
            (gaze[0], gaze[1]),
            seed=seed,
            period=settings.feedback_period,
        )
        units = builder.AddSystem(unit)
        tools = builder.AddSystem(ToolPoses(arm))
        sheet = builder.AddSystem(ClothSystem(cloth, state, period=settings.cloth_step))
        cameras = builder.AddSystem(
            CameraSystem(cell, cloth, state, head, seed=seed, faults=faults.cameras)
        )
        connect_servos(
            builder,
            arm,
            *(system.GetOutputPort("desired") for system in (controller, grippers, units)),
        )
        poses = arm.plant.get_body_poses_output_port()
        for source, target in (
            (measured["position"], controller.GetInputPort("position")),
            (measured["velocity"], controller.GetInputPort("velocity")),
            (measured["opening"], grippers.GetInputPort("opening")),
            (poses, tools.GetInputPort("poses")),
            (tools.GetOutputPort("tips"), sheet.GetInputPort("tips")),
            (grippers.GetOutputPort("pinch"), sheet.GetInputPort("pinch")),
            (sheet.GetOutputPort("answer"), grippers.GetInputPort("answer")),
            (units.GetOutputPort("status"), cameras.GetInputPort("head")),
            (measured["head"], cameras.GetInputPort("head_angles")),
            (measured["position"], cameras.GetInputPort("position")),
            (measured["velocity"], cameras.GetInputPort("velocity")),
            (sheet.GetOutputPort("cloth"), cameras.GetInputPort("cloth")),
        ):
            builder.Connect(source, target)
        for system, port, name in (
            (controller, "trajectory", "trajectory"),
            (grippers, "command", "gripper.command"),
            (units, "command", "head.command"),
            (controller, "speed_override", "speed_override"),
        ):
            builder.ExportInput(system.GetInputPort(port), name)
        for output, name in (
            (measured["position"], "joints.position_measured"),
            (measured["velocity"], "joints.velocity_measured"),
            (controller.GetOutputPort("status"), "controller.status"),
            (grippers.GetOutputPort("status"), "gripper.status"),
            (units.GetOutputPort("position"), "head.position_measured"),
            (cameras.GetOutputPort("left_image"), "head.left_image"),
            (cameras.GetOutputPort("right_image"), "head.right_image"),
            (cameras.GetOutputPort("depth_image"), "depth_camera.image"),
            (sheet.GetOutputPort("cloth"), "truth.cloth"),
            (sheet.GetOutputPort("coverage"), "truth.coverage"),
            (sheet.GetOutputPort("height"), "truth.height"),
            (tools.GetOutputPort("tips"), "truth.tips"),
        ):
            builder.ExportOutput(output, name)
        self.motion_log = _logged(
            builder, measured, controller.GetOutputPort("reference"), settings.plant_step
        )
        builder.BuildInto(self)
        self.set_name("station")
        self._stand(arm, start, unit)

    def _stand(self, arm: ArmPlant, start: Array, unit: HeadSystem) -> None:
        """Let every default context begin in the start posture, the head where its unit has it."""
        context = unit.CreateDefaultContext()
        angles = unit.GetOutputPort("position").Eval(context)
        plant = arm.plant
        q = plant.GetPositions(plant.CreateDefaultContext())
        q[arm.axes], q[arm.head] = start, angles
        plant.SetDefaultPositions(q)


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
) -> SimStation:
    """Build the simulated station, a diagram called "station".

    Args:
        cell: its scenario states the clocks, the sensor and the garment's texture.
        cloth: the solver of what lies on the table.
        state: how it lies at the start.
        head: the true stereo head.
        seed: of the head's rest errors, the cloth's fibres and the pictures' noise.
        start: (13,) posture of the axes, rad; home if left out.
        faults: what shall go wrong; nothing if left out.
        player: settings of the arms' controller.

    Raises:
        InputError: a start that is no posture or beyond the limits, clocks that are no multiples of
            the cloth's time step, an unknown texture, sensor or fault.
    """
    limits = cell.limits
    posture = np.array(cell.robot.named_states["home"] if start is None else start, dtype=float)
    if posture.shape != (13,) or not np.isfinite(posture).all():
        raise InputError(f"station: start posture {posture.shape} must be 13 finite angles, rad")
    over = np.maximum(limits.lower - posture, posture - limits.upper)
    if over.max() > 0.0:
        axis = int(over.argmax())
        raise InputError(
            f"station: start posture is {over[axis]:.4f} rad beyond the limit of "
            f"{cell.robot.axes[axis]}"
        )
    steps = cell.scenario.station.cloth_step / cloth.time_step
    if not math.isclose(steps, round(steps), rel_tol=1e-6):
        raise InputError(
            f"station: cloth_step {cell.scenario.station.cloth_step:g} s is no multiple of the "
            f"cloth's time step {cloth.time_step:g} s"
        )
    return SimStation(cell, cloth, state, head, seed, posture, faults or StationFaults(), player)


def _logged(
    builder: DiagramBuilder, measured: dict[str, OutputPort], reference: OutputPort, step: float
) -> MotionLog:
    ports = [measured["position"], measured["velocity"], reference]
    ports += [measured["opening"], measured["head"]]
    rows = builder.AddSystem(Multiplexer([port.size() for port in ports]))
    for number, port in enumerate(ports):
        builder.Connect(port, rows.get_input_port(number))
    sink = builder.AddNamedSystem("motion log", VectorLogSink(rows.get_output_port().size(), step))
    builder.Connect(rows.get_output_port(), sink.get_input_port())
    return MotionLog(sink)
