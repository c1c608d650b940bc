"""Plate fit against dense linear algebra, and its behaviour at creases."""

import numpy as np
import pytest
from numpy.typing import NDArray

from unwrinkle.perception.stereo._kernels.plate_fit import Plate


def energy_matrix(
    d: NDArray[np.float64], weight: NDArray[np.float64], stiffness: float, crease: float
) -> NDArray[np.float64]:
    """A + R, dense, by looping over every second difference."""
    h, w = d.shape
    index = np.arange(h * w).reshape(h, w)
    matrix = np.diag(weight.ravel())
    stencils = []
    for y in range(h):
        for x in range(w):
            if 0 < x < w - 1:
                stencils.append(([(y, x - 1), (y, x), (y, x + 1)], [1, -2, 1], 1.0))
            if 0 < y < h - 1:
                stencils.append(([(y - 1, x), (y, x), (y + 1, x)], [1, -2, 1], 1.0))
            if x < w - 1 and y < h - 1:
                corners = [(y, x), (y, x + 1), (y + 1, x), (y + 1, x + 1)]
                stencils.append((corners, [1, -1, -1, 1], 2.0))
    for places, factors, times in stencils:
        row = np.zeros(h * w)
        for place, factor in zip(places, factors, strict=True):
            row[index[place]] = factor
        share = crease**2 / (crease**2 + float(row @ d.ravel()) ** 2)
        matrix += times * stiffness * share**2 * np.outer(row, row)
    return matrix


@pytest.mark.parametrize("shape", [(7, 9), (40, 6), (3, 50)])
def test_solution_is_that_of_dense_algebra(shape: tuple[int, int]) -> None:
    rng = np.random.default_rng(3)
    d, pull = rng.normal(size=shape), rng.normal(size=shape)
    weight = rng.uniform(0.5, 5.0, shape)
    matrix = energy_matrix(d, weight, 20.0, 0.5)
    bending = (matrix - np.diag(weight.ravel())) @ d.ravel()
    expected = np.linalg.solve(matrix, pull.ravel() - bending).reshape(shape)
    arrays = [x.astype(np.float32) for x in (d, weight, pull)]
    change = Plate(shape).fit(*arrays, stiffness=20.0, crease=0.5, iterations=400)
    np.testing.assert_allclose(change, expected, atol=2e-4 * np.abs(expected).max())


def test_memory_is_used_again_without_a_trace() -> None:
    rng = np.random.default_rng(4)
    plate = Plate((64, 48))
    inputs = [rng.uniform(0.1, 1.0, (64, 48)).astype(np.float32) for _ in range(3)]
    settings = {"stiffness": 10.0, "crease": 0.3, "iterations": 12}
    first = plate.fit(*inputs, **settings).copy()
    plate.fit(*inputs[::-1], **settings)
    np.testing.assert_array_equal(plate.fit(*inputs, **settings), first)


def test_planes_are_not_bent() -> None:
    y, x = np.mgrid[:50, :70].astype(np.float32)
    plane = 0.3 * x - 0.2 * y + 5.0
    nothing = np.zeros_like(plane)
    change = Plate(plane.shape).fit(
        plane, nothing + 1.0, nothing, stiffness=100.0, crease=0.1, iterations=20
    )
    assert np.abs(change).max() < 1e-3


def test_noise_goes_and_a_crease_stays() -> None:
    rng = np.random.default_rng(5)
    y, x = np.mgrid[:80, :100].astype(np.float32)
    truth = np.where(x < 50, 0.05 * y, 0.05 * y + 6.0).astype(np.float32)
    surface = truth + rng.normal(0.0, 0.02, truth.shape).astype(np.float32)
    measured = truth + rng.normal(0.0, 0.3, truth.shape).astype(np.float32)
    weight = np.full_like(truth, 1.0 / 0.3**2)
    change = Plate(truth.shape).fit(
        surface, weight, weight * (measured - surface), stiffness=300.0, crease=0.3, iterations=60
    )
    error = (surface + change - truth)[4:-4, 4:-4]
    assert error.std() < 0.12  # a fifth of the measured noise would need the crease's neighbours
    beside = (surface + change - truth)[10:-10, 47:53]
    assert np.abs(beside.mean(axis=0)).max() < 0.15


def test_where_nothing_was_measured_the_surface_goes_on() -> None:
    x = np.tile(np.arange(60, dtype=np.float32), (60, 1))
    slope = 0.1 * x
    gap = (x > 24) & (x < 32)
    surface = np.where(gap, slope + 0.05, slope).astype(np.float32)
    weight = np.where(gap, 0.0, 50.0).astype(np.float32)
    change = Plate(slope.shape).fit(
        surface, weight, weight * (slope - surface), stiffness=10.0, crease=1.0, iterations=200
    )
    assert np.abs(surface + change - slope).max() < 0.005
