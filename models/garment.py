"""What is known of a garment from a look at it flat, or from a file: area, outline, thickness.

A wrinkle keeps the area of the cloth's surface, and a hidden layer takes it away: with the flat
area known, a folded garment can be told from a wrinkled one.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field
from pathlib import Path

import cv2
import numpy as np
import yaml
from numpy.typing import NDArray

from unwrinkle.models.errors import InputError
from unwrinkle.models.io.files import write_text
from unwrinkle.models.io.loader_yaml import load_yaml

#: Limits of a garment's flat area, m^2, and of the thickness of a layer, metres.
_AREAS_M2 = (0.005, 6.0)
_MOST_THICKNESS_M = 0.03

#: Greatest difference between the area of the outline and the flat area, share.
_AREA_TOLERANCE = 0.1


@dataclass(frozen=True)
class KnownGarment:
    """A garment as it is when flat.

    Attributes:
        name: for messages.
        flat_area: of one side, m^2.
        thickness: of the flat garment, metres; 0 if it is not known.
        outline: corners (n, 2) of the flat garment, metres, in order, centred at its centroid;
            empty if it is not known.

    Raises:
        InputError: a value is out of range, or outline and area contradict each other.
    """

    name: str = ""
    flat_area: float = 0.0
    thickness: float = 0.0
    outline: list[list[float]] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Check the values."""
        label = f"garment {self.name!r}"
        low, high = _AREAS_M2
        if not (math.isfinite(self.flat_area) and low <= self.flat_area <= high):
            raise InputError(
                f"{label}: flat_area is {self.flat_area:g} m^2; give {low:g} to {high:g} (width "
                "times length of a towel, in metres)"
            )
        if not (math.isfinite(self.thickness) and 0.0 <= self.thickness <= _MOST_THICKNESS_M):
            raise InputError(
                f"{label}: thickness is {self.thickness:g} m; give 0 (not known) to "
                f"{_MOST_THICKNESS_M:g}"
            )
        if not self.outline:
            return
        points = self.corners
        if points.ndim != 2 or points.shape[1] != 2 or len(points) < 3:
            raise InputError(f"{label}: outline needs three or more corners [x, y], in metres")
        if not np.isfinite(points).all():
            raise InputError(f"{label}: outline has a corner that is not finite")
        area = abs(cv2.contourArea(points.astype(np.float32)))
        if abs(area - self.flat_area) > _AREA_TOLERANCE * self.flat_area:
            raise InputError(
                f"{label}: the outline encloses {area:.4f} m^2, flat_area is "
                f"{self.flat_area:.4f}; both are in metres"
            )

    @property
    def corners(self) -> NDArray[np.float64]:
        """Corners (n, 2) of the outline, metres."""
        try:
            return np.array(self.outline, dtype=float)
        except ValueError:
            raise InputError(
                f"garment {self.name!r}: outline needs corners [x, y], in metres"
            ) from None

    def save(self, path: str | Path) -> None:
        """Write a `.garment.yaml`."""
        plain = asdict(self)
        plain["outline"] = [[round(float(v), 5) for v in corner] for corner in self.outline]
        text = yaml.safe_dump(plain, sort_keys=False, default_flow_style=None)
        write_text(path, "# A garment as it lies flat: m^2, metres.\n" + text)


def load_garment(path: str | Path) -> KnownGarment:
    """Read what `KnownGarment.save` wrote, or a file with `name` and `flat_area` alone.

    Raises:
        InputError: missing file, unknown key, or values out of range.
    """
    try:
        return load_yaml(Path(path), KnownGarment)
    except InputError as error:
        text = str(error)
        raise InputError(text if str(path) in text else f"{path}: {text}") from None


def rectangle(name: str, width: float, length: float, thickness: float = 0.0) -> KnownGarment:
    """Return a rectangular garment, such as a towel, by its sides, metres."""
    x, y = 0.5 * width, 0.5 * length
    corners = [[-x, -y], [x, -y], [x, y], [-x, y]]
    return KnownGarment(name, width * length, thickness, corners)
