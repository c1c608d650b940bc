"""Simulated photographs from ideal images: lens distortion, blur, vignetting and sensor noise.

Distortion and blur are one sum: each pixel is a Gaussian mean of the ideal image around the
position of its ray. A Gaussian of 0.4 pixels or more is itself a good interpolator, so that no
further blur occurs, and positions are exact (cv2.remap rounds them to 1/32 pixel).
"""

import dataclasses as dc
from dataclasses import dataclass
from math import ceil

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.arrays import Pose
from unwrinkle.models.compiled import njit
from unwrinkle.models.errors import InputError
from unwrinkle.perception.camera import Camera
from unwrinkle.simulation.rendering.renderer import Renderer

#: Sub-pixel phases of the interpolation weights.
_PHASES = 1024

#: Radius of the blur kernel, multiples of sigma.
_KERNEL_SIGMAS = 3.3

#: Fixed-point iterations of the undistortion; each reduces the error by a factor of 20 or more.
_UNDISTORTION_ITERATIONS = 12

#: Rows of the image that are computed at once.
_BLOCK_ROWS = 256

#: Pixels of a row between exactly computed positions; interpolated ones are within 0.0003 pixels.
_SEGMENT_PX = 8

#: Least sigma of the blur, pixels; a narrower Gaussian cannot interpolate.
_MIN_BLUR_PX = 0.4

#: Weights of red, green and blue in the grey level.
_GREY_WEIGHTS = np.array([0.299, 0.587, 0.114], dtype=np.float32)


@dataclass(frozen=True)
class SensorModel:
    """Parameters of lens and sensor.

    Attributes:
        blur: sigma of the lens blur, pixels.
        vignetting: relative loss of light in the image's corners; it grows with the square of the
            distance from the centre.
        mismatch: relative brightness difference of the left to the right eye.
        shot_gain: variance per grey level (grey levels per photo-electron).
        read_noise: standard deviation in the dark, grey levels.

    Raises:
        InputError: a parameter is out of range, or the blur is neither 0 nor at least 0.4.
    """

    blur: float = 0.6
    vignetting: float = 0.12
    mismatch: float = 0.04
    shot_gain: float = 0.35
    read_noise: float = 1.2

    def __post_init__(self) -> None:
        """Check the range of the parameters."""
        values = dc.astuple(self)
        if not np.isfinite(values).all() or min(self.blur, self.shot_gain, self.read_noise) < 0.0:
            raise InputError(f"sensor model: {self} has a negative number, or one not finite")
        if 0.0 < self.blur < _MIN_BLUR_PX or self.blur > 8.0:
            raise InputError(
                f"sensor model: blur {self.blur} px, wanted 0 or {_MIN_BLUR_PX} to 8; a narrower "
                "one cannot interpolate"
            )
        if not (0.0 <= self.vignetting < 1.0 and abs(self.mismatch) < 1.0):
            raise InputError(f"sensor model: {self} needs vignetting 0 to 1, mismatch -1 to 1")


#: Model without blur, noise or vignetting.
IDEAL = SensorModel(0.0, 0.0, 0.0, 0.0, 0.0)


def oversized(camera: Camera, model: SensorModel | None = None) -> Camera:
    """Return the pinhole camera of the same focal lengths that covers the distorted one's view.

    Raises:
        InputError: the distortion is not invertible within the image.
    """
    reach = 1 + _reach((model or SensorModel()).blur)
    low, high = _undistorted_bounds(camera)
    left, top = (max(0, ceil(-value)) + reach for value in low)
    right = max(0, ceil(high[0] - (camera.width - 1))) + reach
    below = max(0, ceil(high[1] - (camera.height - 1))) + reach
    return dc.replace(
        camera,
        distortion=[],
        width=camera.width + left + right,
        height=camera.height + top + below,
        cx=camera.cx + left,
        cy=camera.cy + top,
    )


