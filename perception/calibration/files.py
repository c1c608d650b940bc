"""Files of a calibration: image pairs, head views, gripper views, results."""

import dataclasses
import re
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path

import yaml

from unwrinkle.models.arrays import Pose
from unwrinkle.models.errors import InputError
from unwrinkle.models.io.files import write_text
from unwrinkle.models.io.loader_yaml import load_yaml
from unwrinkle.models.transforms import PoseRecord
from unwrinkle.perception.calibration.boards import Board, BoardView, NoBoard, find_board, load_grey
from unwrinkle.perception.calibration.head import HeadView
from unwrinkle.perception.calibration.stereo import PairView, StereoCalibration
from unwrinkle.perception.camera import Camera
from unwrinkle.perception.stereo.head import Gaze

#: Suffixes of image files.
IMAGES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp")
_SIDE = re.compile(r"left|right", re.IGNORECASE)
#: Threads for the detection of boards.
_WORKERS = 2

#: Name of the pair left.png, right.png.
_NAMELESS = "pair"

#: Callback with the number of images done, the number of all, and the file's name.
Progress = Callable[[int, int, str], None]


@dataclass(frozen=True)
class ImagePair:
    """Two simultaneous image files; `name` is the common part of their names."""

    name: str
    left: Path
    right: Path


@dataclass(frozen=True)
class EyeImage:
    """One eye in looks.yaml: its image (empty for none) and its angles, radians."""

    image: str = ""
    pan: float = float("nan")
    tilt: float = float("nan")


@dataclass(frozen=True)
class HeadViewRecord:
    """One head view in looks.yaml.

    Attributes:
        name: for messages; optional.
        left, right: image and angles of each eye.
        ext_axis: angle of the turn-table, radians.
        place: label of the board's place; change it when the board is moved.
    """

    name: str = ""
    left: EyeImage = field(default_factory=EyeImage)
    right: EyeImage = field(default_factory=EyeImage)
    ext_axis: float = 0.0
    place: str = ""


@dataclass(frozen=True)
class HeadViews:
    """Schema of looks.yaml; image paths are relative to it."""

    looks: list[HeadViewRecord] = field(default_factory=list)


@dataclass(frozen=True)
class GripperView:
    """One view of the gripper camera: its image and X_WG, the gripper's pose."""

    image: str = ""
    pose: PoseRecord = field(default_factory=PoseRecord)


@dataclass(frozen=True)
class GripperViews:
    """Schema of poses.yaml; image paths are relative to it."""

    looks: list[GripperView] = field(default_factory=list)


@dataclass(frozen=True)
class MountedCamera:
    """Calibrated gripper camera, as stored in its file.

    Attributes:
        date: YYYY-MM-DD.
        camera: intrinsics.
        mount: X_GC, pose of the camera in the gripper's frame.
        residual: RMS reprojection error, pixels.
        views: number of views used.
        rejected: rejected views, with the reason.
    """

    date: str = ""
    camera: Camera = field(default_factory=Camera)
    mount: PoseRecord = field(default_factory=PoseRecord)
    residual: float = 0.0
    views: int = 0
    rejected: list[str] = field(default_factory=list)


def find_pairs(paths: Sequence[Path]) -> list[ImagePair]:
    """Pair image files whose names differ only in `left` and `right`.

    Args:
        paths: image files, or folders of them.

    Raises:
        InputError: no images, a name without left or right, or an image without its counterpart.
    """
    files: list[Path] = []
    for path in paths:
        if path.is_dir():
            # macOS leaves a file ._NAME beside each NAME on foreign disks.
            files += sorted(
                p
                for p in path.iterdir()
                if p.suffix.lower() in IMAGES and not p.name.startswith(".")
            )
        elif not path.name.startswith("._"):
            files.append(path)
    sides: dict[str, dict[str, Path]] = {}
    for file in files:
        found = _SIDE.findall(file.stem)
        if len(found) != 1:
            raise InputError(
                f"{file}: cannot tell which eye it is of; name pairs like left01.png, right01.png"
            )
        key = _SIDE.sub("", file.stem).strip("_- .") or _NAMELESS
        side = found[0].lower()
        other = sides.setdefault(key, {}).setdefault(side, file)
        if other != file:
            raise InputError(f"{file} and {other}: both are the {side} image of pair {key!r}")
    if not sides:
        raise InputError("calibration: no images; give left*/right* files or a folder of them")
    for key, pair in sides.items():
        if len(pair) == 1:
            ((side, file),) = pair.items()
            missing = "right" if side == "left" else "left"
            raise InputError(
                f"{file}: pair {key!r} has no {missing} image; add it or leave both out"
            )
    return [ImagePair(key, sides[key]["left"], sides[key]["right"]) for key in sorted(sides)]


