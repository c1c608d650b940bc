"""Compute a range map with the stereo head's noise from the true shape of a simulated cloth.

Rendering and matching one look takes half a minute; studies of thousands of looks use this instead.
Modelled: the sensor's resolution, and noise of the size and smoothness of its profile. Not
modelled: occlusion behind folds, hole filling of the matcher, steps rounded by its windows, errors
of segmentation, of calibration and of the head's angles. The map is valid wherever a camera
straight above has a view.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.errors import InputError
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.sensor import noise_profile
from unwrinkle.simulation.cloth.cloth import Cloth, ClothState
from unwrinkle.simulation.cloth.measures import height_map

#: Margin of table around the cloth, m.
MARGIN = 0.05
#: Sensors whose noise this module models.
SENSORS = ("stereo", "stereo-head")
#: Standard deviation of the Gaussian blur, m: its noise correlates over about 4 mm, as in
#: models/data/sensors/stereo-head.yaml.
NOISE_BLUR = 0.002


def true_range_map(
    cloth: Cloth, state: ClothState, seed: int, *, sensor: str = "stereo-head"
) -> RangeMap:
    """Return the cloth's upper surface and the table around it, with a stereo sensor's noise.

    Args:
        cloth: solver of the cloth.
        state: state of the cloth.
        seed: seed of this look's noise, 0 or more.
        sensor: noise profile, "stereo-head" or "stereo".

    Returns:
        Range map in W with a margin of table; cells that have neither cloth nor table are not
        valid.

    Raises:
        InputError: the sensor's noise is of another kind (bands and steps of a depth camera), or
            the seed is bad.
    """
    if sensor not in SENSORS:
        raise InputError(
            f"range map of the true cloth: the noise of sensor {sensor!r} is not modelled; "
            f"give one of {', '.join(SENSORS)}, or render the depth camera's image"
        )
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise InputError(
            f"range map of the true cloth: seed {seed!r}; give a whole number, 0 or more"
        )
    profile = noise_profile(sensor)
    above_flat, first = height_map(cloth, state, profile.resolution)
    cells = round(MARGIN / profile.resolution)
    above_flat = np.pad(above_flat, cells, constant_values=np.nan)
    origin = np.asarray(first) - cells * profile.resolution
    garment = np.isfinite(above_flat)
    # Flat cloth shows its upper side one thickness above the table.
    height = np.where(garment, above_flat + cloth.material.thickness, 0.0)
    noise = _noise(height.shape, NOISE_BLUR / profile.resolution, np.random.default_rng(seed))
    valid = garment | _on_table(cloth, origin, profile.resolution, height.shape)
    return RangeMap(
        height=(height + profile.depth_noise * noise).astype(np.float32),
        valid=valid,
        garment=garment,
        resolution=profile.resolution,
        origin=origin,
        table_height=cloth.table.height,
        sensor=sensor,
    )


def _noise(shape: tuple[int, ...], blur: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return Gaussian noise (ny, nx) of standard deviation 1, smooth over `blur` cells."""
    white = rng.standard_normal(shape)
    smooth = np.asarray(cv2.GaussianBlur(white, (0, 0), blur, borderType=cv2.BORDER_REFLECT))
    # The kernel's weights add up to 1; a normal one of sigma s keeps 1 / (2 s sqrt(pi)) of the
    # deviation.
    result: NDArray[np.float64] = smooth * (2.0 * blur * np.sqrt(np.pi))
    return result


def _on_table(
    cloth: Cloth, origin: NDArray[np.float64], resolution: float, shape: tuple[int, ...]
) -> NDArray[np.bool_]:
    centre, half = np.asarray(cloth.table.centre), 0.5 * np.asarray(cloth.table.size)
    x = origin[0] + resolution * np.arange(shape[1])
    y = origin[1] + resolution * np.arange(shape[0])
    on_x, on_y = np.abs(x - centre[0]) <= half[0], np.abs(y - centre[1]) <= half[1]
    result: NDArray[np.bool_] = on_y[:, None] & on_x[None, :]
    return result
