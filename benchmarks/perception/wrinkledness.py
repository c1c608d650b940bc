"""How long the wrinkledness of a map takes, and how far it is from brute force."""

import time
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.harness.report import Progress
from benchmarks.harness.tables import line, rule
from unwrinkle.perception.wrinkles.wrinkledness import WINDOW, normal_bins, window_entropy

_SIZES = ((480, 640), (1000, 1000))


@dataclass(frozen=True)
class SizeFigures:
    """One size of map: pixels, times in s, and the largest difference to brute force, nat."""

    height: int
    width: int
    time_median: float
    time_min: float
    bins_used: int
    brute_force_difference_max: float


@dataclass(frozen=True)
class WrinklednessResult:
    """The window, cells; the sizes; the median time of the first, s."""

    window: int
    sizes: tuple[SizeFigures, ...]
    wrinkledness_time_median: float


def run(*, quick: bool, seed: int, progress: Progress) -> WrinklednessResult:
    """Time the bins and the entropy of random smooth slopes; compare random windows."""
    rng = np.random.default_rng(seed)
    rounds = 7 if quick else 31
    sizes: list[SizeFigures] = []
    for done, shape in enumerate(_SIZES):
        progress(done, len(_SIZES), f"{shape[1]} x {shape[0]}")
        zx, zy = (
            np.asarray(cv2.GaussianBlur(rng.standard_normal(shape), (0, 0), 4.0)) * 5.0
            for _ in range(2)
        )
        inside = np.ones(shape, dtype=bool)
        times: list[float] = []
        for _ in range(rounds):
            start = time.perf_counter()
            labels = normal_bins(zx, zy, inside)
            entropy = window_entropy(labels)
            times.append(time.perf_counter() - start)
        sizes.append(
            SizeFigures(
                height=shape[0],
                width=shape[1],
                time_median=float(np.median(times)),
                time_min=min(times),
                bins_used=int(np.unique(labels).size),
                brute_force_difference_max=_difference(labels, entropy, rng, 300),
            )
        )
    progress(len(_SIZES), len(_SIZES), "done")
    return WrinklednessResult(
        window=WINDOW, sizes=tuple(sizes), wrinkledness_time_median=sizes[0].time_median
    )


def table(results: WrinklednessResult) -> str:
    """Return one row per size."""
    lines = [
        f"Entropy of 8 x 8 bins in a window of {results.window} cells, on smooth random slopes.",
        "",
        line(
            "size",
            "bins used",
            "median (ms)",
            "best (ms)",
            "largest difference to brute force (nat)",
        ),
        rule(5),
    ]
    lines += [
        line(
            f"{s.width} x {s.height}",
            f"{s.bins_used}",
            f"{1e3 * s.time_median:.0f}",
            f"{1e3 * s.time_min:.0f}",
            f"{s.brute_force_difference_max:.1e}",
        )
        for s in results.sizes
    ]
    return "\n".join([*lines, ""])


def _difference(
    labels: NDArray[np.uint8], entropy: NDArray[np.float32], rng: np.random.Generator, count: int
) -> float:
    half = WINDOW // 2
    worst = 0.0
    for _ in range(count):
        row, column = (int(rng.integers(0, size)) for size in labels.shape)
        window = labels[
            max(0, row - half) : row + half + 1, max(0, column - half) : column + half + 1
        ]
        share = np.bincount(window.ravel()) / window.size
        share = share[share > 0.0]
        worst = max(worst, abs(float(entropy[row, column] + (share * np.log(share)).sum())))
    return worst
