"""Simulated part that the `sim` and `loopback` stations share.

Bodies and motors, cloth, cameras, `truth` outputs.

Each form of the station adds its controls: the systems that receive the commands at the ports and
drive the machines.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike
from pydrake.systems.framework import (
    DiagramBuilder,
    InputPort,
    OutputPort,
)
from pydrake.systems.primitives import Multiplexer, VectorLogSink

from unwrinkle.models.arrays import Array
from unwrinkle.models.cloth import load_material
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell
from unwrinkle.models.scenario import StationForm
from unwrinkle.models.site import Site
from unwrinkle.perception.stereo.head import StereoHead
from unwrinkle.simulation.cloth.cloth import Cloth, ClothState
from unwrinkle.simulation.cloth.outlines import outline
from unwrinkle.systems.station.arm_plant import (
    ArmPlant,
    ToolPosesSystem,
    add_selections,
    build_arm_plant,
    connect_servos,
)
from unwrinkle.systems.station.base import Station
from unwrinkle.systems.station.cameras import CameraSystem
from unwrinkle.systems.station.cloth import ClothSystem
from unwrinkle.systems.station.grippers import GripperSystem
from unwrinkle.systems.station.head import HeadSystem
from unwrinkle.systems.station.motion_log import MotionLog


@dataclass(frozen=True)
class StationFaults:
    """Faults to simulate, for tests of their detection.

    Attributes:
        misses: numbers of the gripper closings, from 1, that fail to catch cloth.
        cameras: fault of each failing exposure by its number, from 1; see `cameras.FAULTS`.
    """

    misses: frozenset[int] = frozenset()
    cameras: Mapping[int, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class World:
    """Simulated machines that the controls drive.

    Attributes:
        cell: robot and cell.
        start: (13,) initial posture of the axes, rad.
        measured: output ports of the plant, see `add_selections`.
        grippers: mechanics of the grippers.
        units: mechanics of the pan-tilt units.
    """

    cell: Cell
    start: Array
    measured: dict[str, OutputPort]
    grippers: GripperSystem
    units: HeadSystem


@dataclass(frozen=True, eq=False)
class StationControls:
    """Ports of the controls that a form of the station adds.

    Attributes:
        inputs: by the station's port names: trajectory, speed_override, gripper.command,
            head.command.
        outputs: by the station's port names: joints, controller, grippers, head.
        desired: (26,) desired states of the axes' servos.
        reference: (14,) for the motion log: reference positions of the axes, and number of the
            trajectory.
        head: `HeadStatus` that triggers the cameras.
    """

    inputs: Mapping[str, InputPort]
    outputs: Mapping[str, OutputPort]
    desired: OutputPort
    reference: OutputPort
    head: OutputPort


ControlsBuilder = Callable[[DiagramBuilder, World], StationControls]


class SimulatedStation(Station):
    """Station whose robot, head, cameras and cloth are simulated.

    Attributes:
        motion_log: measured motion; its methods take the root context.
        plant: plant of the robot, for limits and names.
    """

    cloth: Cloth  # interprets `truth.cloth`

    def __init__(
        self,
        cell: Cell,
        cloth: Cloth,
        state: ClothState,
        head: StereoHead,
        *,
        seed: int,
        start: Array,
        faults: StationFaults,
        controls: ControlsBuilder,
        form: StationForm = StationForm.SIM,
        site: Site | None = None,
    ) -> None:
        """Build the diagram; see `make_station`."""
        super().__init__()
        self.cell, self.cloth, self.head, self.seed = cell, cloth, head, seed
        self.form, self.site = form, site
        builder = DiagramBuilder()
        settings = cell.scenario.station
        arm = build_arm_plant(cell, settings.plant_step)
        self.plant = builder.AddNamedSystem("plant", arm.plant)
        measured = add_selections(builder, arm)
        grippers = GripperSystem(
            cell.limits.gripper,
            cell.scenario.gripper.opening,
            cloth.material.thickness,
            period=settings.cloth_step,
            misses=faults.misses,
        )
        pan, tilt = cell.scenario.gaze
        units = HeadSystem(
            head, cell.limits.head, (pan, tilt), seed=seed, period=settings.feedback_period
        )
        builder.AddSystem(grippers)
        builder.AddSystem(units)
        added = controls(builder, World(cell, start, measured, grippers, units))
        tools, sheet = ToolPosesSystem(arm), ClothSystem(cloth, state, period=settings.cloth_step)
        cameras = CameraSystem(cell, cloth, state, head, seed=seed, faults=faults.cameras)
        builder.AddSystem(tools)
        builder.AddSystem(sheet)
        builder.AddSystem(cameras)
        desired = (added.desired, grippers.GetOutputPort("desired"), units.GetOutputPort("desired"))
        connect_servos(builder, arm, *desired)
        for source, target in (
            (measured["opening"], grippers.GetInputPort("opening")),
            (arm.plant.get_body_poses_output_port(), tools.GetInputPort("poses")),
            (tools.GetOutputPort("tips"), sheet.GetInputPort("tips")),
            (grippers.GetOutputPort("pinch"), sheet.GetInputPort("pinch")),
            (sheet.GetOutputPort("answer"), grippers.GetInputPort("answer")),
            (added.head, cameras.GetInputPort("head")),
            (measured["head"], cameras.GetInputPort("head_angles")),
            (measured["position"], cameras.GetInputPort("position")),
            (measured["velocity"], cameras.GetInputPort("velocity")),
            (sheet.GetOutputPort("cloth"), cameras.GetInputPort("cloth")),
        ):
            builder.Connect(source, target)
        for name, port in added.inputs.items():
            builder.ExportInput(port, name)
        outputs = {
            **added.outputs,
            "head.left_image": cameras.GetOutputPort("left_image"),
            "head.right_image": cameras.GetOutputPort("right_image"),
            "depth_camera.image": cameras.GetOutputPort("depth_image"),
            "truth.cloth": sheet.GetOutputPort("cloth"),
            "truth.coverage": sheet.GetOutputPort("coverage"),
            "truth.height": sheet.GetOutputPort("height"),
            "truth.tips": tools.GetOutputPort("tips"),
        }
        for name, output in outputs.items():
            builder.ExportOutput(output, name)
        self.motion_log = _logged(builder, measured, added.reference, settings.plant_step)
        builder.BuildInto(self)
        self.set_name("station")
        self._set_start(arm, start, units)

    def _set_start(self, arm: ArmPlant, start: Array, units: HeadSystem) -> None:
        """Set the start posture and the head's reported angles in every default context."""
        context = units.CreateDefaultContext()
        angles = units.GetOutputPort("position").Eval(context)
        plant = arm.plant
        q = plant.GetPositions(plant.CreateDefaultContext())
        q[arm.axes], q[arm.head] = start, angles
        plant.SetDefaultPositions(q)


def simulated_cloth(cell: Cell) -> Cloth:
    """Build the solver of the scenario's garment on the cell's table.

    Raises:
        InputError: the outline or material is unknown, or the garment is larger than the table.
    """
    garment, table = cell.scenario.station.garment, cell.table
    shape = outline(garment.outline, garment.nodes)
    size = shape.spacing * (np.array(shape.mask.shape) - 1)
    if np.any(size > np.array(table.size)):
        raise InputError(
            f"a {garment.outline} of {size[0]:.2f} x {size[1]:.2f} m is larger than the table of "
            f"{table.size[0]:.2f} x {table.size[1]:.2f} m; choose a smaller garment or another "
            "table"
        )
    return Cloth(shape, load_material(garment.material), table)


def start_posture(cell: Cell, cloth: Cloth, start: ArrayLike | None) -> Array:
    """Check the start of a simulated station and return its posture (13,), rad; home if left out.

    Raises:
        InputError: the start is no posture or beyond the limits, or a period is no multiple of the
            cloth's time step.
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
    return posture


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
