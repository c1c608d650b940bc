"""Fit of the table plane under the garment, and of the depth sensor's low-frequency bias.

A plane n . p = 1 seen by a pinhole camera has inverse depth 1/z = n . (x, y, 1), linear in the ray.
The fit is therefore linear in inverse depth, in which structured light also has simple errors.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.errors import InsufficientViewError
from unwrinkle.perception.camera import Camera
from unwrinkle.perception.sensor import NoiseProfile

#: Trials of the consensus sampling.
_TRIALS = 600

#: Readings on which a trial is scored.
_SCORED_READINGS = 8000

#: Limit of the readings in the least-squares fit.
_MAX_FIT_READINGS = 80_000

#: Least fraction of the readings on the plane.
_MIN_TABLE_FRACTION = 0.08

#: Largest angle between the view and the table's normal, degrees.
_MAX_VIEW_ANGLE_DEG = 60.0

#: Least fraction of a column's pixels on the table for a bias of its own.
_MIN_COLUMN_FRACTION = 0.08


@dataclass(frozen=True, eq=False)
class TableFit:
    """Table plane in the camera frame C, and the depth with the bias removed.

    Attributes:
        normal_C: (3,) unit normal towards the camera (up).
        distance: from the camera to the plane, metres.
        depth: (h, w) bias-corrected depth along z of C, metres; 0 without a reading.
        height: (h, w) height above the plane, metres; 0 without a reading.
        table: (h, w) bool, readings on the plane.
        rms: RMS height of the readings on the plane, metres.
    """

    normal_C: NDArray[np.float64]
    distance: float
    depth: NDArray[np.float64]
    height: NDArray[np.float64]
    table: NDArray[np.bool_]
    rms: float


def fit_table(
    depth: NDArray[np.floating[Any]],
    camera: Camera,
    profile: NoiseProfile,
    *,
    exclude: NDArray[np.bool_] | None = None,
    seed: int = 0,
    name: str = "capture",
) -> TableFit:
    """Fit the table plane: much of the view lies on it and little below it.

    Args:
        depth: (h, w) metres along the optical axis, 0 for no reading.
        camera: intrinsics of the depth image.
        profile: noise of the sensor, and the kind of bias to remove.
        exclude: (h, w) bool, readings on the garment, left out of the fit.
        seed: of the consensus sampling.
        name: of the capture, for messages.

    Raises:
        InsufficientViewError: no plane has enough readings, or it is seen at a grazing angle.
    """
    x, y = camera.rays()
    seen = depth > 0.0
    usable = seen if exclude is None else seen & ~exclude
    if np.count_nonzero(usable) < 100:
        raise InsufficientViewError(
            f"{name}: too little of the table is seen; show table around the garment"
        )
    rng = np.random.default_rng(seed)
    rows, columns = np.nonzero(usable)
    if rows.size > _MAX_FIT_READINGS:
        pick = rng.choice(rows.size, _MAX_FIT_READINGS, replace=False)
        rows, columns = rows[pick], columns[pick]
    inverse = 1.0 / np.asarray(depth, dtype=float)[rows, columns]
    rays = np.column_stack([x[rows, columns], y[rows, columns], np.ones(rows.size)])
    band = max(2.0 * profile.depth_noise, 0.001)
    plane = _consensus(rays, inverse, band, rng)
    fitted = None
    for _ in range(8):
        height = _heights(rays, inverse, plane)
        on = (height > -3.0 * band) & (height < band)
        if fitted is not None and np.array_equal(on, fitted):
            break
        fitted = on
        if np.count_nonzero(on) < _MIN_TABLE_FRACTION * rows.size:
            raise InsufficientViewError(
                f"{name}: no table plane found (only {np.count_nonzero(on) / rows.size:.0%} of the "
                "readings agree on one); show more of a flat table around the garment"
            )
        plane = np.asarray(np.linalg.lstsq(rays[on], inverse[on], rcond=None)[0], dtype=float)
    length = float(np.linalg.norm(plane))
    tilt = np.degrees(np.arccos(np.clip(plane[2] / length, -1.0, 1.0)))
    if tilt > _MAX_VIEW_ANGLE_DEG:
        raise InsufficientViewError(
            f"{name}: the table is seen at {tilt:.0f} degrees from straight above, "
            f"at most {_MAX_VIEW_ANGLE_DEG:.0f} are usable; look from further above"
        )
    full_inverse = np.zeros(depth.shape)
    full_inverse[seen] = 1.0 / np.asarray(depth, dtype=float)[seen]
    level = plane[0] * x + plane[1] * y + plane[2]
    full_inverse -= _bias(full_inverse - level, usable, level, band, profile)
    height = np.where(seen, (full_inverse - level) / np.where(seen, full_inverse, 1.0), 0.0)
    height /= length
    table = usable & (np.abs(height) < 1.5 * band)
    corrected = np.where(seen, 1.0 / np.where(seen, full_inverse, 1.0), 0.0)
    rms = float(np.sqrt(np.mean(height[table] ** 2))) if table.any() else 0.0
    return TableFit(-plane / length, 1.0 / length, corrected, height, table, rms)


def _heights(
    rays: NDArray[np.float64], inverse: NDArray[np.float64], plane: NDArray[np.float64]
) -> NDArray[np.float64]:
    # (1 - n.p)/|n| with p = ray / inverse, positive towards the camera.
    heights: NDArray[np.float64] = (inverse - rays @ plane) / (inverse * np.linalg.norm(plane))
    return heights


def _consensus(
    rays: NDArray[np.float64],
    inverse: NDArray[np.float64],
    band: float,
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    pick = rng.choice(inverse.size, min(_SCORED_READINGS, inverse.size), replace=False)
    rays, inverse = rays[pick], inverse[pick]
    best, best_score = np.array([0.0, 0.0, np.median(inverse)]), -np.inf
    for _ in range(_TRIALS):
        three = rng.choice(inverse.size, 3, replace=False)
        if abs(np.linalg.det(rays[three])) < 1e-4:
            continue
        plane = np.asarray(np.linalg.solve(rays[three], inverse[three]), dtype=float)
        if plane[2] <= 0.0:
            continue
        height = _heights(rays, inverse, plane)
        on = np.count_nonzero(np.abs(height) < band)
        if on <= best_score:
            continue
        # Readings below the plane lower the score; those above may be the garment.
        below = (height < -2.0 * band) & (height > -0.1)
        score = on - 0.5 * np.count_nonzero(below)
        if score > best_score:
            best, best_score = plane, score
    return best


def _bias(
    residual: NDArray[np.float64],
    usable: NDArray[np.bool_],
    level: NDArray[np.float64],
    band: float,
    profile: NoiseProfile,
) -> NDArray[np.float64]:
    """Return the inverse-depth bias (h, w): a polynomial over the image and column offsets."""
    bias = np.zeros(residual.shape)
    if profile.bias_degree < 2 and not profile.column_bias:
        return bias
    limit = band * level**2  # a height of `band` as a change of inverse depth
    ny, nx = residual.shape
    degree = profile.bias_degree
    powers = np.arange(degree + 1)
    v = np.linspace(-1.0, 1.0, ny)[:, None] ** powers
    u = np.linspace(-1.0, 1.0, nx)[:, None] ** powers
    terms = np.nonzero(powers[:, None] + powers <= degree)  # exponents of v, of u
    step = max(1, int(np.sqrt(residual.size / _MAX_FIT_READINGS)))
    thin = (slice(None, None, step), slice(None, None, step))
    basis = v[::step, None, terms[0]] * u[::step, terms[1]]
    weights = np.zeros((degree + 1, degree + 1))
    for _ in range(4):
        rest = residual - bias
        on = usable & (rest < limit) & (rest > -2.0 * limit)
        if degree >= 2:
            chosen = basis[on[thin]]
            # The normal equations are well conditioned: few powers of numbers within -1 and 1.
            moments = chosen.T @ rest[thin][on[thin]]
            weights[terms] = np.linalg.lstsq(chosen.T @ chosen, moments, rcond=None)[0]
            bias += v @ weights @ u.T
        if profile.column_bias:
            bias += _columns(np.where(on, residual - bias, np.nan))
    return bias


def _columns(rest: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the median error per column, interpolated over columns with little table in view."""
    count = np.count_nonzero(np.isfinite(rest), axis=0)
    good = count >= _MIN_COLUMN_FRACTION * rest.shape[0]
    if np.count_nonzero(good) < 2:
        return np.zeros((1, rest.shape[1]))
    ordered, middle = np.sort(rest.T[good], axis=1), count[good]  # NaN last
    each = np.arange(middle.size)
    medians = 0.5 * (ordered[each, (middle - 1) // 2] + ordered[each, middle // 2])
    at = np.arange(rest.shape[1])
    offsets = np.interp(at, at[good], medians)
    return np.convolve(np.pad(offsets, 2, mode="edge"), np.full(5, 0.2), mode="valid")[None, :]
