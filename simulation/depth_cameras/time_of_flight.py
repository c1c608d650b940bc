"""Continuous-wave time-of-flight cameras (PMD CamCube): depth from the phase of returned light.

A pixel integrates the waves of all surfaces in its view. At a depth edge the phase of the sum lies
between those of the near and the far surface (a flying pixel).
"""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unwrinkle.perception.camera import Camera
from unwrinkle.simulation.depth_cameras._base import DepthCameraModel, incidence

#: Speed of light, m/s.
_SPEED_OF_LIGHT_M_S = 299_792_458.0


@dataclass(frozen=True)
class TimeOfFlightCamera(DepthCameraModel):
    """Camera with a modulated light source around its lens.

    Attributes:
        modulation: frequency, Hz.
        oversampling: n for n x n rays per pixel.
        blur: sigma of lens blur and crosstalk, pixels.
        range_noise: standard deviation of the range of a perpendicular surface at 1 m, metres.
        active_share: fraction of the total light from that surface that is the camera's own, 0 to
            1.
        least_amplitude: least amplitude of a reading, relative to that surface.
        pixel_offsets: standard deviation of the pixels' fixed offsets, metres.
        unit: seed of the individual sensor's offsets.

    Raises:
        InputError: as `DepthCameraModel`; a parameter is out of range, or the range exceeds half a
            wavelength, beyond which it is ambiguous.
    """

    modulation: float = 20e6
    oversampling: int = 4
    blur: float = 0.5
    range_noise: float = 0.0025
    active_share: float = 0.5
    least_amplitude: float = 0.02
    pixel_offsets: float = 0.001
    unit: int = 1

    def __post_init__(self) -> None:
        """Check the range of the parameters."""
        super().__post_init__()
        if not 1 <= self.oversampling <= 16 or self.active_share > 1.0:
            raise self._refusal(
                f"oversampling = {self.oversampling} must be 1 to 16, "
                f"active_share = {self.active_share} at most 1"
            )
        if self.modulation <= 0.0 or self.farthest > self.unambiguous:
            raise self._refusal(
                f"farthest = {self.farthest} m, at {self.modulation:.4g} Hz ranges repeat after "
                f"{self.unambiguous:.2f} m"
            )

    @property
    def unambiguous(self) -> float:
        """Unambiguous range: half the wavelength of the modulation, metres."""
        return 0.5 * _SPEED_OF_LIGHT_M_S / self.modulation if self.modulation > 0.0 else 0.0

    @property
    def ideal_camera(self) -> Camera:
        """The camera with n x n pixels per pixel."""
        return self.camera.scaled(float(self.oversampling))

    def measured(self, ideal: NDArray[np.floating[Any]], seed: int) -> NDArray[np.float32]:
        """Simulate the reading; see `DepthCameraModel.measured`.

        The range noise is proportional to the square root of the total light over the amplitude
        (R. Lange, P. Seitz, IEEE J. Quantum Electronics 37, 2001).
        """
        wave = self.return_wave(self._exact(ideal))
        amplitude = np.abs(wave)
        full_turn = 2.0 * np.pi
        distance = np.mod(np.angle(wave), full_turn) / full_turn * self.unambiguous
        background = self.active_share * amplitude + 1.0 - self.active_share
        heard = amplitude >= max(self.least_amplitude, 1e-12)
        sigma = self.range_noise * np.sqrt(background) / np.where(heard, amplitude, 1.0)
        shape = (self.camera.height, self.camera.width)
        distance = distance + sigma * np.random.default_rng(seed).standard_normal(shape)
        offsets = np.random.default_rng(self.unit).standard_normal(shape)
        distance += self.pixel_offsets * offsets
        x, y = self.camera.rays()
        reading = distance / np.sqrt(x * x + y * y + 1.0)
        found = heard & (reading >= self.nearest) & (reading <= self.farthest)
        return np.where(found, reading, 0.0).astype(np.float32)

    def return_wave(self, depth: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return the integrated wave (h, w) of each pixel, relative to a surface at 1 m.

        Args:
            depth: exact depth image of `ideal_camera`, metres; 0 for none.
        """
        x, y = self.ideal_camera.rays()
        distance = depth * np.sqrt(x * x + y * y + 1.0)
        seen = depth > 0.0
        # Inverse-square law of the illumination, and Lambertian reflection.
        amplitude = incidence(depth, self.ideal_camera) / np.where(seen, distance, np.inf) ** 2
        phase = 2.0 * np.pi * distance / self.unambiguous
        wave = np.stack([amplitude * np.cos(phase), amplitude * np.sin(phase)], axis=-1)
        if self.blur > 0.0:
            wave = np.asarray(cv2.GaussianBlur(wave, (0, 0), self.blur * self.oversampling))
        size = (self.camera.width, self.camera.height)
        wave = np.asarray(cv2.resize(wave, size, interpolation=cv2.INTER_AREA))
        return np.asarray(wave[..., 0] + 1j * wave[..., 1])