def find_boards(
    images: Sequence[Path], board: Board, progress: Progress | None = None
) -> list[BoardView | NoBoard]:
    """Detect a board in each image file.

    Args:
        images: image files.
        board: the board.
        progress: called after each file.

    Raises:
        InputError: a file is missing or not an image.
    """

    def find(path: Path) -> BoardView | NoBoard:
        return find_board(load_grey(path), board, name=path.name)

    found: list[BoardView | NoBoard] = []
    with ThreadPoolExecutor(_WORKERS) as workers:
        for path, view in zip(images, workers.map(find, images), strict=True):
            found.append(view)
            if progress is not None:
                progress(len(found), len(images), path.name)
    return found


def find_board_pairs(
    pairs: Sequence[ImagePair], board: Board, progress: Progress | None = None
) -> tuple[list[PairView], list[str]]:
    """Detect the board in image pairs; return the views, and a reason for each other pair.

    Raises:
        InputError: a file is missing or not an image.
    """
    found = find_boards(
        [file for pair in pairs for file in (pair.left, pair.right)], board, progress
    )
    views, missing = [], []
    for pair, left, right in zip(pairs, found[::2], found[1::2], strict=True):
        if isinstance(left, BoardView) and isinstance(right, BoardView):
            views.append(PairView(pair.name, left, right))
        else:
            missing.append(f"{pair.name}: {_reasons((left, right))}")
    return views, missing


def read_head_views(
    path: Path, board: Board, progress: Progress | None = None
) -> tuple[list[HeadView], list[str]]:
    """Read looks.yaml and detect the board; return the views, and reasons for missing boards.

    Raises:
        InputError: the file or an image is missing or unreadable, or angles are missing.
    """
    records = load_yaml(path, HeadViews).looks
    if not records:
        raise InputError(f"{path}: has no looks; list them under 'looks'")
    names = [record.name or f"look {number + 1}" for number, record in enumerate(records)]
    files: dict[tuple[int, int], Path] = {}
    for k, (name, record) in enumerate(zip(names, records, strict=True)):
        for eye, side in enumerate((record.left, record.right)):
            if not (isfinite(side.pan) and isfinite(side.tilt)):
                raise InputError(f"{path}: {name} needs pan and tilt of both eyes, in radians")
            if side.image:
                files[k, eye] = path.parent / side.image
    found = dict(zip(files, find_boards(list(files.values()), board, progress), strict=True))
    looks, missing = [], []
    for k, (name, record) in enumerate(zip(names, records, strict=True)):
        sides = [found.get((k, eye)) for eye in (0, 1)]
        if reasons := _reasons(sides):
            missing.append(f"{name}: {reasons}")
        left, right = (side if isinstance(side, BoardView) else None for side in sides)
        angles = (record.left.pan, record.left.tilt, record.right.pan, record.right.tilt)
        looks.append(HeadView(name, Gaze(*angles, record.ext_axis), left, right, record.place))
    return looks, missing


def read_gripper_views(
    path: Path, board: Board, progress: Progress | None = None
) -> tuple[list[Pose], list[BoardView], list[str]]:
    """Read poses.yaml and detect the board; return X_WG and board of each view, and reasons.

    Raises:
        InputError: the file or an image is missing or unreadable, or a pose is not a rigid
            transform.
    """
    records = load_yaml(path, GripperViews).looks
    if not records:
        raise InputError(f"{path}: has no looks; list image and pose under 'looks'")
    X_WG = [record.pose.matrix(f"{path}: {record.image}") for record in records]
    found = find_boards([path.parent / record.image for record in records], board, progress)
    kept = [(X, view) for X, view in zip(X_WG, found, strict=True) if isinstance(view, BoardView)]
    missing = [f"{view.name}: {view.reason}" for view in found if isinstance(view, NoBoard)]
    return [X for X, _ in kept], [view for _, view in kept], missing


def load_stereo(path: str | Path) -> StereoCalibration:
    """Load a stereo calibration.

    Raises:
        InputError: missing file, unknown key or unusable value; the message names the file.
    """
    if not Path(path).is_file():
        raise InputError(f"{path}: no such file; make it with `unwrinkle calibrate stereo`")
    return load_yaml(path, StereoCalibration)


def save_record(path: str | Path, record: StereoCalibration | MountedCamera) -> None:
    """Write a calibration as YAML, atomically.

    Raises:
        InputError: the file cannot be written.
    """
    text = yaml.safe_dump(
        dataclasses.asdict(record), sort_keys=False, width=100, default_flow_style=None
    )
    write_text(path, text)


def _reasons(views: Iterable[BoardView | NoBoard | None]) -> str:
    return "; ".join(
        f"{side}: {view.reason}"
        for side, view in zip(("left", "right"), views, strict=True)
        if isinstance(view, NoBoard)
    )
