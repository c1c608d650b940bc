"""Resampling of images into a rectified view: coarse map lattice, Catmull-Rom interpolation.

The map of a lens is smooth: it is computed exactly at every 8th or 16th pixel and interpolated
bilinearly in between (error below 0.006 pixel for the lenses in use). No full-size map is stored.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.compiled import njit
from unwrinkle.perception._parallel import parallel_rows
from unwrinkle.perception.camera import Camera

#: Spacing of the lattice, pixels.
_STEP = 16

#: Spacing for views of at most `_WIDE_PX` pixels.
_FINE_STEP = 8

#: Largest width of a view with the fine spacing, pixels.
_WIDE_PX = 2000

#: Position outside of every image, pixels.
_OUTSIDE_PX = -1e6


@dataclass(frozen=True, eq=False)
class Lattice:
    """Source columns and rows, (ny, nx) float32, pixels, at every `step`-th pixel of a view."""

    columns: NDArray[np.float32]
    rows: NDArray[np.float32]
    step: int

    def maps(self, shape: tuple[int, int]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return the full-size maps (h, w) float32, pixels, for `cv2.remap`."""
        return (
            _upsampled(self.columns, self.step, shape),
            _upsampled(self.rows, self.step, shape),
        )


def lattice(source: Camera, view: Camera, R_VS: NDArray[np.float64]) -> Lattice:
    """Compute the positions of an undistorted view's pixels in the image of its source camera.

    Args:
        source: camera with its distortion.
        view: pinhole camera with the same optical centre.
        R_VS: (3, 3) rotation of the source camera in the view's frame.
    """
    step = _STEP if view.width > _WIDE_PX else _FINE_STEP
    u = np.arange(-(-view.width // step) + 1) * float(step)
    v = np.arange(-(-view.height // step) + 1) * float(step)
    x, y = np.meshgrid((u - view.cx) / view.fx, (v - view.cy) / view.fy)
    p_SQ = np.stack([x, y, np.ones_like(x)], axis=-1) @ R_VS
    ahead = p_SQ[..., 2] > 1e-3
    safe = np.where(ahead[..., None], p_SQ, [0.0, 0.0, 1.0])
    pixels = source.project(safe)
    if any(source.distortion):
        ahead &= _unfolded(source, safe[..., :2] / safe[..., 2:])
    pixels[~ahead] = _OUTSIDE_PX
    columns, rows = np.moveaxis(pixels.astype(np.float32), -1, 0)
    return Lattice(np.ascontiguousarray(columns), np.ascontiguousarray(rows), step)


def warp(image: NDArray[np.uint8], where: Lattice, shape: tuple[int, int]) -> NDArray[np.uint8]:
    """Resample a grey image with the Catmull-Rom cubic; 0 where a tap is outside the image.

    Args:
        image: (h', w') uint8.
        where: positions in the image.
        shape: (h, w) of the result.
    """
    result = np.empty(shape, dtype=np.uint8)
    source = np.ascontiguousarray(image)
    height, width = source.shape
    # View of every four consecutive bytes as one little-endian word.
    words = np.ndarray((source.size - 3,), "<u4", source, strides=(1,))
    parallel_rows(
        _warp, shape[0], words, height, width, where.columns, where.rows, where.step, result
    )
    return result


def _unfolded(camera: Camera, xy: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return where the distorted radius grows with the radius, so that the mapping is unique."""
    k1, k2 = camera.distortion[:2]
    k3 = camera.distortion[4] if len(camera.distortion) > 4 else 0.0
    radius = np.linspace(0.0, max(1e-3, float(np.linalg.norm(xy, axis=-1).max())), 4096)
    square = radius**2
    slope = 1.0 + square * (3.0 * k1 + square * (5.0 * k2 + square * 7.0 * k3))
    falling = np.flatnonzero(slope <= 0.0)
    limit = radius[falling[0]] if falling.size else np.inf
    return np.asarray(np.linalg.norm(xy, axis=-1) < limit)


def _upsampled(
    values: NDArray[np.float32], step: int, shape: tuple[int, int]
) -> NDArray[np.float32]:
    grown = np.array([[1.0 / step, 0.0, 0.0], [0.0, 1.0 / step, 0.0]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    full = cv2.warpAffine(values, grown, shape[::-1], flags=flags, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(full, dtype=np.float32)


# Each stage is one loop over a row, which the compiler vectorises. The four pixels of a row of taps
# are read as one 32-bit word.


@njit(nogil=True, fastmath=True)
def _line(y: int, values: NDArray[np.float32], step: int, line: NDArray[np.float32]) -> None:
    """Interpolate the lattice at the pixels of row y."""
    i = y // step
    down, share = np.float32((y - i * step) / step), np.float32(1.0 / step)
    for j in range(values.shape[1] - 1):
        here = values[i, j] + down * (values[i + 1, j] - values[i, j])
        after = values[i, j + 1] + down * (values[i + 1, j + 1] - values[i, j + 1])
        slope = (after - here) * share
        for k in range(step):
            line[j * step + k] = here + slope * np.float32(k)


@njit(nogil=True, fastmath=True)
def _place(
    columns: NDArray[np.float32],
    rows: NDArray[np.float32],
    height: int,
    width: int,
    at: NDArray[np.int32],
    keep: NDArray[np.float32],
) -> None:
    """Compute the index of the first of 4 x 4 taps; replace columns and rows by fractions."""
    one, zero = np.float32(1.0), np.float32(0.0)
    right, bottom = np.float32(width - 3), np.float32(height - 3)
    for x in range(at.size):
        u = min(max(columns[x], one), right)
        v = min(max(rows[x], one), bottom)
        keep[x] = one if (u == columns[x]) and (v == rows[x]) else zero
        left, top = np.int32(u), np.int32(v)
        columns[x], rows[x] = u - np.float32(left), v - np.float32(top)
        at[x] = (top - np.int32(1)) * np.int32(width) + left - np.int32(1)


@njit(nogil=True, fastmath=True)
def _take(
    words: NDArray[np.uint32], at: NDArray[np.int32], width: int, taps: NDArray[np.uint32]
) -> None:
    for k in range(4):
        row, skip = taps[k], np.uint32(k * width)
        for x in range(at.size):
            row[x] = words[np.uint32(at[x]) + skip]


@njit(nogil=True, fastmath=True)
def _across(
    tap: NDArray[np.uint32], share: NDArray[np.float32], value: NDArray[np.float32]
) -> None:
    """Interpolate along a row of four taps with the Catmull-Rom cubic."""
    half, one, two = np.float32(0.5), np.float32(1.0), np.float32(2.0)
    three, five = np.float32(3.0), np.float32(5.0)
    byte, eight, sixteen, many = np.uint32(255), np.uint32(8), np.uint32(16), np.uint32(24)
    for x in range(share.size):
        s, t = share[x], tap[x]
        a0 = half * s * (s * (two - s) - one)
        a1 = one + half * s * s * (three * s - five)
        a3 = half * s * s * (s - one)
        value[x] = (
            a0 * np.float32(np.int32(t & byte))
            + a1 * np.float32(np.int32((t >> eight) & byte))
            + (one - a0 - a1 - a3) * np.float32(np.int32((t >> sixteen) & byte))
            + a3 * np.float32(np.int32(t >> many))
        )


@njit(nogil=True, fastmath=True)
def _down(
    values: NDArray[np.float32],
    share: NDArray[np.float32],
    keep: NDArray[np.float32],
    result: NDArray[np.uint8],
) -> None:
    """Interpolate down the four rows with the Catmull-Rom cubic, and round."""
    half, one, two = np.float32(0.5), np.float32(1.0), np.float32(2.0)
    three, five = np.float32(3.0), np.float32(5.0)
    zero, white = np.float32(0.0), np.float32(255.0)
    r0, r1, r2, r3 = values[0], values[1], values[2], values[3]
    for x in range(result.size):
        s = share[x]
        a0 = half * s * (s * (two - s) - one)
        a1 = one + half * s * s * (three * s - five)
        a3 = half * s * s * (s - one)
        grey = a0 * r0[x] + a1 * r1[x] + (one - a0 - a1 - a3) * r2[x] + a3 * r3[x]
        result[x] = np.uint8(np.int32(keep[x] * min(max(grey + half, zero), white)))


@njit(nogil=True)
def _warp(
    first: int,
    last: int,
    words: NDArray[np.uint32],
    height: int,
    width: int,
    columns: NDArray[np.float32],
    rows: NDArray[np.float32],
    step: int,
    result: NDArray[np.uint8],
) -> None:
    wide = result.shape[1]
    padded = (columns.shape[1] - 1) * step
    u, v = np.empty(padded, np.float32), np.empty(padded, np.float32)
    at, keep = np.empty(wide, np.int32), np.empty(wide, np.float32)
    taps, values = np.empty((4, wide), np.uint32), np.empty((4, wide), np.float32)
    for y in range(first, last):
        _line(y, columns, step, u)
        _line(y, rows, step, v)
        _place(u[:wide], v[:wide], height, width, at, keep)
        _take(words, at, width, taps)
        for k in range(4):
            _across(taps[k], u[:wide], values[k])
        _down(values, v[:wide], keep, result[y])
