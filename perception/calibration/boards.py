"""Calibration boards (chessboard and ChArUco) and the detection of their corners.

Board frame T: origin at the first inner corner, x along a row of corners, y along a column, z into
the board, away from the viewer. The first inner square of a chessboard (between its first four
corners) is dark. Pixel (0, 0) is the centre of the image's first pixel.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from unwrinkle.models.arrays import Pose
from unwrinkle.models.errors import InputError
from unwrinkle.models.io.images import decoded_images
from unwrinkle.models.transforms import pose
from unwrinkle.perception.camera import Camera

#: Least number of inner corners along a side.
_MIN_CORNERS = 3

#: Longest sides of the reduced images in which a board is searched in turn, pixels.
_SEARCH_SIZES_PX = (1300, 2600)

#: Half window of the corner refinement, fraction of the least height of a square in the image.
_WINDOW_FRACTION = 0.45

#: Limits of the half window, pixels.
_MIN_WINDOW_PX = 2
_MAX_WINDOW_PX = 60

#: Sigma of the smoothing before the refinement, fraction of the half window.
_SMOOTHING_FRACTION = 0.05

#: Largest shift of a corner in the refinement, fraction of a square's side.
_MAX_SHIFT_FRACTION = 0.35

#: Largest fraction of detected corners that are off the board's plane.
_MAX_OUTLIER_FRACTION = 0.2

#: Least fraction of a ChArUco board's corners.
_MIN_CORNER_FRACTION = 0.25


@dataclass(frozen=True)
class Board:
    """Calibration board: a flat pattern of squares.

    Attributes:
        columns, rows: inner corners along x and y.
        square: side of a square, metres.
        dictionary: OpenCV's name of the ArUco dictionary of a ChArUco board, such as
            `DICT_5X5_100`; empty for a chessboard.
        marker: side of a ChArUco board's markers, metres.

    Raises:
        InputError: too few corners, a size that is not positive, an unknown dictionary, or a
            chessboard that is symmetric under half a turn.
    """

    columns: int = 0
    rows: int = 0
    square: float = 0.0
    dictionary: str = ""
    marker: float = 0.0

    def __post_init__(self) -> None:
        """Check that the board is detectable and its orientation unambiguous."""
        label = f"board {self.columns}x{self.rows}"
        if min(self.columns, self.rows) < _MIN_CORNERS:
            raise InputError(
                f"{label}: needs at least {_MIN_CORNERS} inner corners a side; count the "
                "corners where four squares meet, not the squares"
            )
        if not 0.0 < self.square < 1.0:
            raise InputError(f"{label}: squares of {self.square} m; give their side in metres")
        if self.dictionary:
            if not isinstance(getattr(cv2.aruco, self.dictionary, None), int):
                raise InputError(
                    f"{label}: no ArUco dictionary is called {self.dictionary!r}; OpenCV's names "
                    "are like DICT_5X5_100"
                )
            if not 0.0 < self.marker < self.square:
                raise InputError(
                    f"{label}: markers of {self.marker} m in squares of {self.square} m; markers "
                    "are smaller than squares"
                )
        elif (self.columns + self.rows) % 2 == 0:
            raise InputError(
                f"{label}: looks the same after half a turn, so its corners cannot be told apart; "
                "take one with an odd and an even number of corners, or a ChArUco board"
            )

    @property
    def points_T(self) -> NDArray[np.float64]:
        """Inner corners in the board's frame, row by row, (columns * rows, 3), metres."""
        x, y = np.meshgrid(np.arange(self.columns), np.arange(self.rows))
        places = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
        return np.asarray(self.square * places, dtype=float)

    def __str__(self) -> str:
        """Return the description for messages."""
        kind = f"ChArUco ({self.dictionary})" if self.dictionary else "chessboard"
        return f"{kind} of {self.columns}x{self.rows} inner corners"


@dataclass(frozen=True, eq=False)
class BoardView:
    """Corners of a calibration board detected in an image.

    Attributes:
        points_T: (n, 3) the corners in the board's frame, metres.
        corners: (n, 2) their positions in the image, pixels.
        ids: (n,) their numbers on the board.
        width, height: size of the image, pixels.
        name: of the image, for messages.
    """

    points_T: NDArray[np.float64]
    corners: NDArray[np.float64]
    ids: NDArray[np.intp]
    width: int
    height: int
    name: str = "image"

    def __post_init__(self) -> None:
        """Check and copy the arrays and make them read-only.

        Raises:
            InputError: the arrays' lengths differ or a corner is not finite.
        """
        for key, kind, columns in (("points_T", float, 3), ("corners", float, 2)):
            array = np.array(getattr(self, key), dtype=kind)
            if array.shape != (np.size(self.ids), columns) or not np.isfinite(array).all():
                raise InputError(
                    f"{self.name}: {key} {array.shape} must be finite and ({np.size(self.ids)}, "
                    f"{columns})"
                )
            array.setflags(write=False)
            object.__setattr__(self, key, array)
        ids = np.array(self.ids, dtype=np.intp)
        ids.setflags(write=False)
        object.__setattr__(self, "ids", ids)


