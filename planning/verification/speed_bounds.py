"""Upper bounds on the speed of points on a chain of joints within an interval, from the extremes of
the joints.

A point p is carried by revolute joints 1..J. Joint k rotates it about an axis at distance rho_k;
the joints beyond k move it relative to the frame of joint k. With bounds w, a, j of a joint's
velocity, acceleration and jerk, the derivatives of its rotation R are bounded by |R'| <= w, |R''|
<= w^2 + a, |R'''| <= w^3 + 3 w a + j, and Leibniz's rule gives, from the last joint inwards (P_n
bounds the n-th derivative of p relative to the frame before the joint):

    P_1 <- P_1 + w rho
    P_2 <- P_2 + 2 w P_1 + (w^2 + a) rho
    P_3 <- P_3 + 3 w P_2 + 3 (w^2 + a) P_1 + (w^3 + 3 w a + j) rho

Within the interval rho_k changes no faster than P_1 of the joints beyond k, so that from its values
at both ends rho_k <= (rho_begin + rho_end + h P_1) / 2. (P_1 bounds the full speed of the point,
hence also its component across the axis.) A prismatic joint adds its own derivatives.
"""

from collections.abc import Sequence

import numpy as np

from unwrinkle.models.arrays import Array


def distances_to_axes(points: Array, X_WJ: Array, directions: Array, chain: Sequence[int]) -> Array:
    """Compute the greatest distance of a body's points from each axis of its chain at every sample.

    Args:
        points: (m, 3) in the child frame of the chain's last joint.
        X_WJ: (n, 15, 4, 4) poses of the joints' child frames in the world.
        directions: (15, 3) of the axes in those frames.
        chain: joints from the world outwards.

    Returns:
        (n, len(chain)), m.
    """
    last = X_WJ[:, chain[-1]]
    p_W = points @ last[:, :3, :3].transpose(0, 2, 1) + last[:, None, :3, 3]
    result = np.empty((len(X_WJ), len(chain)))
    for k, joint in enumerate(chain):
        z = X_WJ[:, joint, :3, :3] @ directions[joint]
        r = p_W - X_WJ[:, None, joint, :3, 3]
        along = np.einsum("nmi,ni->nm", r, z)
        square = np.einsum("nmi,nmi->nm", r, r) - along**2
        result[:, k] = np.sqrt(np.maximum(square.max(axis=1), 0.0))
    return result


def speed_bounds(rho: Array, step: Array, velocity: Array, prismatic: Sequence[bool]) -> Array:
    """Bound the speed of a body's points in every interval, relative to the frame before each joint
    of its chain.

    Args:
        rho: (n, J) distances to the axes at the samples.
        step: (n-1,) lengths of the intervals, s.
        velocity: (n-1, J) greatest absolute velocity of the joints in the intervals.
        prismatic: per joint of the chain.

    Returns:
        (n-1, J+1), m/s: column k is relative to the frame before joint k; the last column is 0.
    """
    count = rho.shape[1]
    result = np.zeros((len(step), count + 1))
    for k in reversed(range(count)):
        beyond = result[:, k + 1]
        if prismatic[k]:
            result[:, k] = beyond + velocity[:, k]
        else:
            reach = 0.5 * (rho[:-1, k] + rho[1:, k] + step * beyond)
            result[:, k] = beyond + velocity[:, k] * reach
    return result


def derivative_bounds(
    rho: Array, step: Array, velocity: Array, acceleration: Array, jerk: Array
) -> tuple[Array, Array, Array]:
    """Bound the first three derivatives of a point's position in every interval, (n-1,) each.

    Args as in `speed_bounds`, all joints revolute; acceleration and jerk (n-1, J) as bounds of
    absolute values.
    """
    P1, P2, P3 = (np.zeros(len(step)) for _ in range(3))
    for k in reversed(range(rho.shape[1])):
        w, a, j = velocity[:, k], acceleration[:, k], jerk[:, k]
        reach = 0.5 * (rho[:-1, k] + rho[1:, k] + step * P1)
        second = w**2 + a
        P3 = P3 + 3.0 * w * P2 + 3.0 * second * P1 + (w**3 + 3.0 * w * a + j) * reach
        P2 = P2 + 2.0 * w * P1 + second * reach
        P1 = P1 + w * reach
    return P1, P2, P3
