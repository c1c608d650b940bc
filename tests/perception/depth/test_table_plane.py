"""The table plane under a garment, and the slow bias of the sensor."""

import numpy as np
import pytest

from unwrinkle.models.errors import InputError
from unwrinkle.perception.camera import Camera
from unwrinkle.perception.depth.table_plane import fit_table
from unwrinkle.perception.sensor import noise_profile

CAMERA = Camera("c", 320, 240, 262.0, 262.0, 159.5, 119.5)


def _plane(normal: tuple[float, float, float], distance: float) -> np.ndarray:
    """Depth image of the plane with that normal (towards the camera) and distance."""
    n = np.array(normal) / np.linalg.norm(normal)
    x, y = CAMERA.rays()
    return np.asarray(-distance / (n[0] * x + n[1] * y + n[2]))


def test_exact_plane_and_block_on_it() -> None:
    normal = np.array([0.1, -0.15, -1.0])
    normal /= np.linalg.norm(normal)
    depth = _plane(tuple(normal), 1.1)
    block = _plane(tuple(normal), 1.08)
    depth[60:200, 80:260] = block[60:200, 80:260]
    depth[:4] = 0.0
    fit = fit_table(depth, CAMERA, noise_profile("stereo"))
    np.testing.assert_allclose(fit.normal_C, normal, atol=1e-9)
    assert fit.distance == pytest.approx(1.1, abs=1e-9)
    np.testing.assert_allclose(fit.height[60:200, 80:260], 0.02, atol=1e-9)
    assert (fit.height[:4] == 0.0).all()
    assert not fit.table[60:200, 80:260].any()
    assert fit.table[204:, :].all()


def test_noise_steps_bands_and_bow_are_taken_out() -> None:
    """Xtion-like: 3 mm steps, 2 mm noise, bands along columns, a bowed field, 40 % garment."""
    rng = np.random.default_rng(0)
    depth = _plane((0.03, -0.05, -1.0), 1.0)
    inverse = 1.0 / depth
    inverse[50:190, 60:250] += 0.02
    u = np.linspace(-1.0, 1.0, 320)
    inverse = inverse + 0.003 * u**2 + 0.0015 * (np.floor(u * 4) % 2)
    inverse = inverse + 0.0018 * rng.standard_normal(depth.shape)
    depth = 1.0 / (np.rint(inverse / 0.003) * 0.003)
    garment = np.zeros(depth.shape, dtype=bool)
    garment[45:195, 55:255] = True
    fit = fit_table(depth, CAMERA, noise_profile("xtion"), exclude=garment)
    columns = fit.height[:40].mean(axis=0)
    assert np.abs(columns.reshape(32, 10).mean(axis=1)).max() < 0.0008
    assert fit.height[60:180, 70:240].mean() == pytest.approx(0.0195, abs=0.001)


def test_refuses_a_view_without_a_table() -> None:
    rng = np.random.default_rng(0)
    heap = rng.uniform(0.5, 2.5, (240, 320))
    with pytest.raises(InputError, match="no table plane"):
        fit_table(heap, CAMERA, noise_profile("stereo"))
    with pytest.raises(InputError, match="too little"):
        fit_table(np.zeros((240, 320)), CAMERA, noise_profile("stereo"))


def test_refuses_a_grazing_view() -> None:
    x, y = CAMERA.rays()
    depth = 0.6 / (0.1 + 0.9 * np.maximum(y + 0.3, 0.0) + 0.001 * x)
    depth[y < -0.25] = 0.0
    with pytest.raises(InputError, match="degrees"):
        fit_table(np.asarray(depth), CAMERA, noise_profile("stereo"))
