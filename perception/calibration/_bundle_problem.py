"""Least-squares problem of a bundle adjustment with analytic derivatives, and its solver.

Poses are updated by X <- X exp(twist); a twist is (v, w), metres and radians, in the pose's frame.
"""

import logging

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from unwrinkle.models.arrays import Pose
from unwrinkle.models.errors import InputError
from unwrinkle.models.transforms import inverse
from unwrinkle.perception.calibration.projection import (
    INTRINSICS,
    constants,
    crosses,
    project_with_derivatives,
    with_step,
)
from unwrinkle.perception.calibration.rig import BoardObservation, Rig, moved

#: Limit of Levenberg-Marquardt steps.
_MAX_STEPS = 60

#: Relative decrease of the cost at convergence.
_CONVERGED = 1e-8

#: Limit of the damping.
_MAX_DAMPING = 1e12

_log = logging.getLogger(__name__)

State = tuple[Rig, NDArray[np.float64]]


class BundleProblem:
    """Residuals of a bundle adjustment and their derivatives by one vector of unknowns."""

    def __init__(
        self,
        rig: Rig,
        shots: list[BoardObservation],
        intrinsics: bool,
        mounts: bool,
        bases: bool,
        joint_noise: float,
        noise: NDArray[np.float64],
    ) -> None:
        self.shots = shots
        lengths = np.array([len(shot.view.corners) for shot in shots])
        self.starts = np.concatenate([[0], np.cumsum(lengths)[:-1]])
        self.shot = np.repeat(np.arange(len(shots)), lengths)
        self.points = np.concatenate([shot.view.points_T for shot in shots])
        self.seen = np.concatenate([shot.view.corners for shot in shots])
        self.count = 2 * len(self.points)
        self.eye, self.base, self.board = (
            np.array([getattr(shot, key) for shot in shots]) for key in ("eye", "base", "board")
        )
        self.size = 0
        self.camera_slots = self._slots(len(rig.cameras), intrinsics)
        self.mount_slots = self._slots(len(rig.mounts), mounts)
        self.base_slots = self._slots(len(rig.bases), bases, held=1)
        self.board_slots = self._slots(len(rig.boards), True)
        self.joint_slots = np.full((len(shots), 2), -1)
        self.joint_start = self.size
        if joint_noise > 0.0:
            taken: dict[tuple[int, int], NDArray[np.intp]] = {}
            for row, shot in enumerate(shots):
                k = len(shot.axes)
                if k == 0:
                    continue
                slots = taken.get((shot.eye, shot.stop))
                if slots is None:
                    slots = taken[shot.eye, shot.stop] = self.size + np.arange(k)
                    self.size += k
                self.joint_slots[row, :k] = slots
        self.weight = 1.0 / noise[self.shot]
        self.prior = 1.0 / joint_noise if joint_noise > 0.0 else 0.0
        self.start: State = rig, np.zeros(self.size - self.joint_start)

    def _slots(self, count: int, free: bool, held: int = 0) -> NDArray[np.intp]:
        """Allocate `count` blocks of six unknowns; return the first index of each, -1 if held."""
        slots = np.full(count, -1)
        if free:
            slots[held:] = self.size + 6 * np.arange(count - held)
            self.size += 6 * (count - held)
        return slots

    def retract(self, state: State, step: NDArray[np.float64]) -> State:
        rig, joints = state

        def poses(old: tuple[Pose, ...], slots: NDArray[np.intp]) -> tuple[Pose, ...]:
            return tuple(
                moved(X, step[s : s + 6]) if s >= 0 else X for X, s in zip(old, slots, strict=True)
            )

        cameras = tuple(
            with_step(camera, step[s : s + INTRINSICS]) if s >= 0 else camera
            for camera, s in zip(rig.cameras, self.camera_slots, strict=True)
        )
        changed = Rig(
            cameras,
            poses(rig.mounts, self.mount_slots),
            poses(rig.bases, self.base_slots),
            poses(rig.boards, self.board_slots),
        )
        return changed, joints + step[self.joint_start :]

    def _chain(self, state: State) -> tuple[NDArray[np.float64], ...]:
        """Return the points in C, M, B, and R_CM, R_CB, R_CT of each observation."""
        rig, joints = state
        X_CM = np.array([inverse(X) for X in rig.mounts])[self.eye]
        X_BA = np.array([inverse(X) for X in rig.bases])[self.base]
        X_AT = np.array(rig.boards)[self.board]
        X_MB = np.array(
            [
                inverse(self._mount(shot, slots, joints))
                for shot, slots in zip(self.shots, self.joint_slots, strict=True)
            ]
        )
        X_BT = X_BA @ X_AT
        X_MT = X_MB @ X_BT
        X_CT = X_CM @ X_MT
        p_C, p_M, p_B = (
            np.einsum("nij,nj->ni", X[self.shot, :3, :3], self.points) + X[self.shot, :3, 3]
            for X in (X_CT, X_MT, X_BT)
        )
        R_CM = X_CM[:, :3, :3]
        R_CB = R_CM @ X_MB[:, :3, :3]
        return p_C, p_M, p_B, R_CM, R_CB, X_CT[:, :3, :3]

    def _mount(
        self, shot: BoardObservation, slots: NDArray[np.intp], joints: NDArray[np.float64]
    ) -> Pose:
        if slots[0] < 0:
            return shot.X_BM
        return moved(shot.X_BM, joints[slots[: len(shot.axes)] - self.joint_start] @ shot.axes)

    def misses(self, rig: Rig, joints: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return seen minus predicted corners (points, 2), pixels; infinite for points behind."""
        p_C = self._chain((rig, joints))[0]
        if p_C[:, 2].min() <= 0.0:
            return np.full(self.seen.shape, np.inf)
        return np.asarray(self.seen - project_with_derivatives(p_C, self._constants(rig))[0])

    def residual(self, state: State) -> NDArray[np.float64]:
        """Return the corner residuals and joint errors, divided by their standard deviations."""
        rig, joints = state
        weighted = self.weight[:, None] * self.misses(rig, joints)
        return np.concatenate([weighted.ravel(), self.prior * joints])

    def _constants(self, rig: Rig) -> NDArray[np.float64]:
        """Return fx, fy, cx, cy, k1, k2, p1, p2, k3 of each point's camera, (points, 9)."""
        return np.array([constants(camera) for camera in rig.cameras])[self.eye[self.shot]]

    def derivatives(self, state: State) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
        """Return the derivatives (points, 2, 26) of the weighted predictions, and their unknowns.

        The indices of the unknowns are (observations, 26), -1 for held ones.
        """
        p_C, p_M, p_B, R_CM, R_CB, R_CT = self._chain(state)
        _, by_point, by_camera = project_with_derivatives(p_C, self._constants(state[0]))
        shot, n = self.shot, len(p_C)

        def against(p: NDArray[np.float64]) -> NDArray[np.float64]:
            """d exp(-twist) p: [-I, [p]x], (points, 3, 6)."""
            return np.concatenate([np.broadcast_to(-np.eye(3), (n, 3, 3)), crosses(p)], axis=2)

        axes = np.zeros((len(self.shots), 6, 2))
        for row, one in enumerate(self.shots):
            axes[row, :, : len(one.axes)] = one.axes.T
        blocks = [
            by_camera,
            by_point @ against(p_C),
            by_point @ R_CB[shot] @ against(p_B),
            -by_point @ R_CT[shot] @ against(self.points),
            by_point @ R_CM[shot] @ against(p_M) @ axes[shot],
        ]
        slots = [
            self.camera_slots[self.eye],
            self.mount_slots[self.eye],
            self.base_slots[self.base],
            self.board_slots[self.board],
        ]
        columns = [np.where(s < 0, -1, s + np.arange(6)) for s in (s[:, None] for s in slots)]
        unknowns = np.concatenate([*columns, self.joint_slots], axis=1)
        return self.weight[:, None, None] * np.concatenate(blocks, axis=2), unknowns

    def normal_equations(
        self, state: State, residual: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the normal matrix (unknowns, unknowns) and the right-hand side of a step."""
        derivatives, unknowns = self.derivatives(state)
        matrix, side = np.zeros((self.size, self.size)), np.zeros(self.size)
        stops = [*self.starts[1:], len(self.points)]
        misses = residual[: self.count].reshape(-1, 2)
        for row, (start, stop) in enumerate(zip(self.starts, stops, strict=True)):
            free = unknowns[row] >= 0
            mine = unknowns[row, free]
            J = derivatives[start:stop, :, free].reshape(-1, mine.size)
            # einsum runs on one thread, which is faster for products this small.
            matrix[np.ix_(mine, mine)] += np.einsum("ni,nj->ij", J, J)
            side[mine] += np.einsum("ni,n->i", J, misses[start:stop].ravel())
        joints = np.arange(self.joint_start, self.size)
        matrix[joints, joints] += self.prior**2
        side[joints] -= self.prior * residual[self.count :]
        return matrix, side


def levenberg_marquardt(
    problem: BundleProblem, start: State | None
) -> tuple[State, NDArray[np.float64]]:
    """Minimise the cost; return the state and the covariance of the unknowns."""
    state = start or problem.start
    residual = problem.residual(state)
    cost = float(residual @ residual)
    if not np.isfinite(cost):
        raise InputError(
            "calibration: a board lies behind its camera at the start; check the poses"
        )
    damping = 1e-4
    for _ in range(_MAX_STEPS):
        normal, gradient = problem.normal_equations(state, residual)
        scale = np.diag(normal).copy()
        scale[scale == 0.0] = 1.0
        while damping < _MAX_DAMPING:
            try:
                factor = cho_factor(normal + np.diag(damping * scale))
            except LinAlgError:
                damping *= 10.0
                continue
            tried = problem.retract(state, cho_solve(factor, gradient))
            residual_tried = problem.residual(tried)
            cost_tried = float(residual_tried @ residual_tried)
            if cost_tried < cost:
                break
            damping *= 10.0
        else:
            break
        settled = cost - cost_tried <= _CONVERGED * cost
        state, residual, cost = tried, residual_tried, cost_tried
        damping = max(0.1 * damping, 1e-12)
        if settled:
            break
    normal, _ = problem.normal_equations(state, residual)
    scale = np.sqrt(np.diag(normal))
    freedom = max(1, len(residual) - problem.size)
    if (scale == 0.0).any():
        raise InputError("calibration: some unknowns are seen by no corner; take more views")
    try:
        factor = cho_factor(normal / np.outer(scale, scale))
    except LinAlgError:
        raise InputError(
            "calibration: the views do not determine all unknowns; turn the board or the head "
            "more from view to view"
        ) from None
    inverted = cho_solve(factor, np.eye(problem.size))
    _log.debug("bundle: %d unknowns, %d residuals, cost %.4g", problem.size, len(residual), cost)
    return state, cost / freedom * inverted / np.outer(scale, scale)
