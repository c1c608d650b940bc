"""Bodies and motors of the robot as a discrete plant with a stiff servo at every joint.

The plant has no contact and almost no gravity: the interaction of fingers and cloth is computed by
the cloth system, plans are verified free of collision, and the servos of the real robot carry its
weight.
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

#: Natural frequency of every servo, Hz: as stiff as the plant's step allows, critically damped.
SERVO_FREQUENCY = 60.0
# ASSUMED, since no data sheet states them:
_ROTOR_INERTIA = 2e-4  # kg m^2
_LARGE_GEAR = 120.0  # gear ratio of the turn-table and of the axes S, L, U
_WRIST_GEAR = 80.0  # gear ratio of the wrist axes
_LARGE_AXES = (0, 1, 2, 3, 7, 8, 9)
_GRIPPER_FORCE = 60.0  # N
_HEAD_TORQUE = 10.0  # N m
#: Smallest inertia at a drive, kg or kg m^2: gears and motors of the gripper and the head.
_LEAST_INERTIA = 0.02
#: Residual gravity, m/s^2: the servos carry 99 % of the weight. With no gravity at all the contact
#: solver has no scale at rest: its impulses vanish, and it reports that it does not converge.
_RESIDUAL_GRAVITY = 0.0981


@dataclass(frozen=True, eq=False)
class ArmPlant:
    """Finalized plant with the indices of its joints.

    Attributes:
        plant: Plant of the cell, without contact.
        axes, grippers, head: Indices of the 13, 2 and 4 joints among the positions.
        tips: Body indices and poses X_BT (4, 4) of the tool frames on these bodies, right and left.
    """

    plant: MultibodyPlant
    axes: NDArray[np.intp]
    grippers: NDArray[np.intp]
    head: NDArray[np.intp]
    tips: tuple[tuple[int, Array], tuple[int, Array]]


def build_arm_plant(cell: Cell, step: float) -> ArmPlant:
    """Build the robot's plant with a time step in s and an implicit PD servo at each joint.

    The gains follow from the inertia I at the joint in the home posture: p = I w^2, d = 2 I w.
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
    plant.mutable_gravity_field().set_gravity_vector(np.array([0.0, 0.0, -_RESIDUAL_GRAVITY]))
    plant.Finalize()
    inertia = np.diag(plant.CalcMassMatrix(plant.CreateDefaultContext()))
    indices = position_indices(cell, plant)
    w = 2.0 * np.pi * SERVO_FREQUENCY
    order = np.concatenate([indices.axes, indices.grippers, indices.head])
    for actuator, index in zip(actuators, order, strict=True):
        at_joint = max(float(inertia[index]), _LEAST_INERTIA)
        actuator.set_controller_gains(PdControllerGains(p=at_joint * w * w, d=2.0 * at_joint * w))
    return ArmPlant(
        plant, indices.axes, indices.grippers, indices.head, (_tip(plant, "r1"), _tip(plant, "r2"))
    )


def add_selections(builder: DiagramBuilder, arm: ArmPlant) -> dict[str, OutputPort]:
    """Add output ports with the plant's positions and velocities by group.

    Returns:
        Ports `position` and `velocity` (13,), `opening` (2,), `head` and `head_velocity` (4,).
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
    """Connect the desired states of the servos, each instance's positions before its velocities.

    Args:
        builder: Builder that contains the plant.
        arm: The plant.
        axes: Port (26,): turn-table 1 + 1, right arm 6 + 6, left arm 6 + 6.
        grippers: Port (4,): right 1 + 1, left 1 + 1.
        head: Port (8,): left unit 2 + 2, right unit 2 + 2.
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
            desired = arm.plant.get_desired_state_input_port(instance)
            builder.Connect(split.get_output_port(number), desired)


class ToolPosesSystem(LeafSystem):
    """Compute X_WT (2, 4, 4) of the right and the left tool, as one vector (32,)."""

    def __init__(self, arm: ArmPlant) -> None:
        """Keep the tools of a plant."""
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
