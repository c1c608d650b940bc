"""Hand-eye calibration of the stereo head: camera mounts and relative pose of the pan-tilt units.

The head observes a fixed board from many gazes. For each eye, hand-eye calibration gives the camera
on its mount (Tsai-Lenz, cross-checked). Then a bundle adjustment over both cameras' intrinsics,
both mounts, the right unit's base in the left one's frame, and all board poses minimises the
reprojection error, with the units' kinematics given. The views of the stereo calibration are
included.
"""

import dataclasses
import datetime
import logging
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.arrays import Pose
from unwrinkle.models.errors import InputError
from unwrinkle.models.transforms import inverse
from unwrinkle.perception.calibration.boards import BoardView, board_pose
from unwrinkle.perception.calibration.bundle_adjustment import Adjustment, adjust
from unwrinkle.perception.calibration.checks import (
    check_rejected,
    check_residual,
    listed,
    worst_outlier,
)
from unwrinkle.perception.calibration.hand_eye import (
    LEAST_TURN,
    MIN_VIEWS,
    HandEye,
    mean_pose,
    outlying,
    solve_hand_eye,
)
from unwrinkle.perception.calibration.rig import BoardObservation, Rig, joint_axes
from unwrinkle.perception.calibration.stereo import PairView, StereoCalibration, row_error
from unwrinkle.perception.camera import Camera
from unwrinkle.perception.stereo.head import Gaze, PanTiltUnit
from unwrinkle.perception.stereo.head_file import VALID_DAYS, HeadCalibration

#: Largest motion of the turn-table between views, radians.
_MAX_TURNTABLE_MOTION_RAD = 1e-4

#: Joint error of an outlying view, multiples of the median view's.
_OUTLIER_JOINT_RATIO = 9.0

#: Least joint error of an outlying view, radians.
_MIN_OUTLIER_JOINT_RAD = 2e-4

_EYES = ("left", "right")

#: Largest standard deviation of a mount, radians and metres.
_MAX_MOUNT_SIGMA_RAD = np.radians(0.05)
_MAX_MOUNT_SIGMA_M = 0.002

_log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class HeadView:
    """Calibration board observed at known head angles.

    Attributes:
        name: for messages.
        gaze: the head angles.
        left, right: the board in the images; None if not detected.
        place: label of the board's place; it may be moved between groups of views.
    """

    name: str
    gaze: Gaze
    left: BoardView | None
    right: BoardView | None
    place: str = ""

    def view(self, eye: int) -> BoardView | None:
        """Return the board in the image of eye 0 (left) or 1 (right), or None."""
        return (self.left, self.right)[eye]


@dataclass(frozen=True, eq=False)
class HeadFit:
    """Head calibration with the details that its file does not store.

    Attributes:
        calibration: the record to store.
        adjustment: the bundle adjustment.
        hand_eyes: hand-eye solutions of the left and the right eye before it.
        rejected: rejected views, with the reason.
        names: names of the observations' views, in the order of the adjustment's residuals.
        eyes: eye of each observation, 0 left, 1 right.
        corners: (n, 2) corners of each observation, pixels.
    """

    calibration: HeadCalibration
    adjustment: Adjustment
    hand_eyes: tuple[HandEye, HandEye]
    rejected: tuple[str, ...]
    names: tuple[str, ...]
    eyes: tuple[int, ...]
    corners: tuple[NDArray[np.float64], ...]


