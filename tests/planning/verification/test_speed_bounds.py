"""Bounds on the speed of points on a chain, against closed forms and brute force."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from unwrinkle.planning.verification.speed_bounds import (
    derivative_bounds,
    distances_to_axes,
    speed_bounds,
)


def test_distances_to_axes_are_those_of_the_farthest_point() -> None:
    """Against |(p - o) x z|, point by point."""
    rng = np.random.default_rng(0)
    count, chain = 4, (0, 3, 14)
    X_WJ = np.tile(np.eye(4), (count, 15, 1, 1))
    rotations = Rotation.random(15 * count, rng=rng).as_matrix()
    X_WJ[..., :3, :3] = rotations.reshape(count, 15, 3, 3)
    X_WJ[..., :3, 3] = rng.normal(size=(count, 15, 3))
    directions = rng.normal(size=(15, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    points = rng.normal(size=(5, 3))
    found = distances_to_axes(points, X_WJ, directions, chain)
    assert found.shape == (count, len(chain))
    for n in range(count):
        last = X_WJ[n, chain[-1]]
        p_W = [last[:3, :3] @ point + last[:3, 3] for point in points]
        for k, joint in enumerate(chain):
            z = X_WJ[n, joint, :3, :3] @ directions[joint]
            away = [np.linalg.norm(np.cross(p - X_WJ[n, joint, :3, 3], z)) for p in p_W]
            assert found[n, k] == pytest.approx(max(away), rel=1e-12)


def test_points_on_an_axis_have_no_distance() -> None:
    X_WJ = np.tile(np.eye(4), (2, 15, 1, 1))
    axes = np.tile([0.0, 0.0, 1.0], (15, 1))
    on_axis = np.array([[0.0, 0.0, 0.1], [0.0, 0.0, 0.7]])
    assert np.array_equal(distances_to_axes(on_axis, X_WJ, axes, (4,)), np.zeros((2, 1)))


def test_speed_of_one_revolute_joint_is_rate_times_distance() -> None:
    """The mean of the distances at both ends; each interval has its own."""
    rho = np.array([[0.5], [0.7], [0.1]])
    rate = np.array([[2.0], [3.0]])
    found = speed_bounds(rho, np.array([0.1, 0.2]), rate, [False])
    assert found == pytest.approx(np.array([[2.0 * 0.6, 0.0], [3.0 * 0.4, 0.0]]), rel=1e-12)


def test_a_prismatic_joint_adds_its_own_speed_and_lets_the_distances_change() -> None:
    rho = np.array([[0.5, 9.0], [0.7, 9.0]])
    found = speed_bounds(rho, np.array([0.1]), np.array([[2.0, 3.0]]), [False, True])
    # The slide's 3 m/s moves the point away from the axis by up to half of 0.3 m in between.
    assert found == pytest.approx(np.array([[3.0 + 2.0 * (0.6 + 0.15), 3.0, 0.0]]), rel=1e-12)


def test_speeds_add_up_from_the_last_joint_inwards() -> None:
    rho = np.array([[1.0, 0.4], [1.2, 0.6]])
    found = speed_bounds(rho, np.array([0.1]), np.array([[2.0, 3.0]]), [False, False])
    outer = 3.0 * 0.5
    whole = outer + 2.0 * (1.1 + 0.05 * outer)
    assert found == pytest.approx(np.array([[whole, outer, 0.0]]), rel=1e-12)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_derivatives_about_one_axis_are_those_of_a_circle(count: int) -> None:
    """Joints on one axis turn by the sum of their angles.

    A point at distance rho then has |p'| = w rho, |p''| <= (w^2 + a) rho, |p'''| <= (w^3 + 3 w a +
    j) rho.
    """
    rng = np.random.default_rng(count)
    w, a, j = rng.uniform(0.5, 2.0, (3, 2, count))
    rho = np.full((3, count), 0.8)
    bounds = derivative_bounds(rho, np.zeros(2), w, a, j)
    W, A, J = (rates.sum(axis=1) for rates in (w, a, j))
    expected = W * 0.8, (W**2 + A) * 0.8, (W**3 + 3.0 * W * A + J) * 0.8
    for found, value in zip(bounds, expected, strict=True):
        assert found == pytest.approx(value, rel=1e-12)


def test_a_moving_point_reaches_further_from_an_inner_axis() -> None:
    """By half the way that the outer joint moves it; one interval is at a second distance."""
    rho = np.array([[1.0, 0.5], [1.2, 0.5], [2.0, 0.5]])
    w = np.array([[2.0, 3.0], [2.0, 3.0]])
    none = np.zeros((2, 2))
    first, second, third = derivative_bounds(rho, np.array([0.1, 0.4]), w, none, none)
    reach = np.array([1.1 + 0.05 * 1.5, 1.6 + 0.2 * 1.5])
    assert first == pytest.approx(1.5 + 2.0 * reach, rel=1e-12)
    assert second == pytest.approx(4.5 + 2.0 * 2.0 * 1.5 + 4.0 * reach, rel=1e-12)
    assert third == pytest.approx(13.5 + 6.0 * 4.5 + 3.0 * 4.0 * 1.5 + 8.0 * reach, rel=1e-12)
