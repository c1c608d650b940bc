"""Means and shares of small samples, with intervals."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import binomtest, bootstrap

#: Of every interval.
CONFIDENCE = 0.95


@dataclass(frozen=True)
class MedianWorst:
    """Median and greatest value of a sample."""

    median: float
    worst: float

    @classmethod
    def of(cls, values: Sequence[float]) -> "MedianWorst":
        """Of a sample that is not empty."""
        return cls(float(np.median(values)), float(np.max(values)))


@dataclass(frozen=True)
class Spread:
    """Mean of a sample, with its interval.

    Attributes:
        count: of values.
        mean, std: of them; the standard deviation is the sample's (n - 1), 0 for one value.
        low, high: 95 % interval of the mean, by the bootstrap's percentiles; the mean itself where
            all values agree.
    """

    count: int
    mean: float
    std: float
    low: float
    high: float


def mean_interval(values: Sequence[float]) -> Spread | None:
    """Return the spread of a sample; None for an empty one."""
    return spread(values) if len(values) else None


def spread(values: Sequence[float]) -> Spread:
    """Return the spread of a sample that is not empty."""
    sample = np.asarray(values, dtype=float)
    mean = float(sample.mean())
    std = float(sample.std(ddof=1)) if sample.size > 1 else 0.0
    low = high = mean
    if np.ptp(sample) > 0.0:
        interval = bootstrap(
            (sample,),
            np.mean,
            confidence_level=CONFIDENCE,
            n_resamples=9999,
            method="percentile",
            rng=np.random.default_rng(0),
        ).confidence_interval
        low, high = float(interval.low), float(interval.high)
    return Spread(sample.size, mean, std, low, high)


def wilson(hits: int, count: int) -> tuple[float, float]:
    """Return Wilson's 95 % interval of a share, (0, 1) for no trial."""
    if count == 0:
        return 0.0, 1.0
    interval = binomtest(hits, count).proportion_ci(CONFIDENCE, method="wilson")
    return float(interval.low), float(interval.high)