def calibrate_head(
    looks: list[HeadView],
    stereo: StereoCalibration,
    nominal: HeadCalibration,
    *,
    joint_noise: float | None = None,
    date: datetime.date | None = None,
) -> HeadFit:
    """Estimate the cameras on their mounts and the right unit's base relative to the left one.

    Args:
        looks: at least 8 head views for each eye, at several pan and tilt angles.
        stereo: calibration of the same two cameras.
        nominal: gives the head's name, its units' kinematics, and the pose of the left unit, which
            views of a board cannot determine.
        joint_noise: standard deviation of the units' angles (repeatability), radians; 0 for exact
            angles, None estimates it from the views.
        date: of the calibration; None for today.

    Raises:
        InputError: too few views, too little rotation about an axis, methods that disagree, too
            many rejected views, a residual above 1 px, or mounts that are poorly determined.
    """
    head = nominal.stereo_head()
    units = (head.left.unit, head.right.unit)
    for look in looks:
        for eye, unit in enumerate(units):
            unit.check(*_angles(look.gaze, eye), f"{look.name}, {_EYES[eye]} eye")
    turntable = [look.gaze.ext_axis for look in looks]
    if looks and np.ptp(turntable) > _MAX_TURNTABLE_MOTION_RAD:
        raise InputError(
            f"hand-eye calibration: the turn-table stands at {min(turntable):.4f} to "
            f"{max(turntable):.4f} rad; keep it still, for the head turns with it"
        )
    rejected: list[str] = []
    cameras = (stereo.left, stereo.right)
    eyes = tuple(_one_eye(looks, eye, cameras[eye], units[eye], rejected) for eye in (0, 1))
    shots, rig = _problem(eyes, cameras, stereo)
    while True:
        fit = adjust(rig, [shot for _, shot in shots], joint_noise=joint_noise)
        ours = np.array([look is not None for look, _ in shots])
        worst, reason = _worst(fit, ours)
        if worst is None:
            break
        name, shot = shots[worst]
        rejected.append(f"{name}: {_EYES[shot.eye]} view {reason}")
        _log.info("rejected %s", rejected[-1])
        shots = [pair for k, pair in enumerate(shots) if k != worst]
        for eye in (0, 1):
            _check_count(sum(s.eye == eye and look is not None for look, s in shots), eye, rejected)
    count = sum(look is not None for look, _ in shots)
    check_rejected(count, rejected)
    check_residual(fit.rms, "hand-eye calibration")
    _check_mounts(fit)
    _check_sides(fit.rig.bases[1], inverse(head.left.X_RB) @ head.right.X_RB)
    calibration = _calibration(nominal, fit, shots, stereo, date)
    return HeadFit(
        calibration=calibration,
        adjustment=fit,
        hand_eyes=(eyes[0].solution, eyes[1].solution),
        rejected=tuple(rejected),
        names=tuple(look or _pair_name(shot) for look, shot in shots),
        eyes=tuple(shot.eye for _, shot in shots),
        corners=tuple(shot.view.corners for _, shot in shots),
    )


@dataclass(frozen=True, eq=False)
class _Eye:
    """Usable views of one eye, with poses of mount and board, and its hand-eye solution."""

    looks: list[HeadView]
    X_BM: list[Pose]
    X_CT: list[Pose]
    axes: list[NDArray[np.float64]]
    numbers: list[int]
    solution: HandEye


def _one_eye(
    looks: list[HeadView], eye: int, camera: Camera, unit: PanTiltUnit, rejected: list[str]
) -> _Eye:
    name = f"hand-eye calibration, {_EYES[eye]} eye"
    numbers = [k for k, look in enumerate(looks) if look.view(eye) is not None]
    views = [view for look in looks if (view := look.view(eye)) is not None]
    for view in views:
        if (view.width, view.height) != (camera.width, camera.height):
            raise InputError(
                f"{view.name}: {view.width} x {view.height} pixels, the stereo calibration is for "
                f"{camera.width} x {camera.height}; use images of one size"
            )
    _check_count(len(views), eye, rejected)
    angles = np.array([_angles(looks[k].gaze, eye) for k in numbers])
    _check_angles(angles, name)
    X_BM = [unit.mount_pose(pan, tilt) for pan, tilt in angles]
    X_CT = [board_pose(view, camera) for view in views]
    places = [looks[k].place for k in numbers]
    main = max(sorted(set(places)), key=places.count)
    fixed = np.array([place == main for place in places])
    odd = np.zeros(len(views), dtype=bool)
    if fixed.sum() >= 3:
        odd[fixed] = outlying(_chosen(X_BM, fixed), _chosen(X_CT, fixed))
    for k in np.flatnonzero(odd):
        rejected.append(
            f"{looks[numbers[k]].name}: {_EYES[eye]} view turned by another angle than pan and "
            "tilt say"
        )
    good, together = ~odd, fixed & ~odd
    _check_count(int(together.sum()), eye, rejected)
    _check_angles(angles[together], name)
    solution = solve_hand_eye(_chosen(X_BM, together), _chosen(X_CT, together), name=name)
    kept = [int(k) for k in np.flatnonzero(good)]
    return _Eye(
        [looks[numbers[k]] for k in kept],
        [X_BM[k] for k in kept],
        [X_CT[k] for k in kept],
        [joint_axes(unit.mount_pose, *angles[k]) for k in kept],
        [numbers[k] for k in kept],
        solution,
    )


