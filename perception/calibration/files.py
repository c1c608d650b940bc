"""What a calibration reads and writes: pairs of images by name, looks, poses, results."""

import dataclasses
import re
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path

import yaml

from unwrinkle.models import InputError, load_yaml
from unwrinkle.models.arrays import Pose
from unwrinkle.models.files import write_text
from unwrinkle.models.transforms import PoseRecord
from unwrinkle.perception.calibration.boards import Board, BoardView, NoBoard, find_board, load_grey
from unwrinkle.perception.calibration.head import HeadView
from unwrinkle.perception.calibration.stereo import PairView, StereoCalibration
from unwrinkle.perception.camera import Camera
from unwrinkle.perception.stereo.head import Gaze

IMAGES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp")
_SIDE = re.compile(r"left|right", re.IGNORECASE)
_WORKERS = 2
_NAMELESS = "pair"  # left.png and right.png, with nothing else in their names

Progress = Callable[[int, int, str], None]


@dataclass(frozen=True)
class ImagePair:
    """Two image files of one moment; `name` is what their names have in common."""

    name: str
    left: Path
    right: Path


@dataclass(frozen=True)
class EyeImage:
    """One eye in a file of looks: its image (empty for none) and its angles in radians."""

    image: str = ""
    pan: float = float("nan")
    tilt: float = float("nan")


@dataclass(frozen=True)
class HeadViewRecord:
    """One look in a file of looks.

    Attributes:
        name: for messages; may be left out.
        left, right: image and angles.
        ext_axis: angle of the turn-table, radians.
        place: which place the board was at; the same everywhere unless it was moved.
    """

    name: str = ""
    left: EyeImage = field(default_factory=EyeImage)
    right: EyeImage = field(default_factory=EyeImage)
    ext_axis: float = 0.0
    place: str = ""


@dataclass(frozen=True)
class HeadViews:
    """The schema of looks.yaml; images are named relative to it."""

    looks: list[HeadViewRecord] = field(default_factory=list)


@dataclass(frozen=True)
class GripperView:
    """One look of a camera in the gripper: its image, and X_WG, the gripper's pose then."""

    image: str = ""
    pose: PoseRecord = field(default_factory=PoseRecord)


@dataclass(frozen=True)
class GripperViews:
    """The schema of poses.yaml; images are named relative to it."""

    looks: list[GripperView] = field(default_factory=list)


@dataclass(frozen=True)
class MountedCamera:
    """A camera in the gripper, as its calibration's file states it.

    Attributes:
        date: YYYY-MM-DD.
        camera: intrinsics.
        mount: X_GC, the camera in the gripper's frame.
        residual: RMS reprojection error, pixels.
        views: looks that it rests on.
        rejected: the looks left out, with the reason.
    """

    date: str = ""
    camera: Camera = field(default_factory=Camera)
    mount: PoseRecord = field(default_factory=PoseRecord)
    residual: float = 0.0
    views: int = 0
    rejected: list[str] = field(default_factory=list)


def find_pairs(paths: Sequence[Path]) -> list[ImagePair]:
    """Pair image files whose names differ in `left` and `right` only.

    Args:
        paths: image files, or folders of them.

    Raises:
        InputError: no images, a name without left or right, or an image without its partner.
    """
    files: list[Path] = []
    for path in paths:
        if path.is_dir():
            files += sorted(p for p in path.iterdir() if p.suffix.lower() in IMAGES)
        else:
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
    """Find a board in each image file, two at a time.

    Args:
        images: files.
        board: to look for.
        progress: called with the number done, the number of all, and the file's name.

    Raises:
        InputError: a file is missing or is no image.
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
    """Find the board in pairs of images; also say which pairs lack it, and why.

    Raises:
        InputError: a file is missing or is no image.
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
    """Read looks.yaml and find the board in its images; also say where it is not, and why.

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
    """Read poses.yaml: X_WG of each look where the board was found, the board there, the rest.

    Raises:
        InputError: the file or an image is missing or unreadable, or a pose is no rigid motion.
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
    """Read a stereo calibration.

    Raises:
        InputError: missing, unknown keys, or absurd; the message names the file.
    """
    if not Path(path).is_file():
        raise InputError(f"{path}: no such file; make it with `unwrinkle calibrate stereo`")
    return load_yaml(path, StereoCalibration)


def save_record(path: str | Path, record: StereoCalibration | MountedCamera) -> None:
    """Write a calibration as YAML, whole or not at all.

    Raises:
        InputError: it cannot be written there.
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
