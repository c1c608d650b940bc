"""Forward and inverse kinematics of the two arms on the turn-table, batched in numpy.

The MA1400's wrist is not spherical: its B and T axes are 30 mm apart, so the closed form for a
spherical wrist does not apply. For a given angle of the last axis the wrist centre is known and the
first three axes follow in closed form. One scalar equation in that angle remains; it is solved for
every branch of every pose at once.

Notation: W world, B an arm's base (link_1), F its flange (tip_link), E the tool (ee), T the tool
centre point (tcp).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from unwrinkle.models.arrays import Array, Mask
from unwrinkle.models.robot import Cell

# Branches of the first three axes: the arm faces the wrist centre or reaches backwards; elbow up or
# down.
_SHOULDER = np.array([1.0, 1.0, -1.0, -1.0])
_ELBOW = np.array([1.0, -1.0, 1.0, -1.0])


@dataclass(frozen=True)
class InverseSolution:
    """Branches of an inverse-kinematics batch.

    Attributes:
        q: (N, 8, 6) axis angles, rad; undefined where `found` is false.
        found: (N, 8) whether the branch exists and its equation is solved.
        within: (N, 8) whether it is found and inside the position limits.
    """

    q: Array
    found: Mask
    within: Mask


class Kinematics:
    """Kinematics of both arms, from the numbers of a cell."""

    def __init__(self, cell: Cell) -> None:
        """Use the lengths, angles and position limits of a cell."""
        robot = cell.robot
        rows = robot.denavit_hartenberg
        self._alpha = np.array([row.alpha for row in rows])
        self._a = np.array([row.a for row in rows])
        self._offset = np.array([row.offset for row in rows])
        self._d = np.array([row.d for row in rows])
        self._forearm = float(np.hypot(self._a[2], self._d[3]))
        self._forearm_angle = float(np.arctan2(self._d[3], self._a[2]))
        self._robot = robot
        self.lower = cell.limits.lower[robot.arms[0].axes]
        self.upper = cell.limits.upper[robot.arms[0].axes]
        X_FE = np.eye(4)
        c, s = np.cos(robot.tool_yaw), np.sin(robot.tool_yaw)
        X_FE[:2, :2] = [[c, -s], [s, c]]
        X_FE[2, 3] = robot.tool_offset
        self._X_FE = X_FE
        X_ET = np.eye(4)
        X_ET[1, 3] = robot.tcp_offset
        self._X_FT = X_FE @ X_ET
        self._X_TF = np.linalg.inv(self._X_FT)

    # ------------------------------------------------------------------ forward

    def flange(self, q: Array) -> Array:
        """Compute X_BF (..., 4, 4) from axis angles (..., 6), rad."""
        q = np.asarray(q, dtype=float)
        X = np.zeros((*q.shape[:-1], 4, 4))
        X[..., [0, 1, 2, 3], [0, 1, 2, 3]] = 1.0
        for i in range(6):
            X = X @ self._link(q[..., i] + self._offset[i], i)
        return X

    def _link(self, theta: Array, i: int) -> Array:
        c, s = np.cos(theta), np.sin(theta)
        ca, sa = np.cos(self._alpha[i]), np.sin(self._alpha[i])
        X = np.zeros((*theta.shape, 4, 4))
        X[..., 0, 0], X[..., 0, 1], X[..., 0, 2], X[..., 0, 3] = c, -s * ca, s * sa, self._a[i] * c
        X[..., 1, 0], X[..., 1, 1], X[..., 1, 2], X[..., 1, 3] = s, c * ca, -c * sa, self._a[i] * s
        X[..., 2, 1], X[..., 2, 2], X[..., 2, 3] = sa, ca, self._d[i]
        X[..., 3, 3] = 1.0
        return X

    def base(self, arm: int, turntable: Array | float) -> Array:
        """Compute X_WB (..., 4, 4) of arm 0 (right) or 1 (left) at turn-table angles (...), rad."""
        turntable = np.asarray(turntable, dtype=float)
        sign = -1.0 if arm == 0 else 1.0
        yaw = turntable + self._robot.turntable_yaw
        cant = -sign * self._robot.arm_cant
        c, s, cc, sc = np.cos(yaw), np.sin(yaw), np.cos(cant), np.sin(cant)
        X = np.zeros((*turntable.shape, 4, 4))
        X[..., 0, 0], X[..., 0, 1], X[..., 0, 2] = c, -s * cc, s * sc
        X[..., 1, 0], X[..., 1, 1], X[..., 1, 2] = s, c * cc, -c * sc
        X[..., 2, 1], X[..., 2, 2], X[..., 3, 3] = sc, cc, 1.0
        X[..., 0, 3] = -s * sign * self._robot.arm_offset
        X[..., 1, 3] = c * sign * self._robot.arm_offset
        X[..., 2, 3] = self._robot.arm_height + self._robot.turntable_height
        return X

    def tool(self, arm: int, turntable: Array | float, q: Array) -> Array:
        """Compute X_WE (..., 4, 4), the pose of `ee`."""
        return self.base(arm, turntable) @ self.flange(q) @ self._X_FE

    def tcp(self, arm: int, turntable: Array | float, q: Array) -> Array:
        """Compute X_WT (..., 4, 4), the pose of `tcp`: the outer edge of the lower blade's tip."""
        return self.base(arm, turntable) @ self.flange(q) @ self._X_FT

    def tcp_positions(self, q: Array) -> Array:
        """Return p_WT (..., 2, 3) of both arms, m, at configurations (..., axes), rad."""
        q = np.asarray(q)
        turntable = q[..., self._robot.turntable_axis]
        tips = [
            self.tcp(i, turntable, q[..., arm.axes])[..., :3, 3]
            for i, arm in enumerate(self._robot.arms)
        ]
        return np.stack(tips, axis=-2)

    def configurations(self, turntable: float, right: Array, left: Array) -> Array:
        """Join the axis angles (N, 6) of both arms and the turn-table's angle to configurations (N,
        axes), rad.
        """
        q = np.empty((len(right), len(self._robot.axes)))
        q[:, self._robot.turntable_axis] = turntable
        for arm, angles in zip(self._robot.arms, (right, left), strict=True):
            q[:, arm.axes] = angles
        return q

    # ------------------------------------------------------------------ reach

    def missing_reach(self, arm: int, turntable: Array | float, X_WT: Array) -> Array:
        """Bound from below how far each pose lies beyond the arm's reach, m; if positive, there is
        no solution for any limits.

        The distance from the L axis to the wrist cannot exceed upper arm plus forearm; the 30 mm
        between the B and T axes are added to the reach, which makes the result a lower bound.

        Args:
            arm: 0 right, 1 left.
            turntable: angles broadcastable to the poses' leading shape.
            X_WT: (..., 4, 4) poses of the tool centre point.
        """
        X_BF = _inverse(self.base(arm, turntable)) @ X_WT @ self._X_TF
        p = X_BF[..., :3, 3] - self._d[5] * X_BF[..., :3, 2]
        radial = np.hypot(p[..., 0], p[..., 1]) - self._a[0]
        distance = np.hypot(radial, p[..., 2] - self._d[0])
        return np.asarray(distance - (self._a[1] + self._forearm + abs(self._a[4])))

    # ------------------------------------------------------------------ inverse

    def inverse(
        self,
        arm: int,
        turntable: Array | float,
        X_WT: Array,
        *,
        iterations: int = 6,
        tolerance: float = 1e-9,
    ) -> InverseSolution:
        """Compute all branches (shoulder x elbow x two wrist roots) for poses of the tool centre
        point.

        Args:
            arm: 0 right, 1 left.
            turntable: angle, or (N,) angles, rad.
            X_WT: (N, 4, 4) poses.
            iterations: limit of secant steps for the angle of the last axis.
            tolerance: residual of its equation (a cosine) at which it counts as solved.

        Returns:
            The branches; each angle is shifted by full turns to be nearest to the middle of its
            range. Of uniformly random configurations about 95 % are recovered; roots that do not
            continue those of a spherical wrist are missed.
        """
        X_BF = _inverse(self.base(arm, turntable)) @ X_WT @ self._X_TF
        R = X_BF[:, :3, :3]
        ex, ey = R[:, None, :, 0], R[:, None, :, 1]
        p5 = (X_BF[:, :3, 3] - self._d[5] * R[:, :, 2])[:, None]

        def residual(theta6: Array) -> tuple[Array, tuple[Any, ...]]:
            c, s = np.cos(theta6)[..., None], np.sin(theta6)[..., None]
            x5, y5 = c * ex - s * ey, s * ex + c * ey
            t1, t2, t3, reach = self._first_three(p5 - self._a[4] * x5)
            z3 = _z3(t1, t2, t3)
            return np.sum(z3 * y5, axis=-1), (t1, t2, t3, reach, x5, y5, z3)

        t1, t2, t3, _ = self._first_three(np.repeat(p5, 4, axis=1))
        z3 = _z3(t1, t2, t3)
        start = np.arctan2(-np.sum(z3 * ey, axis=-1), np.sum(z3 * ex, axis=-1))
        theta = np.concatenate([start, start + np.pi], axis=1)  # branches: 4 + 4
        f, _ = residual(theta)
        step = np.full_like(theta, 1e-5)
        f_new, _ = residual(theta + step)
        slope = (f_new - f) / step
        for _ in range(iterations):
            step = np.clip(-f / np.where(np.abs(slope) < 1e-6, 1e-6, slope), -0.5, 0.5)
            theta = theta + step
            f_new, _ = residual(theta)
            moved = np.abs(step) > 1e-10
            slope = np.where(moved, (f_new - f) / np.where(moved, step, 1.0), slope)
            f = f_new
            if np.all(np.abs(f) < tolerance):
                break
        f, (t1, t2, t3, reach, x5, y5, z3) = residual(theta)
        c1, s1, lean = np.cos(t1), np.sin(t1), t2 - t3
        x3 = np.stack([np.cos(lean) * c1, np.cos(lean) * s1, -np.sin(lean)], axis=-1)
        y3 = np.cross(z3, x3)
        t4 = np.arctan2(np.sum(x3 * y5, axis=-1), -np.sum(y3 * y5, axis=-1))
        x4 = np.cos(t4)[..., None] * x3 + np.sin(t4)[..., None] * y3
        t5 = np.arctan2(np.sum(z3 * x5, axis=-1), np.sum(x4 * x5, axis=-1))
        q = np.stack([t1, t2, t3, t4, t5, theta], axis=-1) - self._offset
        middle = 0.5 * (self.lower + self.upper)
        q = middle + (q - middle + np.pi) % (2.0 * np.pi) - np.pi
        found = reach & (np.abs(f) < tolerance)
        within = found & np.all((q >= self.lower) & (q <= self.upper), axis=-1)
        return InverseSolution(q, found, within)

    def _first_three(self, p_BC: Array) -> tuple[Array, Array, Array, Mask]:
        """Compute the first three axis angles (with offsets), rad, for wrist centres (..., 8 or 4,
        3), and whether they are in reach.
        """
        n = p_BC.shape[-2] // 4
        shoulder, elbow = np.tile(_SHOULDER, n), np.tile(_ELBOW, n)
        t1 = np.arctan2(p_BC[..., 1], p_BC[..., 0]) + np.where(shoulder > 0, 0.0, np.pi)
        u = shoulder * np.hypot(p_BC[..., 0], p_BC[..., 1]) - self._a[0]
        v = self._d[0] - p_BC[..., 2]
        upper, fore = self._a[1], self._forearm
        cosine = (u * u + v * v - upper**2 - fore**2) / (2.0 * upper * fore)
        bend = elbow * np.arccos(np.clip(cosine, -1.0, 1.0))
        t2 = np.arctan2(v, u) - np.arctan2(fore * np.sin(bend), upper + fore * np.cos(bend))
        return t1, t2, -bend - self._forearm_angle, np.abs(cosine) <= 1.0


def _z3(t1: Array, t2: Array, t3: Array) -> Array:
    angle = t2 - (0.5 * np.pi + t3)
    cu = np.cos(angle)
    return np.stack([cu * np.cos(t1), cu * np.sin(t1), -np.sin(angle)], axis=-1)


def _inverse(X: Array) -> Array:
    R = np.swapaxes(X[..., :3, :3], -1, -2)
    out = np.zeros_like(X)
    out[..., :3, :3] = R
    out[..., :3, 3] = -(R @ X[..., :3, 3:4])[..., 0]
    out[..., 3, 3] = 1.0
    return out
