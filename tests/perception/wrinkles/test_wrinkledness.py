"""Entropy of normals: equal to brute force, zero where flat, and a point on a convex spot."""

import numpy as np
import pytest

from unwrinkle.models.errors import InputError
from unwrinkle.models.io.loader_yaml import models_dir
from unwrinkle.perception.depth.range_mapping import load_capture, range_map_from_capture
from unwrinkle.perception.sensor import noise_profile
from unwrinkle.perception.wrinkles.surface import fit_surface
from unwrinkle.perception.wrinkles.wrinkledness import normal_bins, window_entropy, wrinkledness
from unwrinkle.simulation.rendering.shipped_captures import SEED
from unwrinkle.simulation.rendering.synthetic_towel import wrinkled_towel
from unwrinkle.testing.table import GARMENT_CENTRE, TABLE


def _brute(zx: np.ndarray, zy: np.ndarray, inside: np.ndarray, row: int, column: int) -> float:
    """Entropy of one 33 x 33 window straight from the definition."""
    window = np.s_[max(0, row - 16) : row + 17, max(0, column - 16) : column + 17]
    normals = np.stack([-zx[window], -zy[window], np.ones_like(zx[window])], axis=-1)
    normals = normals[inside[window]]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    inclination = np.arccos(np.clip(normals[:, 2], -1.0, 1.0))
    azimuth = np.arctan2(normals[:, 1], normals[:, 0]) % (2.0 * np.pi)
    i = np.minimum((inclination / (np.pi / 2) * 8).astype(int), 7)
    a = np.minimum((azimuth / (2.0 * np.pi) * 8).astype(int), 7)
    label = np.where(inclination < np.radians(3.0), 0, 8 * i + a)
    share = np.bincount(label) / max(label.size, 1)
    share = share[share > 0.0]
    return float(-(share * np.log(share)).sum())


@pytest.mark.parametrize("seed", range(3))
def test_equals_brute_force_on_random_windows(seed: int) -> None:
    rng = np.random.default_rng(seed)
    # Float32 throughout, so that both sort a normal near a bin's edge alike.
    zx, zy = (rng.standard_normal((2, 120, 160)) * 0.6).astype(np.float32)
    zx[40:80, 40:80] *= 0.01
    zy[40:80, 40:80] *= 0.01
    inside = rng.random((120, 160)) > 0.2
    labels = normal_bins(zx, zy, inside, flat_inclination=np.radians(3.0))
    entropy = window_entropy(labels, 33)
    for row, column in zip(rng.integers(0, 120, 60), rng.integers(0, 160, 60), strict=True):
        expected = _brute(zx.astype(float), zy.astype(float), inside, row, column)
        assert entropy[row, column] == pytest.approx(expected, abs=0.01)


def test_equals_brute_force_on_random_labels_exactly() -> None:
    rng = np.random.default_rng(0)
    labels = rng.integers(0, 64, (90, 70)).astype(np.uint8)
    labels[rng.random((90, 70)) < 0.1] = 255
    entropy = window_entropy(labels, 21)
    for row, column in zip(rng.integers(0, 90, 80), rng.integers(0, 70, 80), strict=True):
        window = labels[max(0, row - 10) : row + 11, max(0, column - 10) : column + 11]
        share = np.bincount(window[window < 255]) / np.count_nonzero(window < 255)
        share = share[share > 0.0]
        assert entropy[row, column] == pytest.approx(-(share * np.log(share)).sum(), abs=2e-5)


def test_flat_noise_is_not_wrinkled() -> None:
    rng = np.random.default_rng(0)
    zx, zy = 0.01 * rng.standard_normal((2, 80, 80))
    inside = np.ones((80, 80), dtype=bool)
    assert window_entropy(normal_bins(zx, zy, inside)).max() < 1e-5
    aware = normal_bins(zx, zy, inside, flat_inclination=0.0)
    assert window_entropy(aware).min() > 1.5


def test_nothing_inside_is_zero() -> None:
    zx = np.zeros((40, 40))
    labels = normal_bins(zx, zx, np.zeros((40, 40), dtype=bool))
    assert (labels == 255).all()
    assert (window_entropy(labels) == 0.0).all()


def test_refuses() -> None:
    with pytest.raises(InputError, match="odd"):
        window_entropy(np.zeros((5, 5), np.uint8), 32)
    with pytest.raises(InputError, match="bins"):
        normal_bins(np.zeros((5, 5)), np.zeros((5, 5)), np.ones((5, 5), bool), bins=(16, 16))


def test_point_is_on_a_ridge_of_the_towel() -> None:
    capture = load_capture(models_dir() / "captures" / "towel.npz")
    profile = noise_profile("stereo")
    found = wrinkledness(
        fit_surface(
            range_map_from_capture(capture, centre=GARMENT_CENTRE, table_height=TABLE.height),
            profile,
        ),
        profile,
    )
    assert found.point is not None
    heights = [
        ridge.at(*np.asarray(found.point)) / ridge.height for ridge in wrinkled_towel(SEED).ridges
    ]
    assert max(heights) > 0.6
    assert (found.score >= 0.0).all()