def photograph(
    ideal: NDArray[np.uint8],
    ideal_camera: Camera,
    camera: Camera,
    model: SensorModel | None = None,
    *,
    seed: int,
    gain: float = 1.0,
) -> NDArray[np.uint8]:
    """Simulate a photograph from an ideal image.

    The noise is that of the grey level, the same in all three channels: matching uses grey levels,
    and independent noise of the channels would average out.

    Args:
        ideal: (h', w', 3) or (h', w') uint8 image of `ideal_camera`.
        ideal_camera: `oversized(camera)`.
        camera: camera with its distortion.
        model: lens and sensor; None for the default.
        seed: of the noise.
        gain: brightness of this eye.

    Returns:
        The photograph, (h, w, 3) or (h, w) uint8, of the camera's size.

    Raises:
        InputError: the size of the ideal image differs from its camera's.
    """
    model = model or SensorModel()
    if ideal.shape[:2] != (ideal_camera.height, ideal_camera.width):
        raise InputError(
            f"photograph: the picture is {ideal.shape[1]} x {ideal.shape[0]}, its camera "
            f"{ideal_camera.width} x {ideal_camera.height}; pass what was rendered with it"
        )
    source = np.ascontiguousarray(ideal if ideal.ndim == 3 else ideal[..., None])
    result = np.empty((camera.height, camera.width, source.shape[2]), dtype=np.uint8)
    weights = _blur_weights(model.blur)
    lens = _lens(camera)
    shift = np.array([ideal_camera.cx - camera.cx, ideal_camera.cy - camera.cy])
    rng = np.random.default_rng(seed)
    grey = _GREY_WEIGHTS if source.shape[2] == 3 else np.ones(source.shape[2], dtype=np.float32)
    for top in range(0, camera.height, _BLOCK_ROWS):
        rows = min(_BLOCK_ROWS, camera.height - top)
        light = np.empty((rows, camera.width, source.shape[2]), dtype=np.float32)
        _resample(source, weights, lens, shift, top, light)
        light *= np.float32(gain) * _vignette(camera, model.vignetting, top, rows)[..., None]
        if model.shot_gain > 0.0 or model.read_noise > 0.0:
            variance = np.float32(model.shot_gain) * (light @ grey)
            variance += np.float32(model.read_noise**2)
            noise = rng.standard_normal(variance.shape, dtype=np.float32)
            light += (noise * np.sqrt(variance))[..., None]
        np.clip(np.rint(light, out=light), 0.0, 255.0, out=light)
        result[top : top + rows] = light
    return result if ideal.ndim == 3 else result[..., 0]


