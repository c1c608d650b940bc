"""The sampled cubic: values against scipy's spline, exact extremes against dense samples."""

import numpy as np
import pytest

from unwrinkle.planning.trajectory import SampledCubic, hermite_positions


def _sampled(seed: int) -> SampledCubic:
    rng = np.random.default_rng(seed)
    times = np.concatenate([[0.0], np.cumsum(rng.uniform(0.004, 0.1, 12))])
    return SampledCubic(times, rng.normal(size=(13, 3)), rng.normal(size=(13, 3)))


@pytest.mark.parametrize("seed", range(3))
def test_values_and_derivatives_are_those_of_the_spline(seed: int) -> None:
    cubic = _sampled(seed)
    spline = cubic.interpolant()
    t = np.random.default_rng(seed).uniform(0.0, cubic.duration, (5, 4))
    positions, velocities = cubic.at(t)
    slopes, accelerations, jerks = cubic.derivatives(t)
    for found, order in ((positions, 0), (slopes, 1), (accelerations, 2), (jerks, 3)):
        assert found == pytest.approx(spline(t, order), rel=1e-9, abs=1e-9)
    assert (velocities == slopes).all()
    for k in (0, -1):
        assert cubic.at(cubic.times[k])[0] == pytest.approx(cubic.positions[k], abs=1e-12)
    basis = hermite_positions(cubic.times, cubic.positions, cubic.velocities, t[0])
    assert basis == pytest.approx(positions[0], abs=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_extremes_enclose_dense_samples_closely(seed: int) -> None:
    cubic = _sampled(seed)
    found = cubic.extremes()
    t = cubic.times[:-1, None] + np.diff(cubic.times)[:, None] * np.linspace(0.0, 1.0, 2001)
    q = cubic.at(t)[0].reshape(-1, 3)
    v, a, j = (np.abs(values).reshape(-1, 3).max(axis=0) for values in cubic.derivatives(t))
    assert found.lower == pytest.approx(q.min(axis=0), abs=1e-6)
    assert found.upper == pytest.approx(q.max(axis=0), abs=1e-6)
    assert found.speed == pytest.approx(v, rel=1e-5)
    assert found.acceleration == pytest.approx(a, rel=1e-3)
    assert found.jerk == pytest.approx(j, rel=1e-9)
    assert (found.lower <= q.min(axis=0) + 1e-12).all()
    assert (found.upper >= q.max(axis=0) - 1e-12).all()
