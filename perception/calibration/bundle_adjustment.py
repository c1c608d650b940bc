"""Bundle adjustment: every corner of every board at once.

Levenberg-Marquardt over the poses and intrinsics of a rig (see `rig`). Each shot weighs by its own
noise, and joints that are known to some noise only are unknowns with a prior.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from unwrinkle.perception.calibration._bundle_problem import (
    BundleProblem,
    State,
    levenberg_marquardt,
)
from unwrinkle.perception.calibration.rig import BoardObservation, Rig

_FIRST_NOISE = 0.1  # pixels
_WEIGHINGS = 3
_WEIGHINGS_LEARNING = 6
_LEAST_NOISE = 0.5  # of the median shot's
_FIRST_JOINT_NOISE = 2e-4  # radians
_LEAST_JOINT_NOISE = 1e-7


@dataclass(frozen=True, eq=False)
class Adjustment:
    """Outcome of a bundle adjustment.

    Attributes:
        rig: the best one.
        shot_rms: (shots,) RMS distance of corners from where they should be, pixels.
        rms: of all corners, pixels.
        mount_sigma: (eyes, 6) standard deviations of the mounts' twists; 0 where held.
        camera_sigma: (eyes, 6) standard deviations of fx, fy, cx, cy, k1, k2; 0 where held.
        base_sigma: (bases, 6) as `mount_sigma`.
        joint_errors: (shots, 2) errors found of the joints known to some noise, radians.
        joint_noise: their standard deviation, as given or as found, radians.
        residuals: (shots) arrays (n, 2) of seen minus predicted corners, pixels.
    """

    rig: Rig
    shot_rms: NDArray[np.float64]
    rms: float
    mount_sigma: NDArray[np.float64]
    camera_sigma: NDArray[np.float64]
    base_sigma: NDArray[np.float64]
    joint_errors: NDArray[np.float64]
    joint_noise: float
    residuals: tuple[NDArray[np.float64], ...]


def adjust(
    rig: Rig,
    shots: list[BoardObservation],
    *,
    intrinsics: bool = True,
    mounts: bool = True,
    bases: bool = True,
    joint_noise: float | None = 0.0,
) -> Adjustment:
    """Find the rig that puts every corner closest to where it was seen.

    Each shot weighs by its own noise, which is what its corners still miss by: a view that is
    blurred, or was taken in motion, tells less than the others.

    Args:
        rig: where to start; p1, p2 and k3 of its cameras stay as they are.
        shots: at least one for each eye, base and board.
        intrinsics, mounts, bases: whether these are unknown; boards always are.
        joint_noise: standard deviation of the joints' angles, radians; 0 takes them as exact, None
            finds it (by expectation maximisation).

    Raises:
        InputError: the corners do not determine the unknowns.
    """
    noise = np.full(len(shots), _FIRST_NOISE)
    spread_of_joints = _FIRST_JOINT_NOISE if joint_noise is None else joint_noise
    start: State | None = None
    for _ in range(_WEIGHINGS_LEARNING if joint_noise is None else _WEIGHINGS):
        problem = BundleProblem(rig, shots, intrinsics, mounts, bases, spread_of_joints, noise)
        state, covariance = levenberg_marquardt(problem, start)
        start = state
        residual = problem.misses(*state)
        pieces = tuple(np.split(residual, problem.starts[1:]))
        shot_rms = np.array([_rms(piece) for piece in pieces])
        floor = _LEAST_NOISE * float(np.median(shot_rms))
        noise = np.maximum(np.maximum(shot_rms, floor), 1e-6) / np.sqrt(2.0)
        sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        if joint_noise is None and state[1].size:
            found_sigma = sigma[problem.joint_start :]
            variance = float(np.mean(state[1] ** 2 + found_sigma**2))
            spread_of_joints = max(np.sqrt(variance), _LEAST_JOINT_NOISE)
    joints = np.append(state[1], 0.0)
    slots = problem.joint_slots - problem.joint_start
    joint_errors = joints[np.where(problem.joint_slots >= 0, slots, -1)]

    def spread(slots: NDArray[np.intp]) -> NDArray[np.float64]:
        found = np.zeros((len(slots), 6))
        for row, slot in enumerate(slots):
            if slot >= 0:
                found[row] = sigma[slot : slot + 6]
        return found

    return Adjustment(
        rig=state[0],
        shot_rms=shot_rms,
        rms=_rms(residual),
        mount_sigma=spread(problem.mount_slots),
        camera_sigma=spread(problem.camera_slots),
        base_sigma=spread(problem.base_slots),
        joint_errors=joint_errors,
        joint_noise=spread_of_joints,
        residuals=pieces,
    )


def _rms(residual: NDArray[np.float64]) -> float:
    """RMS length of 2-D residuals."""
    return float(np.sqrt(np.mean(np.sum(residual**2, axis=-1))))