def _worst(fit: Adjustment, ours: NDArray[np.bool_]) -> tuple[int | None, str]:
    """Return the index of the worst outlying head view's observation and the reason, or None."""
    numbers = np.flatnonzero(ours)
    joints = np.abs(fit.joint_errors).max(axis=1)[numbers]
    usual = float(np.median(joints))
    worst = int(np.argmax(joints))
    if joints[worst] > max(_MIN_OUTLIER_JOINT_RAD, _OUTLIER_JOINT_RATIO * usual):
        found = np.degrees([joints[worst], usual])
        reason = f"has angles off by {found[0]:.3f} degrees, the others by {found[1]:.4f}"
        return int(numbers[worst]), reason
    rms = fit.shot_rms[numbers]
    index = worst_outlier(rms)
    if index is None:
        return None, ""
    reason = f"fits to {rms[index]:.2f} px only, the others to {np.median(rms):.2f} px"
    return int(numbers[index]), reason


def _problem(
    eyes: tuple[_Eye, ...], cameras: tuple[Camera, Camera], stereo: StereoCalibration
) -> tuple[list[tuple[str | None, BoardObservation]], Rig]:
    """Build the observations, with the names of their head views, and the initial rig.

    The name is None for views of the stereo calibration. Bases: the left unit, the right unit, and
    a substitute for the unknown gaze of the right camera in the stereo calibration's views.
    """
    mounts = tuple(eye.solution.X_MC for eye in eyes)
    seen = [
        {
            place: mean_pose(
                [
                    M @ mounts[k] @ T
                    for look, M, T in zip(eye.looks, eye.X_BM, eye.X_CT, strict=True)
                    if look.place == place
                ]
            )
            for place in {look.place for look in eye.looks}
        }
        for k, eye in enumerate(eyes)
    ]
    common = sorted(set(seen[0]) & set(seen[1]))
    if not common:
        raise InputError(
            "hand-eye calibration: no place of the board was seen by both eyes; show it to both"
        )
    right_base = mean_pose([seen[0][place] @ inverse(seen[1][place]) for place in common])
    places = sorted(set(seen[0]) | set(seen[1]))
    boards = [seen[0][p] if p in seen[0] else right_base @ seen[1][p] for p in places]
    shots: list[tuple[str | None, BoardObservation]] = []
    for k, eye in enumerate(eyes):
        for look, X_BM, axes, stop in zip(eye.looks, eye.X_BM, eye.axes, eye.numbers, strict=True):
            view = look.view(k)
            if view is not None:
                shot = BoardObservation(view, k, k, places.index(look.place), X_BM, axes, stop)
                shots.append((look.name, shot))
    pairs = stereo.pair_views()
    bases = [np.eye(4), right_base]
    if pairs:
        X_LR = stereo.relative.matrix("stereo calibration: relative")
        bases.append(mounts[0] @ X_LR @ inverse(mounts[1]))
    for pair in pairs:
        boards.append(mounts[0] @ board_pose(pair.left, cameras[0]))
        for k, view in enumerate((pair.left, pair.right)):
            shots.append((None, BoardObservation(view, k, 2 * k, len(boards) - 1, np.eye(4))))
    return shots, Rig(cameras, mounts, tuple(bases), tuple(boards))


