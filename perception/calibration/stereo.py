"""Calibration of a stereo pair: intrinsics and relative pose from views of a board (stage 0).

Each camera is calibrated separately (Zhang's method, OpenCV), then both together with one relative
pose by bundle adjustment. The lens model is k1, k2; tangential terms and k3 are zero.
"""

import dataclasses
import datetime
import logging
from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.arrays import Pose
from unwrinkle.models.errors import InputError
from unwrinkle.models.transforms import PoseRecord, inverse
from unwrinkle.perception.calibration.boards import Board, BoardView, board_pose
from unwrinkle.perception.calibration.bundle_adjustment import Adjustment, adjust
from unwrinkle.perception.calibration.checks import (
    check_count,
    check_focal,
    check_rejected,
    check_residual,
    check_sizes,
    check_tilts,
    worst_outlier,
)
from unwrinkle.perception.calibration.hand_eye import angle_between
from unwrinkle.perception.calibration.rig import BoardObservation, Rig
from unwrinkle.perception.camera import Camera

#: Largest rotation of a pair's relative pose from the central one, radians.
_MAX_PAIR_TURN_RAD = np.radians(2.0)

#: Largest shift of a pair's relative pose from the central one, fraction of the baseline.
_MAX_PAIR_SHIFT = 0.1

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class PairView:
    """Calibration board observed by both cameras simultaneously."""

    name: str
    left: BoardView
    right: BoardView


@dataclass(frozen=True)
class PairRecord:
    """One pair of views in a stereo calibration file.

    Attributes:
        name: of the pair.
        left_rms, right_rms: RMS reprojection error, pixels.
        left_ids, right_ids: numbers of the corners on the board; empty for all of them.
        left, right: corners [u, v] in the images, pixels.
    """

    name: str = ""
    left_rms: float = 0.0
    right_rms: float = 0.0
    left_ids: list[int] = field(default_factory=list)
    right_ids: list[int] = field(default_factory=list)
    left: list[list[float]] = field(default_factory=list)
    right: list[list[float]] = field(default_factory=list)


@dataclass(frozen=True)
class StereoCalibration:
    """Calibration of a stereo pair, as stored in its file.

    Attributes:
        date: YYYY-MM-DD.
        left, right: the cameras.
        relative: X_LR, the right camera in the left one's frame while these views were taken.
        rms: reprojection error of all corners, pixels.
        row_error: RMS row error of matching corners after rectification, pixels.
        focal_sigma: standard deviation of the focal lengths, left and right, pixels.
        board: the calibration board.
        views: the pairs used.
        rejected: rejected pairs, with the reason.
    """

    date: str = ""
    left: Camera = field(default_factory=Camera)
    right: Camera = field(default_factory=Camera)
    relative: PoseRecord = field(default_factory=PoseRecord)
    rms: float = 0.0
    row_error: float = 0.0
    focal_sigma: list[float] = field(default_factory=list)
    board: Board = field(default_factory=Board)
    views: list[PairRecord] = field(default_factory=list)
    rejected: list[str] = field(default_factory=list)

    def pair_views(self) -> list[PairView]:
        """Return the views used.

        Raises:
            InputError: corners and ids do not match.
        """

        def view(
            camera: Camera, name: str, ids: list[int], corners: list[list[float]]
        ) -> BoardView:
            every = self.board.points_T
            numbers = np.array(ids or range(len(every)), dtype=np.intp)
            if numbers.size and not 0 <= numbers.min() <= numbers.max() < len(every):
                raise InputError(f"{name}: corner ids do not fit a {self.board}")
            points = every[numbers]
            return BoardView(points, np.array(corners), numbers, camera.width, camera.height, name)

        return [
            PairView(
                pair.name,
                view(self.left, f"{pair.name}, left", pair.left_ids, pair.left),
                view(self.right, f"{pair.name}, right", pair.right_ids, pair.right),
            )
            for pair in self.views
        ]


@dataclass(frozen=True, eq=False)
class StereoFit:
    """Stereo calibration with the details that its file does not store.

    Attributes:
        calibration: the record to store.
        residuals: seen minus predicted corners (n, 2) of each view, alternating left and right,
            pixels.
        corners: (n, 2) seen corners of each view, likewise.
    """

    calibration: StereoCalibration
    residuals: tuple[NDArray[np.float64], ...]
    corners: tuple[NDArray[np.float64], ...]


