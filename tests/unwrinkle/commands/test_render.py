"""`unwrinkle render`: the pair, its angles and its true heights are consistent."""

import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from unwrinkle import cli
from unwrinkle.commands.render import truth_of
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.stereo.head_file import load_head_angles
from unwrinkle.perception.stereo.pair import load_pair
from unwrinkle.perception.stereo.range_mapping import range_map_from_pair
from unwrinkle.simulation.rendering.synthetic_towel import wrinkled_towel
from unwrinkle.testing.table import TABLE


def _main(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> int:
    monkeypatch.setattr(sys, "argv", ["unwrinkle", *map(str, arguments)])
    with pytest.raises(SystemExit) as stop:
        cli.main()
        raise SystemExit(0)
    return int(stop.value.code or 0)


@pytest.mark.slow
def test_pair_is_measured_as_its_truth_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "pair"
    code = _main(
        monkeypatch,
        "render",
        "--out",
        out,
        "--seed",
        3,
        "--scale",
        0.25,
        "--gaze-at",
        "-0.05,-1.12",
    )
    assert code == 0
    names = {"left.png", "right.png", "head.yaml", "truth.npz"}
    assert {path.name for path in out.iterdir()} == names
    assert list(tmp_path.iterdir()) == [out]
    assert "analyse" in capsys.readouterr().out
    assert str(tmp_path) not in (out / "head.yaml").read_text()
    pair = load_pair(out / "left.png", out / "right.png")
    assert pair.left.shape == (816, 1232, 3)
    look, calibration = load_head_angles(out / "head.yaml")
    head = calibration.stereo_head()
    for angle in (*look.gaze.left, *look.gaze.right):
        assert angle / head.left.unit.step == pytest.approx(round(angle / head.left.unit.step))
    X_WL, _ = head.poses(look.gaze)
    at = X_WL[:3, 3] + X_WL[:3, 2] * (0.70 - X_WL[2, 3]) / X_WL[2, 2]
    assert at == pytest.approx([-0.05, -1.12, 0.70], abs=0.001)
    measured = range_map_from_pair(pair, head, look.gaze, table=TABLE)
    truth = RangeMap.load(out / "truth.npz")
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


def test_truth_is_the_towel_on_whole_multiples_of_the_resolution() -> None:
    towel = wrinkled_towel(4)
    truth = truth_of(towel, 0.002)
    np.testing.assert_allclose(truth.origin / 0.002, np.rint(truth.origin / 0.002), atol=1e-6)
    low_x, high_x, low_y, high_y = truth.extent
    assert low_x < -0.28 < 0.28 < high_x and low_y < -1.38 < -0.82 < high_y
    top = truth.cell_from_world(np.array(towel.ridges[0].centre)).round().astype(int)
    assert truth.height[top[1], top[0]] == pytest.approx(0.023, abs=0.0005)
    assert truth.garment.sum() * 0.002**2 == pytest.approx(towel.side**2, rel=0.01)
    assert not truth.height[~truth.garment].any()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--garment", "sock"], "'sock': unknown; known are towel, flat"),
        (["--texture", "silk"], "'silk': unknown"),
        (["--scale", "0.3"], "scale 0.3"),
        (["--gaze-at", "0"], "give X,Y"),
        (["--gaze-at", "nan,0"], "give X,Y"),
        (["--gaze-at", "0,3"], "left eye"),
    ],
)
def test_bad_options_are_one_line_and_leave_nothing(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    options: list[str],
    words: str,
) -> None:
    assert _main(monkeypatch, "render", "--out", tmp_path / "pair", *options) == 2
    message = capsys.readouterr().err
    assert message.count("\n") == 1 and words in message, message
    assert list(tmp_path.iterdir()) == []
