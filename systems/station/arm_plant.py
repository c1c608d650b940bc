"""The robot's bodies and motors: a discrete plant with stiff servos at every joint.

There is no contact and next to no gravity in it: the fingers' play with the cloth is the cloth
system's affair, plans are verified against collision, and the servos of the real robot carry its weight.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import PdControllerGains
from pydrake.systems.framework import BasicVector, Context, DiagramBuilder, LeafSystem, OutputPort
from pydrake.systems.primitives import Demultiplexer, MatrixGain

from unwrinkle.models.arrays import Array
from unwrinkle.models.robot import Cell, add_cell, position_indices, scoped

#: Natural frequency of every servo, Hz: as stiff as the plant's steps allow, critically damped.
SERVO_FREQUENCY = 60.0
# ASSUMED, since no data sheet states them: the rotor's inertia (kg m^2) with the gear ratio of the
# large axes (turn-table, S, L, U) and of the wrist; what the small drives can push (N, N m).
_ROTOR_INERTIA = 2e-4
_LARGE_GEAR, _WRIST_GEAR = 120.0, 80.0
_LARGE_AXES = (0, 1, 2, 3, 7, 8, 9)
_GRIPPER_FORCE = 60.0
_HEAD_TORQUE = 10.0
# The gripper's and the head's drives hold at least this inertia (kg, kg m^2): gears and motor.
_LEAST_INERTIA = 0.02
# The servos carry the weight but for 1 % of it, m/s^2. With none at all the contact solver has no
# scale at rest: its impulses vanish, and it reports that it does not converge.
_WEIGHT_LEFT = 0.0981


@dataclass(frozen=True, eq=False)
class ArmPlant:
    """A finalized plant and where its numbers stand.

    Attributes:
        plant: of the cell, without contact.
        axes, grippers, head: numbers of the 13, 2 and 4 joints among the positions.
        tips: body numbers and the tool frames' poses on them, X_BT (4, 4), right and left.
    """

    plant: MultibodyPlant
    axes: NDArray[np.intp]
    grippers: NDArray[np.intp]
    head: NDArray[np.intp]
    tips: tuple[tuple[int, Array], tuple[int, Array]]


def build_arm_plant(cell: Cell, step: float) -> ArmPlant:
    """The cell's robot as a plant of a step in s, each joint driven by an implicit PD servo.

    Gains follow from the inertia I that a joint sees at home: p = I w^2, d = 2 I w.
    """
    plant = MultibodyPlant(time_step=step)
    add_cell(cell, plant, Parser(plant))
    robot = cell.robot
    efforts = [*cell.limits.effort, *[_GRIPPER_FORCE] * 2, *[_HEAD_TORQUE] * 4]
    actuators = []
    for name, effort in zip([*robot.axes, *robot.grippers, *robot.head], efforts, strict=True):
        instance, element = scoped(name)
        joint = plant.GetJointByName(element, plant.GetModelInstanceByName(instance))
        actuator = plant.AddJointActuator(f"{instance}_{element}", joint, float(effort))
        actuator.set_controller_gains(PdControllerGains(p=1.0, d=1.0))
        actuators.append(actuator)
    for number in range(len(robot.axes)):
        actuators[number].set_default_rotor_inertia(_ROTOR_INERTIA)
        gear = _LARGE_GEAR if number in _LARGE_AXES else _WRIST_GEAR
        actuators[number].set_default_gear_ratio(gear)
    plant.mutable_gravity_field().set_gravity_vector(np.array([0.0, 0.0, -_WEIGHT_LEFT]))
    plant.Finalize()
    inertia = np.diag(plant.CalcMassMatrix(plant.CreateDefaultContext()))
    indices = position_indices(cell, plant)
    w = 2.0 * np.pi * SERVO_FREQUENCY
    order = np.concatenate([indices.axes, indices.grippers, indices.head])
    for actuator, index in zip(actuators, order, strict=True):
        felt = max(float(inertia[index]), _LEAST_INERTIA)
        actuator.set_controller_gains(PdControllerGains(p=felt * w * w, d=2.0 * felt * w))
    return ArmPlant(
        plant, indices.axes, indices.grippers, indices.head, (_tip(plant, "r1"), _tip(plant, "r2"))
    )


def add_selections(builder: DiagramBuilder, arm: ArmPlant) -> dict[str, OutputPort]:
    """Ports with the plant's positions and velocities, sorted.

    Returns:
        `position` and `velocity` (13,), `opening` (2,), `head` and `head_velocity` (4,).
    """
    plant = arm.plant
    count = plant.num_positions()
    picks = {
        "position": arm.axes,
        "velocity": count + arm.axes,
        "opening": arm.grippers,
        "head": arm.head,
        "head_velocity": count + arm.head,
    }
    ports = {}
    for name, numbers in picks.items():
        gain = builder.AddNamedSystem(f"measured {name}", MatrixGain(np.eye(2 * count)[numbers]))
        builder.Connect(plant.get_state_output_port(), gain.get_input_port())
        ports[name] = gain.get_output_port()
    return ports


def connect_servos(
    builder: DiagramBuilder, arm: ArmPlant, axes: OutputPort, grippers: OutputPort, head: OutputPort
) -> None:
    """Connect what the servos are asked for, each instance's positions before its velocities.

    Args:
        builder: that has the plant.
        arm: the plant.
        axes: (26,) turn-table 1 + 1, right arm 6 + 6, left arm 6 + 6.
        grippers: (4,) right 1 + 1, left 1 + 1.
        head: (8,) left unit 2 + 2, right unit 2 + 2.
    """
    for port, parts in (
        (axes, (("turntable", 2), ("r1", 12), ("r2", 12))),
        (grippers, (("r1_gripper", 2), ("r2_gripper", 2))),
        (head, (("left_ptu", 4), ("right_ptu", 4))),
    ):
        split = builder.AddSystem(Demultiplexer([size for _, size in parts]))
        builder.Connect(port, split.get_input_port())
        for number, (name, _) in enumerate(parts):
            instance = arm.plant.GetModelInstanceByName(name)
            wanted = arm.plant.get_desired_state_input_port(instance)
            builder.Connect(split.get_output_port(number), wanted)


class ToolPoses(LeafSystem):
    """X_WT of the right and the left tool, (2, 4, 4) in one vector of 32, from the bodies' poses."""

    def __init__(self, arm: ArmPlant) -> None:
        """Of the tools of a plant."""
        super().__init__()
        self.set_name("tools")
        self._tips = arm.tips
        port = arm.plant.get_body_poses_output_port()
        self._poses = self.DeclareAbstractInputPort("poses", port.Allocate())
        self.DeclareVectorOutputPort("tips", BasicVector(32), self._calc)

    def _calc(self, context: Context, output: BasicVector) -> None:
        X_WB = self._poses.Eval(context)
        X_WT = [X_WB[body].GetAsMatrix4() @ X_BT for body, X_BT in self._tips]
        output.SetFromVector(np.array(X_WT).ravel())


def _tip(plant: MultibodyPlant, side: str) -> tuple[int, Array]:
    frame = plant.GetFrameByName("tcp", plant.GetModelInstanceByName(f"{side}_gripper"))
    X_BT = np.asarray(frame.GetFixedPoseInBodyFrame().GetAsMatrix4(), dtype=float)
    return int(frame.body().index()), X_BT