def calibrate_stereo(
    pairs: list[PairView],
    board: Board,
    *,
    not_found: Sequence[str] = (),
    date: datetime.date | None = None,
) -> StereoFit:
    """Estimate the intrinsics of both cameras and their relative pose.

    Args:
        pairs: at least 8 views, each with another tilt and place of the board.
        board: the calibration board.
        not_found: pairs without a board, with the reason, for the record.
        date: of the calibration; None for today.

    Raises:
        InputError: too few views, images of different sizes, too many rejected views, a residual
            above 1 px, or a poorly determined focal length.
    """
    rejected: list[str] = []
    check_sizes([pair.left for pair in pairs], "left")
    check_sizes([pair.right for pair in pairs], "right")
    while True:
        check_count(len(pairs), [*not_found, *rejected])
        left = _single_camera([pair.left for pair in pairs], "left")
        right = _single_camera([pair.right for pair in pairs], "right")
        X_LR = [_relative(pair, left, right) for pair in pairs]
        middle = X_LR[_most_central(X_LR)]
        strange = [_apart(X, middle) for X in X_LR]
        if not any(strange):
            break
        rejected += [
            f"{pair.name}: its images do not belong together (the cameras would stand otherwise "
            "than in the other pairs)"
            for pair, odd in zip(pairs, strange, strict=True)
            if odd
        ]
        pairs = [pair for pair, odd in zip(pairs, strange, strict=True) if not odd]
    rig = Rig((left, right), (np.eye(4),) * 2, (np.eye(4), middle), ())
    while True:
        check_count(len(pairs), [*not_found, *rejected])
        fit = _adjust_pairs(rig, pairs)
        worst = worst_outlier(fit.shot_rms)
        if worst is None:
            break
        name, rms = pairs[worst // 2].name, fit.shot_rms[worst]
        rejected.append(
            f"{name}: {('left', 'right')[worst % 2]} view fits to {rms:.2f} px only, the others "
            f"to {np.median(fit.shot_rms):.2f} px"
        )
        _log.info("rejected %s", rejected[-1])
        pairs = [pair for pair in pairs if pair.name != name]
    check_rejected(len(pairs), rejected)
    check_residual(fit.rms, "stereo calibration")
    left, right = fit.rig.cameras
    for camera, sigma in zip((left, right), fit.camera_sigma, strict=True):
        check_focal(camera.name, float(sigma[0] / camera.fx))
    if (aside := float(fit.rig.bases[1][0, 3])) < 0.0:
        _log.warning(
            "the right camera stands %.3f m to the left of the left one: are they swapped?", -aside
        )
    records = [
        _record(pair, board, fit.shot_rms[2 * k], fit.shot_rms[2 * k + 1])
        for k, pair in enumerate(pairs)
    ]
    calibration = StereoCalibration(
        date=(date or datetime.date.today()).isoformat(),
        left=left,
        right=right,
        relative=PoseRecord.of(fit.rig.bases[1]),
        rms=fit.rms,
        row_error=row_error(pairs, left, right, fit.rig.bases[1]),
        focal_sigma=[float(sigma[:2].max()) for sigma in fit.camera_sigma],
        board=board,
        views=records,
        rejected=[*not_found, *rejected],
    )
    corners = tuple(view.corners for pair in pairs for view in (pair.left, pair.right))
    return StereoFit(calibration, fit.residuals, corners)


def calibrate_camera(views: list[BoardView], name: str) -> Camera:
    """Estimate the intrinsics of one camera, with k1 and k2, by Zhang's method and adjustment.

    Raises:
        InputError: fewer than 8 views, images of different sizes, a residual above 1 px, or a
            poorly determined focal length.
    """
    check_sizes(views, name)
    check_count(len(views), [])
    camera = _single_camera(views, name)
    boards = tuple(board_pose(view, camera) for view in views)
    shots = [BoardObservation(view, 0, 0, k, np.eye(4)) for k, view in enumerate(views)]
    fit = adjust(Rig((camera,), (np.eye(4),), (np.eye(4),), boards), shots, mounts=False)
    check_residual(fit.rms, f"{name} camera")
    check_focal(name, float(fit.camera_sigma[0, 0] / camera.fx))
    return fit.rig.cameras[0]


def row_error(pairs: list[PairView], left: Camera, right: Camera, X_LR: Pose) -> float:
    """Return the RMS row error of matching corners after rectification, pixels."""
    X_RL = inverse(X_LR)
    D = [np.array(camera.distortion) for camera in (left, right)]
    size = (left.width, left.height)
    R_1, R_2, P_1, P_2, *_ = cv2.stereoRectify(
        left.matrix, D[0], right.matrix, D[1], size, X_RL[:3, :3], X_RL[:3, 3:]
    )
    differences = []
    for pair in pairs:
        _, a, b = np.intersect1d(pair.left.ids, pair.right.ids, return_indices=True)
        rows = []
        for corners, camera, k, R, P in (
            (pair.left.corners[a], left, D[0], R_1, P_1),
            (pair.right.corners[b], right, D[1], R_2, P_2),
        ):
            rectified = cv2.undistortPoints(corners[:, None], camera.matrix, k, R=R, P=P)
            # Cameras above each other are rectified along columns instead of rows.
            axis = 1 if abs(X_LR[0, 3]) >= abs(X_LR[1, 3]) else 0
            rows.append(np.asarray(rectified)[:, 0, axis])
        differences.append(rows[0] - rows[1])
    return float(np.sqrt(np.mean(np.concatenate(differences) ** 2)))


def _single_camera(views: list[BoardView], name: str) -> Camera:
    size = (views[0].width, views[0].height)
    flags = cv2.CALIB_ZERO_TANGENT_DIST + cv2.CALIB_FIX_K3
    try:
        _, K, D, turns, _ = cv2.calibrateCamera(
            [view.points_T.astype(np.float32) for view in views],
            [view.corners.astype(np.float32) for view in views],
            size,
            None,
            None,
            flags=flags,
        )
    except cv2.error as error:
        raise InputError(f"{name} camera: its views give no intrinsics ({error.err})") from None
    check_tilts(np.reshape(turns, (-1, 3)), name)
    return Camera(
        name=name,
        width=views[0].width,
        height=views[0].height,
        fx=float(K[0, 0]),
        fy=float(K[1, 1]),
        cx=float(K[0, 2]),
        cy=float(K[1, 2]),
        distortion=np.ravel(D)[:5].tolist(),
        sensor="stereo",
    )


def _relative(pair: PairView, left: Camera, right: Camera) -> Pose:
    return np.asarray(board_pose(pair.left, left) @ inverse(board_pose(pair.right, right)))


def _most_central(poses: list[Pose]) -> int:
    """Return the index of the pose with the least median angle to the others."""
    angles = [[angle_between(X, Y) for Y in poses] for X in poses]
    return int(np.argmin(np.median(angles, axis=1)))


def _apart(X: Pose, middle: Pose) -> bool:
    shift = float(np.linalg.norm(X[:3, 3] - middle[:3, 3]))
    baseline = float(np.linalg.norm(middle[:3, 3]))
    return angle_between(X, middle) > _MAX_PAIR_TURN_RAD or shift > _MAX_PAIR_SHIFT * baseline


def _adjust_pairs(rig: Rig, pairs: list[PairView]) -> Adjustment:
    boards = tuple(board_pose(pair.left, rig.cameras[0]) for pair in pairs)
    shots = [
        BoardObservation(view, eye, eye, k, np.eye(4))
        for k, pair in enumerate(pairs)
        for eye, view in enumerate((pair.left, pair.right))
    ]
    return adjust(dataclasses.replace(rig, boards=boards), shots, mounts=False)


def _record(pair: PairView, board: Board, left_rms: float, right_rms: float) -> PairRecord:
    whole = board.columns * board.rows

    def ids(view: BoardView) -> list[int]:
        return [] if len(view.ids) == whole else [int(number) for number in view.ids]

    return PairRecord(
        pair.name,
        float(left_rms),
        float(right_rms),
        ids(pair.left),
        ids(pair.right),
        np.round(pair.left.corners, 4).tolist(),
        np.round(pair.right.corners, 4).tolist(),
    )
