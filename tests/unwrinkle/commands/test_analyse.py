"""`unwrinkle analyse`: its files, and atomic writing."""

import json
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from unwrinkle import cli
from unwrinkle.models.io.loader_yaml import models_dir
from unwrinkle.perception.range_map import RangeMap

TOWEL = models_dir() / "captures" / "towel.npz"


def _main(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    monkeypatch.setattr(sys, "argv", ["unwrinkle", *arguments])
    with pytest.raises(SystemExit) as stop:
        cli.main()
        raise SystemExit(0)
    return int(stop.value.code or 0)


@pytest.mark.slow
def test_towel_gives_report_pictures_and_map(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "deep" / "towel"
    assert _main(monkeypatch, "analyse", str(TOWEL), "--out", str(out)) == 0
    report = json.loads((out / "analysis.json").read_text())
    assert len(report["wrinkles"]) == 3
    assert report["target"]["wrinkle"] == 0
    assert report["wrinkledness"]["point"] is not None
    assert str(tmp_path) not in (out / "analysis.json").read_text()
    assert RangeMap.load(out / "range_map.npz").sensor == "stereo"
    pictures = {path.stem for path in out.glob("*.png")}
    assert pictures == {"panel", "colour", "height", "classes", "ridges", "wrinkledness", "target"}
    for path in out.glob("*.png"):
        picture = cv2.imread(str(path))
        assert picture is not None
        assert min(picture.shape[:2]) > 400
        assert picture.std() > 10.0
    assert {p.name for p in out.iterdir()} == {f"{p}.png" for p in pictures} | {
        "analysis.json",
        "range_map.npz",
    }
    assert list(out.parent.iterdir()) == [out]
    shown = capsys.readouterr().out
    assert "3 wrinkles" in shown
    assert "hand 1: grasp" in shown


def test_bad_input_is_one_line_and_writes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    np.save(tmp_path / "zero.npy", np.zeros((480, 640), np.uint16))
    assert _main(monkeypatch, "analyse", "zero.npy") == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "zero.npy: depth is all zero" in error
    assert [path.name for path in tmp_path.iterdir()] == ["zero.npy"]


def test_failure_half_way_leaves_the_old_results(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise RuntimeError("no ink")

    out = tmp_path / "out"
    out.mkdir()
    (out / "analysis.json").write_text("old")
    monkeypatch.setattr("unwrinkle.runs.pictures.save_pictures", fail)
    monkeypatch.setattr(sys, "argv", ["unwrinkle", "analyse", str(TOWEL), "--out", str(out)])
    with pytest.raises(RuntimeError, match="no ink"):
        cli.main()
    assert (out / "analysis.json").read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (("--at", "12"), "COLUMN,ROW"),
        (("--at", "a,b"), "COLUMN,ROW"),
        (("--region", "1,2,3"), "LEFT,TOP,RIGHT,BOTTOM"),
        (("--region", "0,0,900,100"), "not within the image"),
        (("--depth-unit", "0"), "metres per unit"),
    ],
)
def test_options_of_a_capture_that_do_not_fit(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    options: tuple[str, str],
    named: str,
) -> None:
    np.save(tmp_path / "d.npy", np.full((480, 640), 1000, np.uint16))
    arguments = (str(tmp_path / "d.npy"), "--out", str(tmp_path / "out"), *options)
    assert _main(monkeypatch, "analyse", *arguments) == 2
    assert named in capsys.readouterr().err


def test_options_of_depth_are_none_of_a_pair(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pair = ("l.png", "r.png", "--head", "h.yaml", "--depth-unit", "0.001", "--at", "1,2")
    assert _main(monkeypatch, "analyse", *pair) == 2
    assert "--depth-unit, --at: not allowed" in capsys.readouterr().err
