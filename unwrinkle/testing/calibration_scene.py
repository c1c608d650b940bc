"""A head that is not quite the nominal one, which a calibration must find, and boards before it."""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from unwrinkle.models.arrays import Pose
from unwrinkle.models.transforms import inverse, pose, transformed
from unwrinkle.perception.calibration.boards import Board, BoardView, NoBoard, find_board
from unwrinkle.perception.calibration.head import HeadFit, HeadView, calibrate_head
from unwrinkle.perception.calibration.stereo import PairView, StereoCalibration
from unwrinkle.perception.camera import Camera
from unwrinkle.perception.stereo.head import Gaze, StereoHead
from unwrinkle.perception.stereo.head_file import HeadCalibration
from unwrinkle.simulation.devices.pan_tilt import VirtualPanTilt
from unwrinkle.simulation.rendering.boards import RenderedBoard
from unwrinkle.simulation.rendering.image_noise import photograph_pair
from unwrinkle.simulation.rendering.renderer import Renderer

#: 12 x 9 squares of 40 mm.
BOARD = Board(11, 8, 0.04)
_STAGE = (0.0, -1.15, 0.80)  # looked at while the board is carried about, m
_FIXED = (0.02, -1.12, 0.86)  # where the board stays, m
_MARGIN = 0.012  # of the image's width that the board's corners keep from its border
_TABLE = 0.70
_TRIES = 20000
_MOUNT_TURN, _MOUNT_SHIFT = np.radians(1.0), 0.004
_BASE_TURN, _BASE_SHIFT = np.radians(0.5), 0.005
_FOCAL, _CENTRE, _K = 0.006, 12.0, 0.03

#: Makes the two views of a board at X_WT from the cameras' poses; None where it is not found.
Eyes = Callable[[Pose, tuple[Pose, Pose]], tuple[BoardView | None, BoardView | None]]


def true_head(nominal: StereoHead, rng: np.random.Generator) -> StereoHead:
    """Make a head as it might really be: cameras, mounts and the right base off by usual errors."""

    def off(X: Pose, turn: float, shift: float) -> Pose:
        R = Rotation.from_rotvec(rng.uniform(-turn, turn, 3)).as_matrix()
        return np.asarray(X @ pose(R, rng.uniform(-shift, shift, 3)))

    eyes = []
    for eye in (nominal.left, nominal.right):
        camera, scale = eye.camera, eye.camera.width / nominal.left.camera.width
        focal = 1.0 + rng.uniform(-_FOCAL, _FOCAL)
        centre = scale * rng.uniform(-_CENTRE, _CENTRE, 2)
        k1, k2, *rest = camera.distortion
        camera = dataclasses.replace(
            camera,
            fx=camera.fx * focal,
            fy=camera.fy * focal,
            cx=camera.cx + float(centre[0]),
            cy=camera.cy + float(centre[1]),
            distortion=[k1 + _K * rng.uniform(-1.0, 1.0), k2, *rest],
        )
        X_MC = off(eye.X_MC, _MOUNT_TURN, _MOUNT_SHIFT)
        X_RB = eye.X_RB if eye.name == "left" else off(eye.X_RB, _BASE_TURN, _BASE_SHIFT)
        eyes.append(dataclasses.replace(eye, camera=camera, X_MC=X_MC, X_RB=X_RB))
    return dataclasses.replace(nominal, left=eyes[0], right=eyes[1])


def scaled_head(head: StereoHead, scale: float) -> StereoHead:
    """Return the head with cameras of fewer pixels of the same view."""

    def fewer(camera: Camera) -> Camera:
        return dataclasses.replace(
            camera,
            width=round(camera.width * scale),
            height=round(camera.height * scale),
            fx=camera.fx * scale,
            fy=camera.fy * scale,
            cx=(camera.cx + 0.5) * scale - 0.5,
            cy=(camera.cy + 0.5) * scale - 0.5,
        )

    left, right = (dataclasses.replace(e, camera=fewer(e.camera)) for e in (head.left, head.right))
    return dataclasses.replace(head, left=left, right=right)


def in_view(camera: Camera, X_WC: Pose, points_W: NDArray[np.float64]) -> bool:
    """Return whether all points (n, 3) are in the camera's image, off its border."""
    points = transformed(inverse(X_WC), points_W)
    if points[:, 2].min() < 0.5:
        return False
    pixels = camera.project(points)
    margin = _MARGIN * camera.width
    size = np.array([camera.width, camera.height])
    return bool((pixels > margin).all() and (pixels < size - 1 - margin).all())


