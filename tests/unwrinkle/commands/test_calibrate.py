"""`unwrinkle calibrate`: images and angles in, calibration files and residual pictures out."""

import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from unwrinkle import cli
from unwrinkle.models.arrays import Pose
from unwrinkle.models.io.loader_yaml import load_yaml
from unwrinkle.models.transforms import PoseRecord, inverse, pose, transformed
from unwrinkle.perception.calibration.boards import Board
from unwrinkle.perception.calibration.files import MountedCamera, load_stereo
from unwrinkle.perception.calibration.hand_eye import angle_between
from unwrinkle.perception.camera import load_camera
from unwrinkle.perception.stereo.head import StereoHead
from unwrinkle.perception.stereo.head_file import load_calibration, nominal_head
from unwrinkle.testing.calibration_scene import (
    board_places,
    fixed_place,
    gazes,
    scaled_head,
    true_head,
)

BOARD = Board(6, 5, 0.07)
OPTIONS = ("--board", "6x5", "--square", "0.07")

Draw = Callable[..., NDArray[np.uint8]]
Run = Callable[..., int]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Run:
    """Run the command in an empty folder; return its exit code."""
    monkeypatch.chdir(tmp_path)

    def main(*arguments: str | Path) -> int:
        monkeypatch.setattr(sys, "argv", ["unwrinkle", *map(str, arguments)])
        with pytest.raises(SystemExit) as stop:
            cli.main()
        assert isinstance(stop.value.code, int)
        return stop.value.code

    return main


def _is_png(path: Path) -> bool:
    image = cv2.imread(str(path))
    return image is not None and min(image.shape[:2]) > 600 and image.std() > 10.0


def _truth() -> StereoHead:
    return true_head(scaled_head(nominal_head(), 0.125), np.random.default_rng(1))


@pytest.fixture(scope="module")
def photographs(tmp_path_factory: pytest.TempPathFactory, draw_board: Draw) -> Path:
    """Return a folder with pairs of a moved calibration board, looks at a fixed one, and
    looks.yaml.
    """
    folder = tmp_path_factory.mktemp("head")
    rng, head = np.random.default_rng(2), _truth()
    margin = BOARD.square * np.array([[-1, -1], [-1, 5], [6, -1], [6, 5]])
    outline = np.column_stack([margin, np.zeros(4)])
    stage = head.gaze_at(np.array([0.0, -1.15, 0.8]))

    def take(name: str, number: int, X_WT: Pose, poses: tuple[Pose, Pose]) -> None:
        for side, camera, X_WC in zip(
            ("left", "right"), (head.left.camera, head.right.camera), poses, strict=True
        ):
            image = draw_board(BOARD, camera, inverse(X_WC) @ X_WT, noise=1.0)
            (folder / name).mkdir(exist_ok=True)
            cv2.imwrite(str(folder / name / f"{side}{number}.png"), image)

    for number, X_WT in enumerate(board_places(head, stage, outline, 10, rng)):
        take("pairs", number, X_WT, head.poses(stage))
    fixed = fixed_place((0.02, -1.12, 0.9), BOARD.points_T.mean(axis=0))
    looks = []
    for number, gaze in enumerate(gazes(head, transformed(fixed, outline), 10, rng)):
        take("looks", number, fixed, head.poses(gaze))
        angles = zip(("left", "right"), (gaze.left, gaze.right), strict=True)
        looks.append(
            {
                side: {"image": f"looks/{side}{number}.png", "pan": pan, "tilt": tilt}
                for side, (pan, tilt) in angles
            }
        )
    (folder / "looks.yaml").write_text(yaml.safe_dump({"looks": looks}))
    return folder


