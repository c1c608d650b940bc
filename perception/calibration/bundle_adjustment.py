"""Bundle adjustment over all corners of all calibration boards.

Levenberg-Marquardt over the poses and intrinsics of a rig (see `rig`). Each board observation is
weighted by its own noise; joint angles with a known noise are unknowns with a prior.
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

#: Initial noise of a corner, pixels.
_INITIAL_NOISE_PX = 0.1

#: Number of reweighted adjustments.
_REWEIGHTINGS = 3

#: The same if the joints' noise is estimated.
_REWEIGHTINGS_WITH_JOINTS = 6

#: Least noise of an observation, fraction of the median one's.
_MIN_NOISE_FRACTION = 0.5

#: Initial noise of the joints, radians.
_INITIAL_JOINT_NOISE_RAD = 2e-4

#: Least noise of the joints, radians.
_MIN_JOINT_NOISE_RAD = 1e-7


@dataclass(frozen=True, eq=False)
class Adjustment:
    """Outcome of a bundle adjustment.

    Attributes:
        rig: the estimated rig.
        shot_rms: (observations,) RMS reprojection error, pixels.
        rms: RMS reprojection error of all corners, pixels.
        mount_sigma: (eyes, 6) standard deviations of the mounts' twists; 0 if held.
        camera_sigma: (eyes, 6) standard deviations of fx, fy, cx, cy, k1, k2; 0 if held.
        base_sigma: (bases, 6) as `mount_sigma`.
        joint_errors: (observations, 2) estimated errors of the joint angles, radians.
        joint_noise: standard deviation of the joint angles, given or estimated, radians.
        residuals: array (n, 2) of seen minus predicted corners for each observation, pixels.
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
    """Estimate the rig that minimises the weighted reprojection error.

    Each observation is weighted by its own noise, estimated from its residuals, so that views that
    are blurred or taken in motion count less.

    Args:
        rig: initial rig; p1, p2 and k3 of its cameras are held.
        shots: board observations, at least one for each eye, base and board.
        intrinsics, mounts, bases: whether these are unknowns; board poses always are.
        joint_noise: standard deviation of the joint angles, radians; 0 for exact angles, None
            estimates it (by expectation maximisation).

    Raises:
        InputError: the corners do not determine the unknowns.
    """
    noise = np.full(len(shots), _INITIAL_NOISE_PX)
    spread_of_joints = _INITIAL_JOINT_NOISE_RAD if joint_noise is None else joint_noise
    start: State | None = None
    for _ in range(_REWEIGHTINGS_WITH_JOINTS if joint_noise is None else _REWEIGHTINGS):
        problem = BundleProblem(rig, shots, intrinsics, mounts, bases, spread_of_joints, noise)
        state, covariance = levenberg_marquardt(problem, start)
        start = state
        residual = problem.misses(*state)
        pieces = tuple(np.split(residual, problem.starts[1:]))
        shot_rms = np.array([_rms(piece) for piece in pieces])
        floor = _MIN_NOISE_FRACTION * float(np.median(shot_rms))
        noise = np.maximum(np.maximum(shot_rms, floor), 1e-6) / np.sqrt(2.0)
        sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        if joint_noise is None and state[1].size:
            found_sigma = sigma[problem.joint_start :]
            variance = float(np.mean(state[1] ** 2 + found_sigma**2))
            spread_of_joints = max(np.sqrt(variance), _MIN_JOINT_NOISE_RAD)
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
    """Return the RMS length of residuals (..., 2)."""
    return float(np.sqrt(np.mean(np.sum(residual**2, axis=-1))))