@dataclass(frozen=True)
class NoBoard:
    """Why no usable board was detected in an image.

    Attributes:
        name: of the image.
        reason: what is wrong, and what to try.
    """

    name: str
    reason: str


def load_grey(path: str | Path) -> NDArray[np.uint8]:
    """Load an image file as grey levels (h, w) uint8, in the sensor's orientation.

    Raises:
        InputError: the file is missing or not an image.
    """
    path = Path(path)
    try:
        encoded = np.frombuffer(path.read_bytes(), dtype=np.uint8)
    except OSError:
        raise InputError(f"{path}: no such image; check the name or the folder") from None
    (image,) = decoded_images([encoded], grey=True)
    if image is None:
        raise InputError(f"{path}: is no image that can be read; give PNG, JPEG or TIFF")
    return image


def find_board(
    image: NDArray[np.uint8], board: Board, *, name: str = "image"
) -> BoardView | NoBoard:
    """Detect a board's corners with sub-pixel accuracy.

    The board is detected in a reduced image; its corners are refined in the full one by Foerstner's
    operator (OpenCV's `cornerSubPix`) in a window of about half a square.

    Args:
        image: (h, w) uint8.
        board: a chessboard must be fully visible, a ChArUco board partly.
        name: for messages.

    Raises:
        InputError: the array is not a grey image.
    """
    if image.ndim != 2 or image.dtype != np.uint8:
        raise InputError(f"{name}: image is {image.dtype} {image.shape}, wanted uint8 (h, w)")
    longest = max(image.shape)
    reason = f"no {board} in it; show all of it, sharp and well lit"
    for size in _SEARCH_SIZES_PX:
        scale = min(1.0, size / longest)
        small = image
        if scale < 1.0:
            wanted = (round(image.shape[1] * scale), round(image.shape[0] * scale))
            small = np.asarray(cv2.resize(image, wanted, interpolation=cv2.INTER_AREA))
        rough, ids = _charuco(small, board) if board.dictionary else _chessboard(small, board)
        if rough is not None:
            factor = np.array([image.shape[1] / small.shape[1], image.shape[0] / small.shape[0]])
            found = _refined(image, board, (rough + 0.5) * factor - 0.5, ids)
            if isinstance(found, str):
                reason = found
            else:
                height, width = image.shape
                return BoardView(board.points_T[ids], found, ids, width, height, name)
        if scale == 1.0:
            break
    return NoBoard(name, reason)


def _chessboard(
    image: NDArray[np.uint8], board: Board
) -> tuple[NDArray[np.float64] | None, NDArray[np.intp]]:
    """Return all corners of a chessboard in the board's order, or None."""
    ids = np.arange(board.columns * board.rows)
    size = (board.columns, board.rows)
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH + cv2.CALIB_CB_NORMALIZE_IMAGE
    found, corners = cv2.findChessboardCorners(image, size, flags=flags)
    if not found:  # slower, but more robust to blur and noise
        found, corners = cv2.findChessboardCornersSB(
            image, size, flags=cv2.CALIB_CB_NORMALIZE_IMAGE
        )
    if not found:
        return None, ids
    grid = np.asarray(corners, dtype=float).reshape(board.rows, board.columns, 2)
    across, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
    if across[0] * down[1] - across[1] * down[0] < 0.0:
        grid = grid[:, ::-1]  # boards are seen from the front only
    middles = 0.25 * (grid[:-1, :-1] + grid[1:, :-1] + grid[:-1, 1:] + grid[1:, 1:])
    shade = cv2.remap(image, middles.astype(np.float32), None, cv2.INTER_LINEAR).astype(float)
    rows, columns = np.indices(shade.shape)
    even = (rows + columns) % 2 == 0
    if shade[even].mean() > shade[~even].mean():
        grid = grid[::-1, ::-1]
    return grid.reshape(-1, 2), ids


def _charuco(
    image: NDArray[np.uint8], board: Board
) -> tuple[NDArray[np.float64] | None, NDArray[np.intp]]:
    """Return the detected corners of a ChArUco board and their numbers, or None.

    Boards drawn by OpenCV before 4.6, and by calib.io, begin with a marker instead of a dark square
    where they have an even number of rows of squares. That pattern is tried second; at the wrong
    one of the two, markers lie on dark squares and no corner is found.
    """
    least = max(6, _MIN_CORNER_FRACTION * board.columns * board.rows)
    for legacy in (False, True):
        detector = cv2.aruco.CharucoDetector(charuco_board(board, legacy=legacy))
        corners, ids, _, _ = detector.detectBoard(image)
        if ids is not None and len(ids) >= least:
            break
    else:
        return None, np.zeros(0, dtype=np.intp)
    numbers = np.asarray(ids, dtype=np.intp).ravel()
    x, y = numbers % board.columns, numbers // board.columns
    if np.ptp(x) == 0 or np.ptp(y) == 0:  # collinear corners determine no pose
        return None, np.zeros(0, dtype=np.intp)
    return np.asarray(corners, dtype=float).reshape(-1, 2), numbers