def _calibration(
    nominal: HeadCalibration,
    fit: Adjustment,
    shots: list[tuple[str | None, BoardObservation]],
    stereo: StereoCalibration,
    date: datetime.date | None,
) -> HeadCalibration:
    head = nominal.stereo_head()
    changed = dataclasses.replace(
        head,
        left=dataclasses.replace(head.left, camera=fit.rig.cameras[0], X_MC=fit.rig.mounts[0]),
        right=dataclasses.replace(
            head.right,
            camera=fit.rig.cameras[1],
            X_MC=fit.rig.mounts[1],
            X_RB=head.left.X_RB @ fit.rig.bases[1],
        ),
    )
    calibration = nominal.with_head(changed)
    records = {}
    for eye, (name, record) in enumerate(
        zip(_EYES, (calibration.left, calibration.right), strict=True)
    ):
        rms = [r for (_, s), r in zip(shots, fit.shot_rms, strict=True) if s.eye == eye]
        residual = float(np.sqrt(np.mean(np.square(rms))))
        records[name] = dataclasses.replace(record, residual=residual, views=len(rms))
    looks = len({look for look, _ in shots if look is not None})
    return dataclasses.replace(
        calibration,
        left=records["left"],
        right=records["right"],
        date=(date or datetime.date.today()).isoformat(),
        valid_days=VALID_DAYS,
        source=f"{looks} looks at a fixed board and {len(stereo.views)} stereo views",
        row_residual=_row_residual(fit, shots),
    )


def _row_residual(fit: Adjustment, shots: list[tuple[str | None, BoardObservation]]) -> float:
    """Return the RMS row error, pixels, of the head views, each rectified by its head angles."""
    by_stop: dict[int, dict[int, BoardObservation]] = {}
    for look, shot in shots:
        if look is not None:
            by_stop.setdefault(shot.stop, {})[shot.eye] = shot
    rig, errors = fit.rig, []
    for pair in by_stop.values():
        if len(pair) == 2:
            X_AL, X_AR = (rig.bases[eye] @ pair[eye].X_BM @ rig.mounts[eye] for eye in (0, 1))
            views = PairView(pair[0].view.name, pair[0].view, pair[1].view)
            left, right = rig.cameras
            errors.append(row_error([views], left, right, inverse(X_AL) @ X_AR))
    return float(np.sqrt(np.mean(np.square(errors)))) if errors else 0.0


def _check_count(count: int, eye: int, rejected: list[str]) -> None:
    if count < MIN_VIEWS:
        raise InputError(
            f"hand-eye calibration: {count} usable looks of the {_EYES[eye]} eye at one board, "
            f"wanted at least {MIN_VIEWS}{listed(rejected)}; take more"
        )


def _check_angles(angles: NDArray[np.float64], name: str) -> None:
    """Check that both pan and tilt vary enough.

    Raises:
        InputError: an axis varies too little; the message names it.
    """
    for axis, values in zip(("pan", "tilt"), angles.T, strict=True):
        spread = float(np.ptp(values))
        if spread < LEAST_TURN:
            raise InputError(
                f"{name}: {axis} varies by only {np.degrees(spread):.1f} degrees, wanted at least "
                f"{np.degrees(LEAST_TURN):.0f}; add looks with other {axis} angles"
            )


def _check_mounts(fit: Adjustment) -> None:
    for eye, sigma in enumerate(fit.mount_sigma):
        shift, turn = float(sigma[:3].max()), float(sigma[3:].max())
        if turn > _MAX_MOUNT_SIGMA_RAD or shift > _MAX_MOUNT_SIGMA_M:
            raise InputError(
                f"hand-eye calibration: the looks leave the {_EYES[eye]} camera's place on its "
                f"mount open by {np.degrees(turn):.3f} degrees and {1e3 * shift:.2f} mm, wanted "
                f"{np.degrees(_MAX_MOUNT_SIGMA_RAD):.2f} and {1e3 * _MAX_MOUNT_SIGMA_M:.0f}; take "
                "more looks, turned further"
            )


def _check_sides(found: Pose, nominal: Pose) -> None:
    if float(found[:3, 3] @ nominal[:3, 3]) < 0.0:
        raise InputError(
            "hand-eye calibration: the right unit comes out on the other side of the left one; "
            "are the left and right images, or the angles, swapped?"
        )


def _angles(gaze: Gaze, eye: int) -> tuple[float, float]:
    return (gaze.left, gaze.right)[eye]


def _pair_name(shot: BoardObservation) -> str:
    return "stereo " + shot.view.name.rpartition(",")[0]


def _chosen(poses: list[Pose], which: NDArray[np.bool_]) -> list[Pose]:
    return [X for X, chosen in zip(poses, which, strict=True) if chosen]
