"""A rendered pair through the command line: a verified plan, or one line with the reason."""

import json
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from unwrinkle import cli
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.stereo.head_file import load_head_angles, nominal_calibration
from unwrinkle.perception.stereo.pair import load_pair
from unwrinkle.perception.stereo.range_mapping import range_map_from_pair
from unwrinkle.testing.table import TABLE

Run = Callable[..., tuple[int, str]]

pytestmark = [pytest.mark.end_to_end, pytest.mark.slow]


def called(arguments: tuple[object, ...], monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(sys, "argv", ["unwrinkle", *map(str, arguments)])
    with pytest.raises(SystemExit) as stop:
        cli.main()
    return 0 if stop.value.code is None else int(str(stop.value.code))


@pytest.fixture(scope="module")
def rendered(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A pair of 1 megapixel with its head.yaml."""
    folder = tmp_path_factory.mktemp("rendered") / "pair"
    with pytest.MonkeyPatch.context() as monkeypatch:
        options = ("--scale", 0.25, "--seed", 3, "--gaze-at", "-0.05,-1.12")
        assert called(("render", "--out", folder, *options), monkeypatch) == 0
    return folder


@pytest.fixture
def pair(rendered: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a copy of the pair in the working directory, to be damaged."""
    shutil.copytree(rendered, tmp_path / "pair")
    monkeypatch.chdir(tmp_path)
    return Path("pair")


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    def call(*arguments: object) -> tuple[int, str]:
        return called(arguments, monkeypatch), capsys.readouterr().err

    return call


def refused(run: Run, pair: Path, *options: object, left: str = "left.png") -> str:
    """Return the single line of the error of `analyse`; nothing may be written."""
    before = sorted(Path().rglob("*"))
    head = options or ("--head", pair / "head.yaml")
    code, message = run("analyse", pair / left, pair / "right.png", *head)
    assert code == 2, message
    assert message.startswith("unwrinkle: ") and message.count("\n") == 1, message
    assert sorted(Path().rglob("*")) == before
    return message


def test_the_pair_is_measured_as_its_truth_says(rendered: Path) -> None:
    names = {"left.png", "right.png", "head.yaml", "truth.npz"}
    assert {path.name for path in rendered.iterdir()} == names
    assert list(rendered.parent.iterdir()) == [rendered]
    assert str(rendered.parent) not in (rendered / "head.yaml").read_text()
    pair = load_pair(rendered / "left.png", rendered / "right.png")
    assert pair.left.shape == (816, 1232, 3)
    look, calibration = load_head_angles(rendered / "head.yaml")
    head = calibration.stereo_head()
    for angle in (*look.gaze.left, *look.gaze.right):
        assert angle / head.left.unit.step == pytest.approx(round(angle / head.left.unit.step))
    X_WL, _ = head.poses(look.gaze)
    at = X_WL[:3, 3] + X_WL[:3, 2] * (0.70 - X_WL[2, 3]) / X_WL[2, 2]
    assert at == pytest.approx([-0.05, -1.12, 0.70], abs=0.001)
    measured = range_map_from_pair(pair, head, look.gaze, table=TABLE)
    truth = RangeMap.load(rendered / "truth.npz")
    rows, columns = np.nonzero(measured.valid)
    x, y = measured.world_from_cell(np.column_stack([columns, rows])).T
    u, v = np.rint(truth.cell_from_world(np.column_stack([x, y]))).astype(int).T
    inside = (u >= 0) & (v >= 0) & (u < truth.shape[1]) & (v < truth.shape[0])
    u, v, rows, columns = u[inside], v[inside], rows[inside], columns[inside]
    on = cv2.erode(truth.garment.astype(np.uint8), np.ones((21, 21)))[v, u] > 0
    assert on.sum() > 10_000
    error = (measured.height[rows, columns] - truth.height[v, u])[on]
    assert np.sqrt(np.mean(error**2)) < 0.001
    assert abs(np.median(error)) < 0.0002


def test_a_pair_gets_a_plan_with_a_passing_verdict(run: Run, pair: Path) -> None:
    files = pair / "left.png", pair / "right.png", "--head", pair / "head.yaml"
    code, message = run("plan", *files, "--out", "out")
    assert code == 0, message
    verdict = json.loads(Path("out/verdict.json").read_text())
    assert verdict["passed"] is True
    analysis = json.loads(Path("out/analysis.json").read_text())
    widest = analysis["wrinkles"][0]
    # The largest ridge has its inflections 25 mm apart, 8.3 mm below its top.
    assert widest["width"] == pytest.approx(0.025, abs=0.002)
    assert widest["chord_height"] == pytest.approx(0.0083, abs=0.0012)
    assert Path("out/preview.html").stat().st_size > 100_000


def test_swapped_eyes(run: Run, pair: Path) -> None:
    shutil.move(pair / "left.png", pair / "other.png")
    shutil.move(pair / "right.png", pair / "left.png")
    shutil.move(pair / "other.png", pair / "right.png")
    assert "swapped" in refused(run, pair)


def test_one_eye_black(run: Run, pair: Path) -> None:
    cv2.imwrite(str(pair / "right.png"), np.zeros((816, 1232, 3), np.uint8))
    assert "the right eye is black" in refused(run, pair)


def test_an_eye_of_another_size(run: Run, pair: Path) -> None:
    image = cv2.imread(str(pair / "right.png"))
    assert image is not None
    cv2.imwrite(str(pair / "right.png"), cv2.resize(image, (616, 408)))
    assert "1232 x 816, the right 616 x 408" in refused(run, pair)


def test_a_missing_eye(run: Run, pair: Path) -> None:
    assert "no such left image" in refused(run, pair, left="lost.png")


def test_angles_of_another_look(run: Run, pair: Path) -> None:
    head = (pair / "head.yaml").read_text()
    lines = [
        f"  tilt: {float(line.split(':')[1]) + 0.003}" if "tilt" in line else line
        for line in head.splitlines()[:-1]
    ]
    (pair / "head.yaml").write_text("\n".join([*lines, head.splitlines()[-1]]) + "\n")
    message = refused(run, pair)
    assert "out of step with the head's angles" in message
    assert "pixels apart" in message


def test_another_heads_calibration(run: Run, pair: Path) -> None:
    text = (pair / "head.yaml").read_text()
    (pair / "head.yaml").write_text(text.replace("head: clopema", "head: prague", 1))
    assert "of head 'prague'" in refused(run, pair)


def test_a_stale_calibration(run: Run, pair: Path) -> None:
    text = (pair / "head.yaml").read_text().replace("date: '2026", "date: '2126")
    (pair / "head.yaml").write_text(text)
    nominal_calibration().save(pair / "calibration.yaml")
    assert "days old when the pair was taken" in refused(run, pair)


def test_no_calibration(run: Run, pair: Path) -> None:
    lines = (pair / "head.yaml").read_text().splitlines()
    named = ["calibration: lost.yaml" if "calibration:" in line else line for line in lines]
    (pair / "head.yaml").write_text("\n".join(named) + "\n")
    assert "no such calibration" in refused(run, pair)


def test_angles_beyond_the_limits(run: Run, pair: Path) -> None:
    lines = (pair / "head.yaml").read_text().splitlines()
    wide = ["  tilt: 0.9" if "tilt" in line else line for line in lines]
    (pair / "head.yaml").write_text("\n".join(wide) + "\n")
    assert "left eye: tilt 0.9000 rad is beyond its limits" in refused(run, pair)


def test_options_that_do_not_go_together(run: Run, pair: Path) -> None:
    assert "--head" in refused(run, pair, "--seed", 1)
    head = ("--head", pair / "head.yaml")
    assert "--yaw: not allowed with two images" in refused(run, pair, *head, "--yaw", 90)
    code, message = run("analyse", pair / "left.png", *head)
    assert code == 2
    assert "LEFT and RIGHT; one file was given" in message
