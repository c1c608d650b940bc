"""Outlines of flat garments on a grid of nodes."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from unwrinkle.models.errors import InputError
from unwrinkle.simulation.cloth.layout import MOST_NODES

#: Least number of nodes along the longer side.
FEWEST_NODES = 16

# Corners of half an outline (x >= 0), from top to bottom, metres; mirrored at x = 0. Children's
# sizes: larger garments would hang over the table of 0.8 m.
_TSHIRT = (
    (0.075, 0.260),  # the neck ends at the shoulder
    (0.180, 0.235),
    (0.330, 0.130),  # sleeve, outer corner
    (0.285, 0.055),  # sleeve, inner corner
    (0.190, 0.110),  # armpit
    (0.190, -0.260),
)
#: Half width and depth of the neck's curve, metres.
_NECK = (0.075, 0.045)
_TROUSERS = (
    (0.140, 0.280),
    (0.165, 0.060),
    (0.170, -0.280),
    (0.060, -0.280),
    (0.008, 0.050),  # crotch
)
_SIZES = {"towel": (0.48, 0.48), "dishcloth": (0.54, 0.38), "tshirt": (0.66, 0.52)}
_SIZES["trousers"] = (0.34, 0.56)
NAMES = tuple(_SIZES)


@dataclass(frozen=True, eq=False)
class Outline:
    """Outline of a garment: the nodes of a grid that are cloth.

    Attributes:
        name: of the garment.
        mask: (nx, ny) bool, nodes of cloth. The first axis is x, the second y; seen from above with
            the collar or waist up, x points right and y up.
        spacing: distance of neighbouring nodes, m.
    """

    name: str
    mask: NDArray[np.bool_]
    spacing: float

    def __post_init__(self) -> None:
        """Check that the mask is one piece of cloth and make it read-only."""
        mask = np.array(self.mask, dtype=bool)
        if mask.ndim != 2 or min(mask.shape) < 3 or max(mask.shape) > MOST_NODES:
            raise InputError(
                f"outline {self.name!r}: mask of {mask.shape}; give 3 to {MOST_NODES} nodes a side"
            )
        if not (np.isfinite(self.spacing) and 5e-4 <= self.spacing <= 0.1):
            raise InputError(
                f"outline {self.name!r}: spacing {self.spacing:g} m; give 0.0005 to 0.1"
            )
        cells = _cells(mask)
        if not cells.any() or (_of_cells(cells) != mask).any():
            raise InputError(
                f"outline {self.name!r}: {int((_of_cells(cells) != mask).sum())} of its nodes "
                "belong to no square of four nodes; remove them"
            )
        if ndimage.label(cells)[1] != 1:
            raise InputError(f"outline {self.name!r}: is more than one piece; keep one")
        mask.flags.writeable = False
        object.__setattr__(self, "mask", mask)

    @property
    def cells(self) -> NDArray[np.bool_]:
        """Squares of cloth between four nodes, (nx - 1, ny - 1)."""
        return _cells(self.mask)

    @property
    def area(self) -> float:
        """Area of the flat garment, m^2."""
        return float(self.cells.sum()) * self.spacing**2

    @property
    def corners(self) -> NDArray[np.float64]:
        """Corners (n, 2) of the garment's border in its plane, m, within a node's spacing."""
        fine = np.kron(self.cells.T.astype(np.uint8), np.ones((4, 4), dtype=np.uint8))
        borders, _ = cv2.findContours(np.pad(fine, 1), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        border = max(borders, key=cv2.contourArea)[:, 0].astype(np.float32)
        # The border runs through the outermost pixels' centres: half a pixel inside the cells.
        nodes = (border - 1.0 + 0.5) / 4.0
        middle = 0.5 * np.array(self.cells.shape)
        grown = (nodes - middle) * (1.0 + 0.25 / np.array(self.cells.shape))
        points = (grown * self.spacing).astype(np.float32)
        return cv2.approxPolyDP(points, 0.75 * self.spacing, True)[:, 0].astype(float)

    @property
    def plane(self) -> NDArray[np.float64]:
        """Positions (nx, ny, 2) of all nodes in the garment's plane, centred at 0, m."""
        sides = [(np.arange(n) - 0.5 * (n - 1)) * self.spacing for n in self.mask.shape]
        return np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1)


def outline(name: str, nodes: int) -> Outline:
    """Build the outline of a garment with `nodes` nodes along its longer side.

    Towel 0.48 x 0.48 m, dishcloth 0.54 x 0.38 m, T-shirt 0.66 x 0.52 m (sleeves spread, collar at
    +y), trousers 0.34 x 0.56 m (waist at +y). Shirt and trousers are one layer of cloth.

    Raises:
        InputError: unknown name, or the number of nodes is out of range.
    """
    if name not in _SIZES:
        raise InputError(f"no garment outline is called {name!r}; try one of {', '.join(NAMES)}")
    if not FEWEST_NODES <= nodes <= MOST_NODES:
        raise InputError(
            f"outline {name!r} of {nodes} nodes; give {FEWEST_NODES} to {MOST_NODES} a side"
        )
    size = np.array(_SIZES[name])
    spacing = float(size.max()) / (nodes - 1)
    nx, ny = (np.round(size / spacing).astype(int) + 1).tolist()
    if name in {"towel", "dishcloth"}:
        return Outline(name, np.ones((nx, ny), dtype=bool), spacing)
    u = (np.arange(nx - 1) - 0.5 * (nx - 2)) * spacing
    v = (np.arange(ny - 1) - 0.5 * (ny - 2)) * spacing
    half = np.array(_TSHIRT if name == "tshirt" else _TROUSERS, dtype=np.float32)
    corners = np.concatenate([half, half[::-1] * np.array([-1.0, 1.0], dtype=np.float32)])
    inside = np.array(
        [[cv2.pointPolygonTest(corners, (float(a), float(b)), False) > 0 for b in v] for a in u]
    )
    if name == "tshirt":
        neck = (u[:, None] / _NECK[0]) ** 2 + ((v[None, :] - 0.5 * size[1]) / _NECK[1]) ** 2
        inside &= neck > 1.0
    return Outline(name, _of_cells(inside), spacing)


def _cells(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    return mask[:-1, :-1] & mask[1:, :-1] & mask[:-1, 1:] & mask[1:, 1:]


def _of_cells(cells: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the mask of nodes at the corners of the cells."""
    wide = np.pad(cells, 1)
    return wide[:-1, :-1] | wide[1:, :-1] | wide[:-1, 1:] | wide[1:, 1:]