def board_places(
    head: StereoHead,
    gaze: Gaze,
    outline_T: NDArray[np.float64],
    count: int,
    rng: np.random.Generator,
) -> list[Pose]:
    """Choose poses X_WT of a board above the table, tilted every way, over the whole image."""
    X_WL, X_WR = head.poses(gaze)
    camera = head.left.camera
    middle = outline_T.mean(axis=0)
    found: list[Pose] = []
    for _ in range(_TRIES):
        u, v = rng.uniform(0.0, 1.0, 2) * [camera.width, camera.height]
        depth = rng.uniform(1.5, 2.4)
        x, y = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
        tilt = Rotation.from_rotvec([*rng.uniform(-0.7, 0.7, 2), 0.0])
        turn = Rotation.from_rotvec([0.0, 0.0, rng.uniform(-np.pi, np.pi)])
        X_CT = pose((tilt * turn).as_matrix(), np.array([x, y, 1.0]) * depth)
        X_CT[:3, 3] -= X_CT[:3, :3] @ middle
        X_WT = X_WL @ X_CT
        outline = transformed(X_WT, outline_T)
        if outline[:, 2].min() < _TABLE + 0.03:
            continue
        if in_view(camera, X_WL, outline) and in_view(head.right.camera, X_WR, outline):
            found.append(X_WT)
            if len(found) == count:
                return found
    raise RuntimeError(f"only {len(found)} of {count} board places found")


def fixed_place(centre: tuple[float, float, float], middle_T: NDArray[np.float64]) -> Pose:
    """Return X_WT of a board that leans on the table, its face towards the head."""
    lean = Rotation.from_euler("x", 180.0 + 20.0, degrees=True)
    turn = Rotation.from_euler("z", 190.0, degrees=True)
    X_WT = pose((turn * lean).as_matrix(), np.array(centre))
    X_WT[:3, 3] -= X_WT[:3, :3] @ middle_T
    return X_WT


def gazes(
    head: StereoHead, outline_W: NDArray[np.float64], count: int, rng: np.random.Generator
) -> list[Gaze]:
    """Choose gazes, in whole steps, with the board in both images, often near their borders."""
    middle = outline_W.mean(axis=0)
    aimed = head.gaze_at(middle)
    found: list[Gaze] = []
    for _ in range(_TRIES):
        angles = []
        for eye, (pan, tilt) in ((head.left, aimed.left), (head.right, aimed.right)):
            away = rng.choice([-1.0, 1.0], 2) * np.sqrt(rng.uniform(0.0, 1.0, 2))
            step = eye.unit.step
            wanted = np.array([pan, tilt]) + away * np.radians([16.0, 11.0])
            angles += [float(a) for a in np.rint(wanted / step) * step]
        gaze = Gaze(*angles)
        poses = head.poses(gaze)
        if all(
            in_view(eye.camera, X_WC, outline_W)
            for eye, X_WC in zip((head.left, head.right), poses, strict=True)
        ):
            found.append(gaze)
            if len(found) == count:
                return found
    raise RuntimeError(f"only {len(found)} of {count} gazes found")


@dataclass
class Units:
    """Both pan-tilt units: where they really stand when sent to a gaze."""

    left: VirtualPanTilt
    right: VirtualPanTilt

    @staticmethod
    def of(head: StereoHead, repeatability: float, seed: int) -> "Units":
        """Make the units of a head; repeatability in steps."""
        seeds = np.random.SeedSequence(seed).generate_state(2)
        left, right = (
            VirtualPanTilt(
                eye.unit.step,
                eye.unit.pan,
                eye.unit.tilt,
                repeatability=repeatability,
                seed=int(own),
            )
            for eye, own in zip((head.left, head.right), seeds, strict=True)
        )
        return Units(left, right)

    def go(self, gaze: Gaze) -> Gaze:
        """Go there; return where the units stand."""
        for unit, (pan, tilt) in ((self.left, gaze.left), (self.right, gaze.right)):
            unit.move(round(pan / unit.step), round(tilt / unit.step))
        return Gaze(*self.left.true_angles, *self.right.true_angles, gaze.ext_axis)


def corners_of(head: StereoHead, board: Board, noise: float, rng: np.random.Generator) -> Eyes:
    """Make eyes that find every corner of a board up to white noise, without images."""

    def look(X_WT: Pose, poses: tuple[Pose, Pose]) -> tuple[BoardView, BoardView]:
        views = []
        for eye, X_WC in zip((head.left, head.right), poses, strict=True):
            camera = eye.camera
            seen = camera.project(transformed(inverse(X_WC) @ X_WT, board.points_T))
            seen = seen + noise * rng.standard_normal(seen.shape)
            ids = np.arange(len(seen))
            views.append(
                BoardView(board.points_T, seen, ids, camera.width, camera.height, eye.name)
            )
        return views[0], views[1]

    return look


