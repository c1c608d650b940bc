"""Calibration of a gripper camera (gripper-to-camera pose) from views of a fixed board."""

import datetime
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.arrays import Pose
from unwrinkle.perception.calibration.boards import BoardView, board_pose
from unwrinkle.perception.calibration.bundle_adjustment import adjust
from unwrinkle.perception.calibration.checks import (
    check_rejected,
    check_residual,
    worst_outlier,
)
from unwrinkle.perception.calibration.hand_eye import HandEye, outlying, solve_hand_eye
from unwrinkle.perception.calibration.rig import BoardObservation, Rig
from unwrinkle.perception.calibration.stereo import calibrate_camera
from unwrinkle.perception.camera import Camera


@dataclass(frozen=True, eq=False)
class GripperFit:
    """Outcome of a gripper-to-camera calibration.

    Attributes:
        camera: intrinsics.
        X_GC: (4, 4) pose of the camera in the gripper's frame.
        X_WT: (4, 4) pose of the board in the world.
        rms: reprojection error, pixels.
        hand_eye: closed-form solution before the bundle adjustment.
        views: the views used.
        residuals: seen minus predicted corners (n, 2) of each view, pixels.
        rejected: rejected views, with the reason.
        date: of the calibration, YYYY-MM-DD.
    """

    camera: Camera
    X_GC: Pose
    X_WT: Pose
    rms: float
    hand_eye: HandEye
    views: tuple[BoardView, ...]
    residuals: tuple[NDArray[np.float64], ...]
    rejected: tuple[str, ...]
    date: str


def calibrate_gripper_camera(
    X_WG: Sequence[Pose],
    views: Sequence[BoardView],
    camera: Camera | None = None,
    *,
    date: datetime.date | None = None,
) -> GripperFit:
    """Estimate the camera in the gripper's frame: Tsai-Lenz, then bundle adjustment.

    Args:
        X_WG: poses (4, 4) of the gripper in the world, one for each view.
        views: the board in each image.
        camera: intrinsics, which are held; None estimates them from the same views.
        date: of the calibration; None for today.

    Raises:
        InputError: fewer than 8 views, too little rotation about a second axis, methods that
            disagree, too many rejected views, or a residual above 1 px.
    """
    free = camera is None
    if camera is None:
        camera = calibrate_camera(list(views), "gripper")
    name = "gripper calibration"
    poses, kept = list(X_WG), list(views)
    X_CT = [board_pose(view, camera) for view in kept]
    rejected = []
    if len(poses) == len(kept) >= 3:
        odd = outlying(poses, X_CT)
        rejected = [
            f"{view.name}: the board turned by another angle than the gripper's pose says"
            for view, bad in zip(kept, odd, strict=True)
            if bad
        ]
        good = np.flatnonzero(~odd)
        poses, kept = [poses[k] for k in good], [kept[k] for k in good]
        X_CT = [X_CT[k] for k in good]
    while True:
        solution = solve_hand_eye(poses, X_CT, name=name)
        rig = Rig((camera,), (solution.X_MC,), (np.eye(4),), (solution.X_BT,))
        shots = [BoardObservation(view, 0, 0, 0, X) for X, view in zip(poses, kept, strict=True)]
        fit = adjust(rig, shots, intrinsics=free)
        worst = worst_outlier(fit.shot_rms)
        if worst is None:
            break
        rejected.append(
            f"{kept[worst].name}: fits to {fit.shot_rms[worst]:.2f} px only, the others to "
            f"{np.median(fit.shot_rms):.2f} px"
        )
        del poses[worst], kept[worst], X_CT[worst]
    check_rejected(len(kept), rejected)
    check_residual(fit.rms, name)
    return GripperFit(
        camera=fit.rig.cameras[0],
        X_GC=fit.rig.mounts[0],
        X_WT=fit.rig.boards[0],
        rms=fit.rms,
        hand_eye=solution,
        views=tuple(kept),
        residuals=fit.residuals,
        rejected=tuple(rejected),
        date=(date or datetime.date.today()).isoformat(),
    )