@pytest.mark.slow
def test_the_head_from_photographs(
    photographs: Path, run: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("calibrate", "stereo", photographs / "pairs", *OPTIONS) == 0
    output = capsys.readouterr().out
    assert "10 pairs: RMS 0.0" in output
    assert _is_png(tmp_path / "stereo.png")
    stereo = load_stereo(tmp_path / "stereo.yaml")
    head = _truth()
    assert stereo.left.fx == pytest.approx(head.left.camera.fx, rel=3e-3)
    assert stereo.board == BOARD

    out = tmp_path / "cell" / "glasgow.yaml"
    files = ("--stereo", "stereo.yaml", "--looks", photographs / "looks.yaml")
    assert run("calibrate", "hand-eye", *files, "--out", out) == 0
    output = capsys.readouterr().out
    assert "methods agree" in output
    assert "are repeatable to" in output
    assert _is_png(out.with_suffix(".png"))
    found = load_calibration(out).stereo_head()
    for true, mine in ((head.left, found.left), (head.right, found.right)):
        assert np.degrees(angle_between(true.X_MC, mine.X_MC)) < 0.06
        assert np.linalg.norm(true.X_MC[:3, 3] - mine.X_MC[:3, 3]) < 0.003

    tampered = yaml.safe_load((photographs / "looks.yaml").read_text())
    for side in ("left", "right"):
        for look in tampered["looks"]:
            look[side]["tilt"] = 0.01
    path = photographs / "still.yaml"
    path.write_text(yaml.safe_dump(tampered))
    before = out.read_bytes()
    files = ("--stereo", "stereo.yaml", "--looks", path)
    assert run("calibrate", "hand-eye", *files, "--out", out) == 2
    assert "tilt varies by only 0.0 degrees" in capsys.readouterr().err
    assert out.read_bytes() == before


@pytest.mark.slow
def test_a_camera_in_the_gripper_from_photographs(
    draw_board: Draw, run: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    camera = load_camera("xtion-pro-live")
    rng, X_GC = np.random.default_rng(3), pose(np.eye(3), np.array([0.05, 0.0, 0.02]))
    looks = []
    for number in range(10):
        R = Rotation.from_rotvec([*rng.uniform(-0.5, 0.5, 2), rng.uniform(-1.0, 1.0)])
        X_CT = pose(R.as_matrix(), np.array([0.0, 0.0, 0.9]) + rng.uniform(-0.05, 0.05, 3))
        X_CT[:3, 3] -= X_CT[:3, :3] @ BOARD.points_T.mean(axis=0)
        cv2.imwrite(str(tmp_path / f"{number}.png"), draw_board(BOARD, camera, X_CT, noise=1.0))
        record = PoseRecord.of(inverse(X_CT) @ inverse(X_GC))
        looks.append(
            {
                "image": f"{number}.png",
                "pose": {"translation": record.translation, "rotation": record.rotation},
            }
        )
    (tmp_path / "poses.yaml").write_text(yaml.safe_dump({"looks": looks}))
    files = ("--poses", "poses.yaml", "--camera", "xtion-pro-live")
    assert run("calibrate", "hand-eye", *files, *OPTIONS) == 0
    assert "10 looks: RMS 0." in capsys.readouterr().out
    found = load_yaml(tmp_path / "gripper-camera.yaml", MountedCamera)
    np.testing.assert_allclose(found.mount.matrix("mount"), X_GC, atol=2e-3)
    assert found.views == 10
    assert _is_png(tmp_path / "gripper-camera.png")


@pytest.mark.end_to_end
def test_real_chessboards(
    shared_data: Path, run: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Eight views suffice; with one damaged there are too few."""
    source = shared_data / "stereo_chessboard"
    board = ("--board", "9x6", "--square", "0.025")
    assert run("calibrate", "stereo", source, *board, "--out", "a/b.yaml") == 0
    output = capsys.readouterr().out
    assert "8 pairs: RMS 0.13" in output
    assert "written to a/b.yaml and a/b.png" in output
    assert _is_png(tmp_path / "a" / "b.png")
    for file in source.glob("*.jpg"):
        shutil.copy(file, tmp_path)
    cv2.imwrite(str(tmp_path / "left05.jpg"), np.full((512, 640), 128, np.uint8))
    assert run("calibrate", "stereo", *sorted(tmp_path.glob("*.jpg")), *board) == 2
    error = capsys.readouterr().err
    assert "7 usable views, wanted at least 8" in error
    assert "05: left: no chessboard of 9x6" in error
    assert not (tmp_path / "stereo.yaml").exists()


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("stereo", "."), "board is not given"),
        (("stereo", ".", "--board", "nine", "--square", "0.025"), "COLUMNSxROWS"),
        (("stereo", ".", "--board", "8x8", "--square", "0.025"), "half a turn"),
        (("stereo", ".", "--board", "9x6", "--square", "25"), "metres"),
        (("stereo", ".", "--board", "9x6", "--square", "0.025"), "no images"),
        (("stereo", "x.png", "--board", "9x6", "--square", "0.025"), "which eye"),
        (("hand-eye",), "--stereo FILE and --looks FILE"),
        (("hand-eye", "--poses", "p.yaml", "--looks", "l.yaml"), "not both"),
        (("hand-eye", "--poses", "p.yaml"), "board is not given"),
        (("hand-eye", "--stereo", "s.yaml", "--looks", "l.yaml"), "s.yaml: no such file"),
    ],
)
def test_bad_input_is_one_line(
    arguments: tuple[str, ...], named: str, run: Run, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("calibrate", *arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert named in captured.err
    assert captured.err.count("\n") == 1