def board_pose(view: BoardView, camera: Camera) -> Pose:
    """Estimate X_CT (4, 4), the board in the camera's frame, by least reprojection error.

    Raises:
        InputError: the corners determine no pose.
    """
    distortion = np.array(camera.distortion) if camera.distortion else None
    found, turn, p = cv2.solvePnP(
        view.points_T, view.corners, camera.matrix, distortion, flags=cv2.SOLVEPNP_IPPE
    )
    if not found or not np.isfinite(p).all() or float(p[2, 0]) <= 0.0:
        raise InputError(f"{view.name}: its corners give no pose of the board; is it in full view?")
    turn, p = cv2.solvePnPRefineLM(view.points_T, view.corners, camera.matrix, distortion, turn, p)
    return pose(Rotation.from_rotvec(np.ravel(turn)).as_matrix(), np.ravel(p))


def charuco_board(board: Board, *, legacy: bool = False) -> Any:
    """Return OpenCV's `CharucoBoard`, which detects and draws the board.

    Args:
        board: a ChArUco board.
        legacy: the pattern of OpenCV before 4.6.
    """
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
    size = (board.columns + 1, board.rows + 1)
    drawn = cv2.aruco.CharucoBoard(size, board.square, board.marker, dictionary)
    drawn.setLegacyPattern(legacy)
    return drawn


def _refined(
    image: NDArray[np.uint8], board: Board, rough: NDArray[np.float64], ids: NDArray[np.intp]
) -> NDArray[np.float64] | str:
    """Return the corners refined to sub-pixels, or the reason why they are unusable."""
    base = board.points_T[ids][:, :2]
    homography, _ = cv2.findHomography(base, rough, cv2.LMEDS)
    if homography is None:
        return "the corners found lie on one line; turn the board towards the camera"
    homography = np.asarray(homography)
    side, height = _square_in_image(homography, board, ids)
    # The detection is sometimes off by half a square at a corner or two.
    plane = _mapped(homography, base)
    off = np.linalg.norm(plane - rough, axis=1) > _MAX_SHIFT_FRACTION * side
    if off.mean() > _MAX_OUTLIER_FRACTION:
        return f"{off.mean():.0%} of the corners found do not lie on a flat board; is it bent?"
    rough = np.where(off[:, None], plane, rough)
    clear = _WINDOW_FRACTION
    if board.dictionary:  # distance to the nearest marker
        clear = min(clear, 0.5 * (1.0 - board.marker / board.square))
    half = int(np.clip(np.floor(clear * height), _MIN_WINDOW_PX, _MAX_WINDOW_PX))
    margin = half + 2
    inside = (rough >= margin) & (rough <= np.array(image.shape)[::-1] - 1 - margin)
    if not inside.all():
        return "a corner lies at the image's border; show all of the board"
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-4)
    # Smooth against noise in the gradients: this removes two thirds of the error.
    first = np.maximum(np.floor(rough.min(axis=0)).astype(int) - 2 * margin, 0)
    last = np.ceil(rough.max(axis=0)).astype(int) + 2 * margin
    part = image[first[1] : last[1] + 1, first[0] : last[0] + 1].astype(np.float32)
    smooth = cv2.GaussianBlur(part, (0, 0), _SMOOTHING_FRACTION * half)
    start = (rough - first).astype(np.float32).reshape(-1, 1, 2)
    found = cv2.cornerSubPix(smooth, start, (half, half), (-1, -1), criteria)
    corners = np.asarray(found, dtype=float).reshape(-1, 2) + first
    moved = float(np.max(np.linalg.norm(corners - rough, axis=1)))
    if moved > _MAX_SHIFT_FRACTION * side:
        return (
            f"a corner moved by {moved:.1f} px in the refinement, more than "
            f"{_MAX_SHIFT_FRACTION:.0%} of a square of {side:.0f} px; is the image sharp?"
        )
    return corners


def _square_in_image(
    homography: NDArray[np.float64], board: Board, ids: NDArray[np.intp]
) -> tuple[float, float]:
    """Return the least side and the least height, pixels, of the squares at the corners."""
    base = board.points_T[ids][:, :2]
    a, b = np.array([board.square, 0.0]), np.array([0.0, board.square])

    u = 0.5 * (_mapped(homography, base + a) - _mapped(homography, base - a))
    v = 0.5 * (_mapped(homography, base + b) - _mapped(homography, base - b))
    area = np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
    longest = np.maximum(np.linalg.norm(u, axis=1), np.linalg.norm(v, axis=1))
    shortest = np.minimum(np.linalg.norm(u, axis=1), np.linalg.norm(v, axis=1))
    return float(shortest.min()), float((area / longest).min())


def _mapped(homography: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    seen = np.column_stack([points, np.ones(len(points))]) @ homography.T
    return np.asarray(seen[:, :2] / seen[:, 2:])
