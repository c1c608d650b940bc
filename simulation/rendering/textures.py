"""Textures of rendered surfaces: cloth, wood and uniform colours.

Texel sizes are in metres. At 2.4 m a pixel of the stereo head covers 0.33 mm, so that texels of
0.25 to 0.3 mm are as fine as an image resolves; finer ones alias.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.errors import InputError

#: Default texel, metres.
TEXEL = 0.0003

#: Kinds of cloth.
CLOTHS = ("terry", "print", "plain")

#: Noise of terry: sigma (metres) and standard deviation (grey levels) of each component.
_TERRY_NOISE = ((0.0, 20.0), (0.00035, 24.0), (0.0009, 18.0), (0.003, 9.0), (0.012, 7.0))

#: Period of the weave, metres.
_WEAVE_PERIOD_M = 0.0016

#: Amplitude of the weave, grey levels.
_WEAVE_STRENGTH = 9.0

#: Contrast of plain cloth, relative to terry.
_PLAIN_CONTRAST = 0.25

#: RGB colours of printed dots.
_DOT_COLOURS = ((196.0, 84.0, 72.0), (224.0, 188.0, 96.0), (72.0, 96.0, 132.0))


@dataclass(frozen=True, eq=False)
class Texture:
    """Image texture of a mesh.

    Attributes:
        pixels: (h, w, 3) uint8 RGB; not copied, made read-only.

    Raises:
        InputError: wrong shape or type.
    """

    pixels: NDArray[np.uint8]

    def __post_init__(self) -> None:
        """Check shape and type."""
        pixels = self.pixels
        if pixels.ndim != 3 or pixels.shape[2] != 3 or pixels.dtype != np.uint8:
            raise InputError(f"texture: {pixels.dtype} {pixels.shape}, wanted uint8 (h, w, 3), RGB")
        pixels.setflags(write=False)

    @cached_property
    def png(self) -> bytes:
        """The image as PNG, with fast compression."""
        bgr = np.ascontiguousarray(self.pixels[..., ::-1])
        done, data = cv2.imencode(".png", bgr, [cv2.IMWRITE_PNG_COMPRESSION, 1])
        if not done:
            raise InputError(f"texture {self.pixels.shape}: cannot be encoded as PNG")
        return bytes(np.asarray(data).tobytes())


@lru_cache(maxsize=8)
def cloth(kind: str, size: tuple[float, float], *, texel: float = TEXEL, seed: int = 0) -> Texture:
    """Return a texture of cloth; cached within a process.

    Args:
        kind: "terry" (strong texture), "print" (terry with coloured bands and dots) or "plain" (a
            quarter of terry's contrast).
        size: width and height that the image covers, metres.
        texel: metres per texel.
        seed: of the texture.

    Raises:
        InputError: unknown kind, or more than 100 million texels.
    """
    if kind not in CLOTHS:
        raise InputError(f"texture {kind!r}: unknown; known are {', '.join(CLOTHS)}")
    shape = _shape(size, texel)
    rng = np.random.default_rng(seed)
    grey = sum(
        (_blotches(shape, sigma / texel, strength, rng) for sigma, strength in _TERRY_NOISE),
        start=np.zeros(shape, dtype=np.float32),
    )
    x = (np.arange(shape[1], dtype=np.float32) + 0.5) * np.float32(texel)
    y = (np.arange(shape[0], dtype=np.float32) + 0.5) * np.float32(texel)
    turns = np.float32(2.0 * np.pi / _WEAVE_PERIOD_M)
    grey += _WEAVE_STRENGTH * np.outer(np.sin(turns * y), np.sin(turns * x))
    if kind == "plain":
        return _tinted(_PLAIN_CONTRAST * grey, _full(shape, (178.0, 180.0, 182.0)))
    colour = _full(shape, (148.0, 166.0, 188.0))
    if kind == "print":
        _print_on(colour, texel, rng)
    return _tinted(grey, colour)


@lru_cache(maxsize=4)
def wood(size: tuple[float, float], *, texel: float = TEXEL, seed: int = 0) -> Texture:
    """Return a texture of wood with its grain along x; cached within a process.

    Args:
        size: width and height that the image covers, metres.
        texel: metres per texel.
        seed: of the grain.

    Raises:
        InputError: more than 100 million texels.
    """
    shape = _shape(size, texel)
    rng = np.random.default_rng(seed + 1000)
    fine = _blotches((shape[0], max(1, shape[1] // 16)), 1.0, 8.0, rng)
    grain = cv2.resize(fine, (shape[1], shape[0]), interpolation=cv2.INTER_LINEAR)
    grey = np.asarray(grain) + _blotches(shape, 0.0, 5.0, rng)
    for sigma, strength in ((0.0006, 6.0), (0.004, 6.0), (0.03, 8.0)):
        grey += _blotches(shape, sigma / texel, strength, rng)
    return _tinted(grey, _full(shape, (168.0, 140.0, 106.0)))


def uniform(colour: tuple[int, int, int], shape: tuple[int, int] = (4, 4)) -> Texture:
    """Return a texture of one RGB colour."""
    return Texture(np.full((*shape, 3), colour, dtype=np.uint8))


def _shape(size: tuple[float, float], texel: float) -> tuple[int, int]:
    rows, columns = (max(2, round(length / texel)) for length in (size[1], size[0]))
    if rows * columns > 100_000_000:
        raise InputError(
            f"texture: {columns} x {rows} texels are over 100 million; make the texel of "
            f"{1e3 * texel:g} mm larger"
        )
    return rows, columns


def _full(shape: tuple[int, int], colour: tuple[float, float, float]) -> NDArray[np.float32]:
    return np.full((*shape, 3), colour, dtype=np.float32)


def _blotches(
    shape: tuple[int, int], sigma: float, strength: float, rng: np.random.Generator
) -> NDArray[np.float32]:
    """Return Gaussian noise smoothed by sigma (texels), with standard deviation `strength`."""
    step = max(1, int(sigma / 3.0))  # smooth noise is generated at low resolution and enlarged
    small = tuple(-(-length // step) + 1 for length in shape)
    noise = rng.standard_normal(small, dtype=np.float32)
    if sigma > 0.0:
        noise = np.asarray(cv2.GaussianBlur(noise, (0, 0), sigma / step))
    noise *= np.float32(strength / max(float(noise.std()), 1e-6))
    if step > 1:
        large = (small[1] * step, small[0] * step)
        noise = np.asarray(cv2.resize(noise, large, interpolation=cv2.INTER_CUBIC))
    return np.asarray(noise[: shape[0], : shape[1]], dtype=np.float32)


def _print_on(colour: NDArray[np.float32], texel: float, rng: np.random.Generator) -> None:
    """Draw bands along x and random dots."""
    rows, columns = colour.shape[:2]
    for middle in (0.1, 0.3, 0.5, 0.7, 0.9):
        half = 0.5 * 0.018 / texel
        band = slice(int(middle * rows - half), int(middle * rows + half))
        colour[band] *= np.array([0.55, 0.62, 0.95], dtype=np.float32)
    for _ in range(int(rows * columns * texel * texel / 0.0016)):
        x, y = int(rng.integers(columns)), int(rng.integers(rows))
        radius = int(rng.uniform(0.003, 0.008) / texel)
        cv2.circle(colour, (x, y), radius, _DOT_COLOURS[int(rng.integers(len(_DOT_COLOURS)))], -1)


def _tinted(grey: NDArray[np.float32], colour: NDArray[np.float32]) -> Texture:
    colour += np.asarray(grey, dtype=np.float32)[..., None]
    return Texture(np.clip(np.rint(colour), 0, 255).astype(np.uint8))
