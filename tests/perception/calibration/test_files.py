"""Calibration files: image pairs, head views, round trips."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from unwrinkle.models.errors import InputError
from unwrinkle.models.io.loader_yaml import load_yaml
from unwrinkle.models.transforms import PoseRecord, pose
from unwrinkle.perception.calibration.boards import Board, BoardView
from unwrinkle.perception.calibration.files import (
    MountedCamera,
    find_board_pairs,
    find_boards,
    find_pairs,
    load_stereo,
    read_gripper_views,
    read_head_views,
    save_record,
)
from unwrinkle.perception.calibration.stereo import PairRecord, StereoCalibration
from unwrinkle.perception.camera import Camera

BOARD = Board(5, 4, 0.04)
CAMERA = Camera("c", 320, 240, 400.0, 400.0, 159.5, 119.5)
HERE = PoseRecord.of(pose(np.eye(3), np.array([0.1, 0.2, 0.3])))

Draw = Callable[..., NDArray[np.uint8]]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, draw_board: Draw) -> Path:
    """Holds board.png, which shows the board, and bare.png, which shows none."""
    folder = tmp_path_factory.mktemp("images")
    image = draw_board(BOARD, CAMERA, pose(np.eye(3), np.array([-0.08, -0.06, 0.5])))
    cv2.imwrite(str(folder / "board.png"), image)
    cv2.imwrite(str(folder / "bare.png"), np.full((240, 320), 90, np.uint8))
    return folder


def _touch(folder: Path, *names: str) -> list[Path]:
    paths = [folder / name for name in names]
    for path in paths:
        path.touch()
    return paths


def test_pairs_by_name(tmp_path: Path) -> None:
    files = _touch(tmp_path, "right_2.jpg", "left_1.png", "IMG-Left-10.JPG", "right_1.png")
    files += _touch(tmp_path, "left_2.jpg", "IMG-Right-10.JPG")
    _touch(tmp_path, "notes.txt")
    for given in (files, [tmp_path]):
        pairs = find_pairs(given)
        assert [pair.name for pair in pairs] == ["1", "2", "IMG--10"]
        assert pairs[1].left.name == "left_2.jpg"
        assert pairs[2].right.name == "IMG-Right-10.JPG"


def test_hidden_files_beside_the_images_are_skipped(tmp_path: Path) -> None:
    files = _touch(tmp_path, "left1.png", "right1.png", "._left1.png", "._right1.png")
    _touch(tmp_path, ".left2.png")
    assert find_pairs([tmp_path]) == find_pairs(files)
    assert [pair.left.name for pair in find_pairs([tmp_path])] == ["left1.png"]


@pytest.mark.parametrize(
    ("names", "named"),
    [
        ((), "no images"),
        (("left1.png", "right1.png", "left2.png"), "'2' has no right image"),
        (("left1.png", "right1.png", "dark.png"), "which eye"),
        (("leftright.png",), "which eye"),
        (("left1.png", "left_1.png", "right1.png"), "both are the left image of pair '1'"),
    ],
)
def test_images_that_make_no_pairs(tmp_path: Path, names: tuple[str, ...], named: str) -> None:
    with pytest.raises(InputError, match=named):
        find_pairs(_touch(tmp_path, *names))


def test_progress_and_order(folder: Path) -> None:
    told: list[tuple[int, int, str]] = []
    files = [folder / "board.png", folder / "bare.png", folder / "board.png"]
    found = find_boards(files, BOARD, lambda *state: told.append(state))
    assert told == [(1, 3, "board.png"), (2, 3, "bare.png"), (3, 3, "board.png")]
    assert [isinstance(view, BoardView) for view in found] == [True, False, True]


def test_pairs_without_a_board_are_named(folder: Path, tmp_path: Path) -> None:
    for name, source in (("left1", "board"), ("right1", "bare"), ("left2", "board")):
        (tmp_path / f"{name}.png").write_bytes((folder / f"{source}.png").read_bytes())
    (tmp_path / "right2.png").write_bytes((folder / "board.png").read_bytes())
    views, missing = find_board_pairs(find_pairs([tmp_path]), BOARD)
    assert [view.name for view in views] == ["2"]
    assert len(missing) == 1
    assert missing[0].startswith("1: right: no chessboard of 5x4")


def _looks_file(folder: Path, text: str) -> Path:
    path = folder / "looks.yaml"
    path.write_text(text)
    return path


def test_looks(folder: Path) -> None:
    path = _looks_file(
        folder,
        "looks:\n"
        "- {left: {image: board.png, pan: 0.1, tilt: -0.2},\n"
        "   right: {image: bare.png, pan: 0.3, tilt: -0.4}, ext_axis: 0.5, place: shelf}\n"
        "- {name: last, left: {pan: 0.0, tilt: 0.0},\n"
        "   right: {image: board.png, pan: 0.0, tilt: 0.1}}\n",
    )
    looks, missing = read_head_views(path, BOARD)
    assert [look.name for look in looks] == ["look 1", "last"]
    first, last = looks
    assert (first.gaze.left, first.gaze.right) == ((0.1, -0.2), (0.3, -0.4))
    assert (first.gaze.ext_axis, first.place) == (0.5, "shelf")
    assert first.left is not None
    assert first.right is None
    assert last.left is None
    assert last.right is not None
    assert len(missing) == 1
    assert missing[0].startswith("look 1: right: no chessboard")


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("looks: []\n", "has no looks"),
        ("looks:\n- {left: {image: board.png, pan: 0.1}}\n", "pan and tilt of both"),
        ("looks:\n- {left: {picture: board.png}}\n", "picture"),
        (
            "looks:\n- left: {image: none.png, pan: 0.0, tilt: 0.0}\n  right: {pan: 0.0, tilt: 0.0}\n",
            "none.png",
        ),
    ],
)
def test_bad_looks(folder: Path, text: str, named: str) -> None:
    with pytest.raises(InputError, match=named):
        read_head_views(_looks_file(folder, text), BOARD)


def test_poses(folder: Path) -> None:
    path = folder / "poses.yaml"
    row = f"{{translation: {HERE.translation}, rotation: {HERE.rotation}}}"
    path.write_text(
        f"looks:\n- {{image: board.png, pose: {row}}}\n- {{image: bare.png, pose: {row}}}\n"
    )
    poses, views, missing = read_gripper_views(path, BOARD)
    np.testing.assert_array_equal(poses, [HERE.matrix("x")])
    assert len(views) == 1
    assert missing[0].startswith("bare.png: no chessboard")
    path.write_text("looks:\n- {image: board.png}\n")
    with pytest.raises(InputError, match=r"board\.png: a pose needs"):
        read_gripper_views(path, BOARD)


def test_a_stereo_calibration_comes_back_whole(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    some = [3, 4, 7, 9]
    record = PairRecord(
        "07",
        0.1,
        0.2,
        [],
        some,
        rng.uniform(0, 300, (20, 2)).tolist(),
        rng.uniform(0, 9, (4, 2)).tolist(),
    )
    saved = StereoCalibration(
        "2030-01-02", CAMERA, CAMERA, HERE, 0.1, 0.2, [1.0, 2.0], BOARD, [record], ["08: dark"]
    )
    save_record(tmp_path / "stereo.yaml", saved)
    loaded = load_stereo(tmp_path / "stereo.yaml")
    assert loaded == saved
    (pair,) = loaded.pair_views()
    np.testing.assert_array_equal(pair.left.points_T, BOARD.points_T)
    np.testing.assert_array_equal(pair.right.ids, some)
    np.testing.assert_array_equal(pair.right.points_T, BOARD.points_T[some])


def test_bad_stereo_files(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="unwrinkle calibrate stereo"):
        load_stereo(tmp_path / "none.yaml")
    (tmp_path / "odd.yaml").write_text("date: '2030-01-02'\ncolour: red\n")
    with pytest.raises(InputError, match="colour"):
        load_stereo(tmp_path / "odd.yaml")
    record = PairRecord("07", left_ids=[99], left=[[1.0, 2.0]])
    with pytest.raises(InputError, match="07, left: corner ids"):
        StereoCalibration(left=CAMERA, right=CAMERA, board=BOARD, views=[record]).pair_views()


def test_a_mounted_camera_comes_back_whole(tmp_path: Path) -> None:
    saved = MountedCamera("2030-01-02", CAMERA, HERE, 0.1, 12, ["g3.png: dark"])
    save_record(tmp_path / "gripper.yaml", saved)
    assert load_yaml(tmp_path / "gripper.yaml", MountedCamera) == saved


def test_left_and_right_alone_are_a_pair(tmp_path: Path) -> None:
    """Regression: such a pair was said to have no right image, with right.png beside it."""
    (pair,) = find_pairs(_touch(tmp_path, "left.png", "right.png"))
    assert (pair.left.name, pair.right.name) == ("left.png", "right.png")
