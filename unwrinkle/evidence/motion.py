"""Dense samples of a plan's motion: poses and velocities of the robot's bodies."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Role
from pydrake.multibody.plant import MultibodyPlant

from unwrinkle.models.arrays import Array
from unwrinkle.models.robot import Cell
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.verification.motion import legs
from unwrinkle.viewer.cell_bodies import BodyShape, CellBodies

#: Time between samples, s.
SAMPLE_STEP = 0.002


@dataclass(frozen=True, eq=False)
class SampledMotion:
    """Bodies that the robot moves, along a plan at its own speed.

    Attributes:
        times: (n,) on the plan's clock, s.
        names: scoped names of the bodies that have a shape of the collision checks.
        shapes: of each body.
        masses: (B,) kg.
        X_WB: (n, B, 4, 4) poses in the world, m.
        v_WB, w_WB: (n, B, 3) velocities of the bodies' origins, m/s, and angular velocities, rad/s.
        energies: (n, B) kinetic energies, J.
        total_energies: (n,) of the whole robot, bodies without a shape included, J.
        p_WT, v_WT: (n, 2, 3) tool centre points of the right and the left arm, m and m/s.
    """

    times: Array
    names: tuple[str, ...]
    shapes: tuple[tuple[BodyShape, ...], ...]
    masses: Array
    X_WB: Array
    v_WB: Array
    w_WB: Array
    energies: Array
    total_energies: Array
    p_WT: Array
    v_WT: Array


def sampled_motion(plan: FlatteningPlan, cell: Cell, step: float = SAMPLE_STEP) -> SampledMotion:
    """Sample a plan's motion, gripper strokes included.

    Args:
        plan: made for the cell.
        cell: the robot in its cell.
        step: greatest time between samples, s.
    """
    found = CellBodies(cell, Role.kProximity)
    plant, context = found.plant, found.context
    moving = np.flatnonzero(found.moving)
    bodies = [found.bodies[i] for i in moving]
    tips = [
        plant.GetFrameByName("tcp", plant.GetModelInstanceByName(arm.gripper))
        for arm in cell.robot.arms
    ]
    # Spatial inertia about the body's origin, in the body's frame.
    inertias = [body.CalcSpatialInertiaInBodyFrame(context).CopyToFullMatrix6() for body in bodies]
    times, positions, velocities = _samples(plan, cell, step)
    q, v = plant.GetPositions(context), np.zeros(plant.num_velocities())
    columns = found.columns
    rates = _velocity_columns(cell, plant)
    count = len(times)
    X_WB = np.empty((count, len(bodies), 4, 4))
    v_WB, w_WB = np.empty((2, count, len(bodies), 3))
    energies = np.empty((count, len(bodies)))
    total = np.empty(count)
    p_WT, v_WT = np.empty((2, count, 2, 3))
    world = plant.world_frame()
    for k in range(count):
        q[columns], v[rates] = positions[k], velocities[k]
        plant.SetPositions(context, q)
        plant.SetVelocities(context, v)
        total[k] = plant.CalcKineticEnergy(context)
        for b, body in enumerate(bodies):
            X_WB[k, b] = plant.EvalBodyPoseInWorld(context, body).GetAsMatrix4()
            V = plant.EvalBodySpatialVelocityInWorld(context, body)
            w_WB[k, b], v_WB[k, b] = V.rotational(), V.translational()
        for i, frame in enumerate(tips):
            p_WT[k, i] = frame.CalcPoseInWorld(context).translation()
            v_WT[k, i] = frame.CalcSpatialVelocity(context, world, world).translational()
    for b, inertia in enumerate(inertias):
        R_BW = np.swapaxes(X_WB[:, b, :3, :3], 1, 2)
        V_B = np.concatenate(
            [
                np.einsum("nij,nj->ni", R_BW, w_WB[:, b]),
                np.einsum("nij,nj->ni", R_BW, v_WB[:, b]),
            ],
            axis=1,
        )
        energies[:, b] = 0.5 * np.einsum("ni,ij,nj->n", V_B, inertia, V_B)
    return SampledMotion(
        times=times,
        names=tuple(found.names[i] for i in moving),
        shapes=tuple(tuple(found.shapes[i]) for i in moving),
        masses=np.array([body.get_mass(context) for body in bodies]),
        X_WB=X_WB,
        v_WB=v_WB,
        w_WB=w_WB,
        energies=energies,
        total_energies=total,
        p_WT=p_WT,
        v_WT=v_WT,
    )


def _samples(plan: FlatteningPlan, cell: Cell, step: float) -> tuple[Array, Array, Array]:
    """Return times (n,), positions (n, 15) and velocities (n, 15): the plan's samples and more."""
    parts = []
    for leg in legs(plan, cell.scenario.gripper.opening):
        begin, end = float(leg.times[0]), float(leg.times[-1])
        even = np.linspace(begin, end, int(np.ceil((end - begin) / step)) + 1)
        parts.append(leg.at_times(np.unique(np.concatenate([even, leg.times]))))
    return (
        np.concatenate([part.times for part in parts]),
        np.concatenate([part.positions for part in parts]),
        np.concatenate([part.velocities for part in parts]),
    )


def _velocity_columns(cell: Cell, plant: MultibodyPlant) -> NDArray[np.intp]:
    """Return the places of the axes' and the grippers' rates in the plant's velocities."""
    found = []
    for name in [*cell.robot.axes, *cell.robot.grippers]:
        instance, _, joint = name.rpartition("::")
        model = plant.GetModelInstanceByName(instance)
        found.append(plant.GetJointByName(joint, model).velocity_start())
    return np.array(found, dtype=np.intp)