def photographs_of(
    head: StereoHead, renderer: Renderer, rendered: RenderedBoard, board: Board, seed: int
) -> Eyes:
    """Make eyes that photograph the scene with the board in it, and find it in the pictures."""
    state = np.random.default_rng(seed)
    shift = np.array([rendered.square, rendered.square, 0.0])

    def look(X_WT: Pose, poses: tuple[Pose, Pose]) -> tuple[BoardView | None, BoardView | None]:
        renderer.move(rendered.mesh.name, X_WT @ inverse(pose(np.eye(3), shift)))
        eyes = (head.left.camera, poses[0], head.right.camera, poses[1])
        own = int(state.integers(2**31))
        pictures = photograph_pair(renderer, eyes, own, colour=False, quality=2)
        found = [
            find_board(picture, board, name=side)
            for picture, side in zip(pictures, ("left", "right"), strict=True)
        ]
        left, right = (None if isinstance(view, NoBoard) else view for view in found)
        return left, right

    return look


def corner_errors(
    head: StereoHead, X_WT: Pose, poses: tuple[Pose, Pose], views: Sequence[BoardView | None]
) -> NDArray[np.float64]:
    """Return the distances (n,) of found corners from where the true cameras have them, pixels."""
    errors = []
    for eye, X_WC, view in zip((head.left, head.right), poses, views, strict=True):
        if view is not None:
            truth = eye.camera.project(transformed(inverse(X_WC) @ X_WT, view.points_T))
            errors.append(np.linalg.norm(view.corners - truth, axis=1))
    return np.concatenate(errors) if errors else np.zeros(0)


class BoardScene:
    """What a head sees of boards: at many places, and of a fixed one from many gazes."""

    def __init__(
        self, truth: StereoHead, eyes: Eyes, rng: np.random.Generator, places: int, looks: int
    ) -> None:
        """Choose poses of the board and gazes at it.

        Args:
            truth: the head.
            eyes: make the views.
            rng: of every choice.
            places: of the board that is carried about.
            looks: at the fixed board.
        """
        self.truth, self.eyes = truth, eyes
        margin = BOARD.square * np.array([[-1, -1], [-1, BOARD.rows], [BOARD.columns, -1]])
        corners = [*margin, BOARD.square * np.array([BOARD.columns, BOARD.rows])]
        self.outline_T = np.column_stack([corners, np.zeros(4)])
        # Whoever carries the board about sees by the images, not by the angles, what is in view.
        self.stage = truth.gaze_at(np.array(_STAGE))
        self.places = board_places(truth, self.stage, self.outline_T, places, rng)
        self.fixed = fixed_place(_FIXED, BOARD.points_T.mean(axis=0))
        self.gazes = gazes(truth, transformed(self.fixed, self.outline_T), looks, rng)
        self.corner_errors: list[NDArray[np.float64]] = []

    def pairs(self, progress: Callable[[int, int, str], None] | None = None) -> list[PairView]:
        """Return the views of the board at its places."""
        found, poses = [], self.truth.poses(self.stage)
        for number, X_WT in enumerate(self.places):
            if progress is not None:
                progress(number, len(self.places), "board at places")
            left, right = self.eyes(X_WT, poses)
            self.corner_errors.append(corner_errors(self.truth, X_WT, poses, (left, right)))
            if left is not None and right is not None:
                found.append(PairView(str(number), left, right))
        return found

    def calibrated(
        self,
        stereo: StereoCalibration,
        nominal: HeadCalibration,
        repeatability: float,
        seed: int,
        progress: Callable[[int, int, str], None] | None = None,
    ) -> HeadFit:
        """Look at the fixed board and calibrate; repeatability of the units in steps."""
        units, looks = Units.of(self.truth, repeatability, seed), []
        for number, gaze in enumerate(self.gazes):
            if progress is not None:
                progress(number, len(self.gazes), f"gazes, repeatability {repeatability} steps")
            poses = self.truth.poses(units.go(gaze))
            left, right = self.eyes(self.fixed, poses)
            self.corner_errors.append(corner_errors(self.truth, self.fixed, poses, (left, right)))
            looks.append(HeadView(f"look {number}", gaze, left, right))
        return calibrate_head(looks, stereo, nominal)
