import numpy as np
import pytest

from unwrinkle.models.errors import InputError
from unwrinkle.perception.wrinkles.bspline import (
    PATCH_DEGREE,
    design_matrix,
    fit_spline,
    open_uniform_knots,
    patch_knots,
)

RESOLUTION = 0.001
ORDERS = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)]


def grid(nx=120, ny=90):
    x, y = np.arange(nx) * RESOLUTION, np.arange(ny) * RESOLUTION
    return x, y, *np.meshgrid(x, y)


def quintic(x, y):
    """A polynomial that a degree-5 spline holds exactly, and its derivatives."""
    u, v = x / 0.1, y / 0.1
    z = 0.01 * (1 + u - 2 * v + u**3 * v - v**4 + u**5)
    zx = 0.1 * (1 + 3 * u**2 * v + 5 * u**4)
    zy = 0.1 * (-2 + u**3 - 4 * v**3)
    return z, zx, zy, 6 * u * v + 20 * u**3, 3 * u**2, -12 * v**2


def test_a_polynomial_is_reproduced_with_its_derivatives():
    x, y, X, Y = grid()
    truth = quintic(X, Y)
    spline = fit_spline(truth[0].astype(np.float32), np.ones(X.shape, np.float32), RESOLUTION, 0.01)
    for found, wanted, unit in zip(
        spline.sample(x, y, ORDERS), truth, (1e-6, 2e-4, 2e-4, 0.05, 0.05, 0.05), strict=True
    ):
        assert np.abs(found - wanted)[10:-10, 10:-10].max() < unit


def test_the_masked_fit_ignores_what_is_masked_and_extends_smoothly():
    x, y, X, Y = grid()
    truth = [0.1 * values for values in quintic(X, Y)]  # slopes of a garment
    rng = np.random.default_rng(0)
    weight = ((X - 0.06) ** 2 + (Y - 0.045) ** 2 < 0.035**2).astype(np.float32)
    weight[rng.random(X.shape) < 0.3] = 0.0  # 30 % holes
    height = np.where(weight > 0, truth[0], 1e6).astype(np.float32)
    z, zxx = fit_spline(height, weight, RESOLUTION, 0.01).sample(x, y, [(0, 0), (2, 0)])
    near = (X - 0.06) ** 2 + (Y - 0.045) ** 2 < 0.034**2
    assert np.abs(z - truth[0])[near].max() < 5e-5
    assert np.abs(z - truth[0])[near].mean() < 3e-6
    core = (X - 0.06) ** 2 + (Y - 0.045) ** 2 < 0.025**2
    assert np.abs(zxx - truth[3])[core].max() < 1.0  # a wrinkle has 50 or more


def test_the_masked_fit_is_the_weighted_least_squares_solution():
    x, y, X, _ = grid(40, 30)
    rng = np.random.default_rng(1)
    height = rng.normal(0.0, 0.01, X.shape).astype(np.float32)
    weight = rng.uniform(0.2, 1.0, X.shape).astype(np.float32)
    spline = fit_spline(height, weight, RESOLUTION, 0.01, sweeps=60)
    bx = design_matrix(spline.knots_x, x, spline.degree).astype(float)
    by = design_matrix(spline.knots_y, y, spline.degree).astype(float)
    full, root = np.kron(by, bx), np.sqrt(weight.astype(float).ravel())
    wanted = np.linalg.lstsq(full * root[:, None], height.ravel() * root, rcond=None)[0]
    found = spline.sample(x, y, [(0, 0)])[0].ravel()
    assert np.abs(found - full @ wanted).max() < 2e-4 * np.abs(height).max()


def test_smoothing_leaves_quadratics_and_damps_waves():
    x, y, X, Y = grid()
    weight = np.ones(X.shape, np.float32)
    tilted = (0.02 + 0.3 * X - 0.2 * Y + 2.0 * X * X).astype(np.float32)
    z = fit_spline(tilted, weight, RESOLUTION, 0.006, smoothing=0.01).sample(x, y, [(0, 0)])[0]
    assert np.abs(z - tilted).max() < 1e-6
    smoothing, frequency = 0.006, 150.0
    wave = np.sin(frequency * X).astype(np.float32)
    spline = fit_spline(wave, weight, RESOLUTION, 0.006, smoothing=smoothing)
    found = spline.sample(x, y, [(0, 0)])[0][45, 30:-30]
    response = 1.0 / (1.0 + (smoothing * frequency) ** 6)
    assert np.abs(found).max() / np.abs(wave[45, 30:-30]).max() == pytest.approx(response, abs=0.05)


def test_patches_have_the_papers_knots_and_are_independent():
    knots = patch_knots(0.04, 0.01)  # two patches of 0.02 m
    assert np.allclose(knots / 0.01, [0, 0, 0, 0, 1, 2, 2, 2, 2, 3, 4, 4, 4, 4])
    assert len(knots) - PATCH_DEGREE - 1 == 10  # 5 control points each
    x, y, X, _ = grid(41, 41)
    height = np.zeros(X.shape, np.float32)
    height[:, 21:] = np.random.default_rng(2).normal(size=(41, 20))
    z = fit_spline(height, np.ones_like(height), RESOLUTION, 0.01, patches=True).sample(
        x, y, [(0, 0)]
    )[0]
    assert np.abs(z[:, :20]).max() < 1e-6 < np.abs(z[:, 21:]).max()
    whole = fit_spline(height, np.ones_like(height), RESOLUTION, 0.01).sample(x, y, [(0, 0)])[0]
    assert np.abs(whole[:, :20]).max() > 1e-3


def test_knots_span_the_length():
    knots = open_uniform_knots(0.1, 0.03)
    assert knots[0] == 0.0 and knots[-1] == 0.1
    assert len(np.unique(knots)) == 4


def test_an_empty_mask_and_wrong_shapes_are_refused():
    height = np.zeros((10, 10), np.float32)
    with pytest.raises(InputError, match="no cell"):
        fit_spline(height, np.zeros_like(height), RESOLUTION, 0.005)
    with pytest.raises(InputError, match="differ"):
        fit_spline(height, np.zeros((10, 9), np.float32), RESOLUTION, 0.005)