def photograph_pair(
    renderer: Renderer,
    eyes: tuple[Camera, Pose, Camera, Pose],
    seed: int,
    *,
    scale: float = 1.0,
    colour: bool = True,
    model: SensorModel | None = None,
    quality: int | None = None,
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Simulate a simultaneous pair of photographs of a scene.

    Args:
        renderer: the scene.
        eyes: left camera, its pose X_WL (4, 4), right camera, its pose X_WR (4, 4).
        seed: of the noise; use another one for each pair.
        scale: 1, 1/2, 1/4 and so on: area averages of the full photographs, see `scaled_camera`.
        colour: RGB instead of grey images.
        model: lens and sensor; None for the default.
        quality: samples per pixel along either axis, see `Renderer.colour`; None for 2, or 1 if the
            photographs are reduced.

    Returns:
        Left and right photograph, (h, w, 3) or (h, w) uint8.

    Raises:
        InputError: the scale does not divide the image size.
    """
    model = model or SensorModel()
    left, X_WL, right, X_WR = eyes
    quality = quality or (2 if scale == 1.0 else 1)
    seeds = np.random.SeedSequence(seed).generate_state(2)
    pictures = []
    for camera, X_WC, own_seed, side in (
        (left, X_WL, seeds[0], 1.0),
        (right, X_WR, seeds[1], -1.0),
    ):
        small = scaled_camera(camera, scale)
        wide = oversized(camera, model)
        ideal = renderer.colour(wide, X_WC, quality=quality)
        if not colour:
            ideal = np.asarray(cv2.cvtColor(ideal, cv2.COLOR_RGB2GRAY), dtype=np.uint8)
        gain = 1.0 + 0.5 * side * model.mismatch
        taken = photograph(ideal, wide, camera, model, seed=int(own_seed), gain=gain)
        if scale != 1.0:
            size = (small.width, small.height)
            taken = np.asarray(cv2.resize(taken, size, interpolation=cv2.INTER_AREA), np.uint8)
        pictures.append(taken)
    return pictures[0], pictures[1]


def scaled_camera(camera: Camera, scale: float) -> Camera:
    """Return the camera of an image averaged over blocks of 1/scale x 1/scale pixels.

    Raises:
        InputError: 1/scale is not an integer, or does not divide the image size.
    """
    block = round(1.0 / scale) if 0.0 < scale <= 1.0 else 0
    if block < 1 or abs(block * scale - 1.0) > 1e-9:
        raise InputError(f"scale {scale}: wanted 1, 1/2, 1/3, 1/4 and so on")
    if camera.width % block or camera.height % block:
        raise InputError(
            f"scale {scale}: {camera.width} x {camera.height} pixels make no whole blocks of "
            f"{block} x {block}; take 1, 0.5, 0.25 or 0.125"
        )
    return camera.scaled(1.0 / block)


def _reach(blur: float) -> int:
    return max(1, ceil(_KERNEL_SIGMAS * blur))


def _blur_weights(blur: float) -> NDArray[np.float32]:
    """Return the weights (phases, taps) of the neighbouring pixels by sub-pixel phase."""
    reach = _reach(blur)
    taps = np.arange(1 - reach, 1 + reach, dtype=float)
    away = taps - ((np.arange(_PHASES) + 0.5) / _PHASES)[:, None]
    if blur == 0.0:
        weights = np.maximum(0.0, 1.0 - np.abs(away))  # bilinear: exact without distortion
        weights[0] = taps == 0.0
    else:
        weights = np.exp(-0.5 * (away / blur) ** 2)
    return np.asarray(weights / weights.sum(axis=1, keepdims=True), dtype=np.float32)


def _lens(camera: Camera) -> NDArray[np.float64]:
    """Return fx, fy, cx, cy, k1, k2, p1, p2, k3."""
    lens = np.zeros(9)
    lens[:4] = camera.fx, camera.fy, camera.cx, camera.cy
    lens[4 : 4 + len(camera.distortion)] = camera.distortion
    return lens


def _undistorted_bounds(camera: Camera) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the least and greatest undistorted coordinates, each (2,), of the image's border."""
    u = np.linspace(0.0, camera.width - 1.0, 65)
    v = np.linspace(0.0, camera.height - 1.0, 65)
    border = np.concatenate(
        [np.column_stack([u, np.full(65, end)]) for end in (v[0], v[-1])]
        + [np.column_stack([np.full(65, end), v]) for end in (u[0], u[-1])]
    )
    lens = _lens(camera)
    ideal = np.array([_undistorted(lens, a, b) for a, b in border])
    rays = (ideal - lens[2:4]) / lens[:2]
    back = camera.project(np.column_stack([rays, np.ones(len(rays))]))
    if not np.isfinite(ideal).all() or np.abs(back - border).max() > 1e-3:
        raise InputError(
            f"camera {camera.name!r}: distortion {camera.distortion} folds the image over itself "
            "at its border; calibrate again"
        )
    return ideal.min(axis=0), ideal.max(axis=0)


def _vignette(camera: Camera, loss: float, top: int, rows: int) -> NDArray[np.float32]:
    """Return the relative illumination (rows, width) of the sensor."""
    middle = np.array([camera.width - 1, camera.height - 1]) / 2.0
    x = (np.arange(camera.width) - middle[0]) ** 2
    y = (np.arange(top, top + rows) - middle[1]) ** 2
    share = 1.0 - loss / float(middle @ middle) * (y[:, None] + x)
    return np.asarray(share, dtype=np.float32)


@njit()
def _undistorted(lens: NDArray[np.float64], u: float, v: float) -> tuple[float, float]:
    """Return the undistorted pixel of (u, v): inverts OpenCV's distortion by fixed-point steps."""
    x_seen, y_seen = (u - lens[2]) / lens[0], (v - lens[3]) / lens[1]
    x, y = x_seen, y_seen
    for _ in range(_UNDISTORTION_ITERATIONS):
        r2 = x * x + y * y
        radial = 1.0 + r2 * (lens[4] + r2 * (lens[5] + r2 * lens[8]))
        dx = 2.0 * lens[6] * x * y + lens[7] * (r2 + 2.0 * x * x)
        dy = lens[6] * (r2 + 2.0 * y * y) + 2.0 * lens[7] * x * y
        x, y = (x_seen - dx) / radial, (y_seen - dy) / radial
    return x * lens[0] + lens[2], y * lens[1] + lens[3]


@njit(parallel=True, fastmath=True)
def _resample(
    source: NDArray[np.uint8],
    weights: NDArray[np.float32],
    lens: NDArray[np.float64],
    shift: NDArray[np.float64],
    top: int,
    result: NDArray[np.float32],
) -> None:
    """Compute rows of the photograph (rows, width, channels), starting at row `top`."""
    rows, width, channels = result.shape
    height_in, width_in = source.shape[:2]
    phases, taps = weights.shape
    before = taps // 2 - 1
    for i in numba.prange(rows):
        u_next, v_next = _undistorted(lens, 0.0, float(i + top))
        u, v, u_step, v_step = u_next, v_next, 0.0, 0.0
        for j in range(width):
            if j % _SEGMENT_PX == 0:
                u, v = u_next, v_next
                u_next, v_next = _undistorted(lens, float(j + _SEGMENT_PX), float(i + top))
                u_step, v_step = (u_next - u) / _SEGMENT_PX, (v_next - v) / _SEGMENT_PX
                # Rounding just below an integer must not select the pixel before it.
                u += shift[0] + 1e-9
                v += shift[1] + 1e-9
            else:
                u += u_step
                v += v_step
            column, row = int(np.floor(u)), int(np.floor(v))
            across, down = int((u - column) * phases), int((v - row) * phases)
            column = min(max(column - before, 0), width_in - taps)
            row = min(max(row - before, 0), height_in - taps)
            if channels == 3:
                red, green, blue = np.float32(0.0), np.float32(0.0), np.float32(0.0)
                for k in range(taps):
                    for m in range(taps):
                        weight = weights[down, k] * weights[across, m]
                        red += weight * np.float32(source[row + k, column + m, 0])
                        green += weight * np.float32(source[row + k, column + m, 1])
                        blue += weight * np.float32(source[row + k, column + m, 2])
                result[i, j, 0], result[i, j, 1], result[i, j, 2] = red, green, blue
            else:
                grey = np.float32(0.0)
                for k in range(taps):
                    for m in range(taps):
                        weight = weights[down, k] * weights[across, m]
                        grey += weight * np.float32(source[row + k, column + m, 0])
                result[i, j, 0] = grey
