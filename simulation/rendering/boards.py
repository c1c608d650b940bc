"""Rendered calibration boards (chessboard and ChArUco) with known corners.

Board frame B: origin at the outer top left corner of the pattern, x along its rows to the right, y
down its columns, z into the board, away from the viewer (OpenCV's convention for boards).
"""

import dataclasses as dc
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.errors import InputError
from unwrinkle.simulation.rendering.meshes import TexturedMesh
from unwrinkle.simulation.rendering.textures import Texture

#: Grey level of the print.
_BLACK = 22

#: Grey level of the paper.
_WHITE = 232

#: Default largest texel, metres.
_TEXEL_M = 0.0002

#: Limit of the texels along a side.
_MAX_TEXELS = 6000


@dataclass(frozen=True, eq=False)
class RenderedBoard:
    """Mesh of a calibration board with its corners.

    Attributes:
        mesh: item for a scene, in frame B.
        corners: (n, 3) inner corners p_BQ, row by row, metres.
        squares: numbers of columns and rows of squares.
        square: side of a square, metres.
    """

    mesh: TexturedMesh
    corners: NDArray[np.float64]
    squares: tuple[int, int]
    square: float

    def at(self, X_WB: NDArray[np.floating[Any]]) -> "RenderedBoard":
        """Return the board at a pose X_WB (4, 4)."""
        mesh = dc.replace(self.mesh, X_WM=np.asarray(X_WB, dtype=float))
        return dc.replace(self, mesh=mesh)


def chessboard(
    columns: int,
    rows: int,
    square: float,
    *,
    name: str = "board",
    texel: float = _TEXEL_M,
) -> RenderedBoard:
    """Build a chessboard of columns x rows squares with a white margin one square wide.

    Args:
        columns, rows: squares along each side, one more than inner corners.
        square: side of a square, metres.
        name: of the item in the scene.
        texel: largest texel, metres; at 2.4 m a pixel of the stereo head covers 0.33 mm. Render
            with `quality` 2 or more.

    Raises:
        InputError: fewer than 3 squares along a side, a size that is not positive, or too many
            texels.
    """
    count = _texels(columns, rows, square, texel)
    white = np.add.outer(np.arange(rows), np.arange(columns)) % 2
    pattern = (255 * white).astype(np.uint8).repeat(count, axis=0).repeat(count, axis=1)
    return _board(name, pattern, (columns, rows), square, count)


def charuco_board(
    columns: int,
    rows: int,
    square: float,
    marker: float,
    *,
    dictionary: int = cv2.aruco.DICT_5X5_100,
    name: str = "board",
    texel: float = _TEXEL_M,
) -> RenderedBoard:
    """Build a ChArUco board as `cv2.aruco.CharucoBoard((columns, rows), square, marker)` draws it.

    Args:
        columns, rows: squares along each side.
        square, marker: sides of a square and of a marker, metres.
        dictionary: OpenCV's number of the marker dictionary.
        name: of the item in the scene.
        texel: largest texel, metres.

    Raises:
        InputError: as `chessboard`, or a marker that does not fit its square.
    """
    if not 0.0 < marker < square:
        raise InputError(f"board: a marker of {marker} m must be smaller than its square, {square}")
    count = _texels(columns, rows, square, texel)
    board = cv2.aruco.CharucoBoard(
        (columns, rows), square, marker, cv2.aruco.getPredefinedDictionary(dictionary)
    )
    pattern = board.generateImage((columns * count, rows * count), marginSize=0)
    return _board(name, np.asarray(pattern, dtype=np.uint8), (columns, rows), square, count)


def _texels(columns: int, rows: int, square: float, texel: float) -> int:
    """Return the number of texels along the side of a square."""
    if min(columns, rows) < 3 or not (np.isfinite(square) and square > 0.0 and texel > 0.0):
        raise InputError(
            f"board: {columns} x {rows} squares of {square} m with texels of {texel} m; wanted 3 "
            "squares or more along each side, and positive sizes"
        )
    count = int(np.ceil(square / texel))
    if count * (max(columns, rows) + 2) > _MAX_TEXELS:
        raise InputError(
            f"board: {max(columns, rows)} squares of {count} texels are over {_MAX_TEXELS} texels "
            "along a side; make the texels larger"
        )
    return count


def _board(
    name: str, pattern: NDArray[np.uint8], squares: tuple[int, int], square: float, count: int
) -> RenderedBoard:
    columns, rows = squares
    framed = np.pad(pattern, count, constant_values=255).astype(np.float32)
    grey = np.rint(_BLACK + (_WHITE - _BLACK) / 255.0 * framed).astype(np.uint8)
    u, v = (values.ravel() for values in np.meshgrid([0.0, 1.0], [0.0, 1.0]))
    x = u * (columns + 2) * square - square
    y = (1.0 - v) * (rows + 2) * square - square
    mesh = TexturedMesh(
        name=name,
        vertices=np.column_stack([x, y, np.zeros(4)]),
        triangles=np.array([[0, 1, 3], [0, 3, 2]]),  # faces -z, towards the viewer
        uv=np.column_stack([u, v]),
        texture=Texture(np.repeat(grey[..., None], 3, axis=2)),
    )
    i, j = np.meshgrid(np.arange(1, columns), np.arange(1, rows))
    corners = np.stack([i, j, np.zeros_like(i)], axis=-1).reshape(-1, 3).astype(float) * square
    corners.setflags(write=False)
    return RenderedBoard(mesh, corners, squares, square)
