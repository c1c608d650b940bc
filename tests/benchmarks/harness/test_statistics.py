"""Intervals of small samples."""

import numpy as np
import pytest

from benchmarks.harness.statistics import mean_interval, wilson


def test_interval_holds_the_true_mean_about_as_often_as_it_says() -> None:
    rng = np.random.default_rng(3)
    hits = 0
    for _ in range(60):
        spread = mean_interval(rng.normal(5.0, 2.0, 20))
        assert spread is not None
        hits += spread.low <= 5.0 <= spread.high
    assert 0.8 <= hits / 60 <= 1.0


def test_degenerate_samples_have_no_width_and_no_nan() -> None:
    assert mean_interval([]) is None
    one, same = mean_interval([3.0]), mean_interval([1.0, 1.0, 1.0])
    assert one is not None and (one.low, one.high, one.std) == (3.0, 3.0, 0.0)
    assert same is not None and (same.low, same.high) == (1.0, 1.0)


def test_share_of_ten_in_ten_is_not_certain() -> None:
    low, high = wilson(10, 10)
    assert low == pytest.approx(0.7225, abs=1e-3)  # Wilson 1927: n / (n + z^2)
    assert high == pytest.approx(1.0)
    assert wilson(0, 0) == (0.0, 1.0)
