"""Greatest speed and kinetic energy of each body, and the box that bounds its motion."""

from dataclasses import dataclass

import numpy as np

from unwrinkle.evidence.motion import SampledMotion
from unwrinkle.models.arrays import Array
from unwrinkle.viewer.cell_bodies import BodyShape

#: Signs of a box's corners.
_CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])


@dataclass(frozen=True)
class BodyMotion:
    """Motion of one body over a plan at its own speed.

    Attributes:
        name: scoped name.
        mass: kg, of the model.
        speed: greatest speed of a corner of the boxes around the body's shapes, m/s; no point of
            the body is faster at the samples.
        speed_time: on the plan's clock, s.
        energy: greatest kinetic energy, J.
        energy_time: on the plan's clock, s.
        lower, upper: bounds (3,) in the world of those corners at the samples, m.
    """

    name: str
    mass: float
    speed: float
    speed_time: float
    energy: float
    energy_time: float
    lower: tuple[float, float, float]
    upper: tuple[float, float, float]


def body_motions(motion: SampledMotion) -> tuple[BodyMotion, ...]:
    """Find the extremes of every body's motion, in the order of `motion.names`."""
    found = []
    for b, name in enumerate(motion.names):
        corners_B = np.concatenate([corners(shape) for shape in motion.shapes[b]])
        r_W = np.einsum("nij,cj->nci", motion.X_WB[:, b, :3, :3], corners_B)
        speeds = np.linalg.norm(
            motion.v_WB[:, b, None] + np.cross(motion.w_WB[:, b, None], r_W), axis=2
        ).max(axis=1)
        p_W = motion.X_WB[:, b, None, :3, 3] + r_W
        low, high = p_W.min(axis=(0, 1)), p_W.max(axis=(0, 1))
        energies = motion.energies[:, b]
        fastest, strongest = int(speeds.argmax()), int(energies.argmax())
        found.append(
            BodyMotion(
                name=name,
                mass=float(motion.masses[b]),
                speed=float(speeds[fastest]),
                speed_time=float(motion.times[fastest]),
                energy=float(energies[strongest]),
                energy_time=float(motion.times[strongest]),
                lower=(float(low[0]), float(low[1]), float(low[2])),
                upper=(float(high[0]), float(high[1]), float(high[2])),
            )
        )
    return tuple(found)


def corners(shape: BodyShape) -> Array:
    """Return the corners (8, 3) of the box around a shape, in the body's frame, m."""
    points = _CORNERS * np.array(shape.size)
    return np.asarray(points @ shape.X_BG[:3, :3].T + shape.X_BG[:3, 3])
