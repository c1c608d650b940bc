"""Bad input at the command line: one clear line, the right exit code, nothing left behind."""

import json
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from unwrinkle import cli
from unwrinkle.models.io.archive import load_archive, save_archive
from unwrinkle.models.robot import model_file

Run = Callable[..., tuple[int, str]]

pytestmark = pytest.mark.end_to_end

TOWEL = model_file("captures/towel.npz")


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Run:
    """Run a command in an empty folder; return the exit code and stderr."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments: object) -> tuple[int, str]:
        monkeypatch.setattr(sys, "argv", ["unwrinkle", *map(str, arguments)])
        with pytest.raises(SystemExit) as stop:
            cli.main()
        code = 0 if stop.value.code is None else stop.value.code
        assert isinstance(code, int)
        return code, capsys.readouterr().err

    return call


def refused(run: Run, code: int, *arguments: object) -> str:
    """Return the single line of the error; nothing may be written."""
    before = sorted(Path().rglob("*"))
    got, message = run(*arguments)
    assert got == code, message
    assert message.startswith("unwrinkle: ") and message.count("\n") == 1, message
    assert sorted(Path().rglob("*")) == before
    return message


def depth_png(name: str, depth: np.ndarray) -> Path:
    path = Path(name)
    cv2.imwrite(str(path), depth.astype(np.uint16))
    return path


def table(rows: int = 480, columns: int = 640) -> np.ndarray:
    """Return the depth of an empty table from 1 m, with noise, mm."""
    rng = np.random.default_rng(0)
    return np.round(1000 + rng.normal(0.0, 1.0, (rows, columns)))


def garment(depth: np.ndarray) -> np.ndarray:
    """Return a depth image with a folded thick cloth in the middle, mm."""
    out = depth.copy()
    rows, columns = np.mgrid[0 : depth.shape[0], 0 : depth.shape[1]]
    cloth = (np.abs(rows - 240) < 110) & (np.abs(columns - 320) < 110)
    out[cloth] -= 12 + 22 * np.exp(-0.5 * ((columns[cloth] - 320) / 14) ** 2)
    return out


@pytest.mark.parametrize("command", ["analyse", "plan"])
def test_missing_and_damaged_files(run, command):
    assert "no such file" in refused(run, 2, command, "absent.png")
    Path("depth.png").write_bytes(b"\x89PNG\r\n\x1a\n" + b"\0" * 100)
    assert "depth.png" in refused(run, 2, command, "depth.png")
    Path("cut.npz").write_bytes(TOWEL.read_bytes()[:20_000])
    assert "cut.npz" in refused(run, 2, command, "cut.npz")
    Path("notes.txt").write_text("hello")
    assert "notes.txt" in refused(run, 2, command, "notes.txt")


def test_arrays_that_are_no_depth_image(run):
    assert "shape" in refused(run, 2, "plan", depth_png("small.png", table(100, 100)))
    np.save("cube.npy", np.ones((4, 480, 640)))
    refused(run, 2, "plan", "cube.npy")
    np.save("words.npy", np.array(["a", "b"]))
    refused(run, 2, "plan", "words.npy")
    np.save("pickled.npy", np.array([{"a": 1}], dtype=object), allow_pickle=True)
    refused(run, 2, "plan", "pickled.npy")


def test_images_without_a_reading(run):
    assert "zero.png" in refused(run, 2, "plan", depth_png("zero.png", 0 * table()))
    np.save("nan.npy", np.full((480, 640), np.nan, dtype=np.float32))
    assert "nan.npy" in refused(run, 2, "plan", "nan.npy")


def test_too_many_holes_are_an_insufficient_view(run):
    rng = np.random.default_rng(1)
    depth = garment(table())
    depth[rng.uniform(size=depth.shape) < 0.8] = 0
    assert "insufficient view" in refused(run, 2, "plan", depth_png("holes.png", depth))


def test_thirty_percent_holes_still_work(run):
    rng = np.random.default_rng(1)
    depth = garment(table())
    depth[rng.uniform(size=depth.shape) < 0.3] = 0
    path = depth_png("holes.png", depth)
    code, message = run("analyse", path, "--no-pictures", "--out", "result")
    assert code == 0, message
    report = json.loads(Path("result/analysis.json").read_text())
    assert report["wrinkles"], "the fold in the middle must be found"


def test_no_garment(run):
    message = refused(run, 2, "plan", depth_png("empty.png", table()))
    assert "no garment" in message


def test_absurd_intrinsics_and_unknown_keys(run):
    depth_png("depth.png", garment(table()))
    camera = (
        "name: odd\nwidth: 640\nheight: 480\nfx: {fx}\nfy: 525\ncx: 320\ncy: 240\nsensor: xtion\n"
    )
    Path("odd.yaml").write_text(camera.format(fx=-5))
    assert "odd.yaml" in refused(run, 2, "plan", "depth.png", "--camera", "odd.yaml")
    Path("odd.yaml").write_text(camera.format(fx=525) + "focal: 3\n")
    assert "focal" in refused(run, 2, "plan", "depth.png", "--camera", "odd.yaml")
    assert "xtion-pro-live" in refused(run, 2, "plan", "depth.png", "--camera", "xtino")


def test_bad_options(run):
    assert "mode" in refused(run, 2, "plan", TOWEL, "--mode", "feet")
    assert "speed" in refused(run, 2, "plan", TOWEL, "--speed", "1.5")
    assert "arms" in refused(run, 2, "plan", TOWEL, "--arms", "both", "--no-pictures")
    Path("site.scenario.yaml").write_text("Lab: {tabel: {}}\n")
    message = refused(run, 2, "plan", TOWEL, "--scenario", "site.scenario.yaml")
    assert "'tabel'; did you mean table" in message
    Path("lab.site.yaml").write_text("name: lab\n")
    assert "is a site" in refused(run, 2, "plan", TOWEL, "--scenario", "lab.site.yaml")
    assert "is a folder" in refused(run, 2, "verify", ".")
    assert "fraction" in refused(run, 2, "execute", "plan.npz", "--site", "x", "--speed", "50")
    Path("taken").write_text("a file")
    assert "taken" in refused(run, 2, "analyse", TOWEL, "--no-pictures", "--out", "taken")


def moved(name: str, x: float, y: float, z: float = 0.0) -> Path:
    """Return a capture of the shipped towel with another camera pose."""
    header, arrays = load_archive(TOWEL)
    pose = arrays["X_WC"].copy()
    pose[:3, 3] += [x, y, z]
    save_archive(name, header, {**arrays, "X_WC": pose})
    return Path(name)


def test_garment_over_the_edge_or_beside_the_table_has_no_plan(run):
    over = refused(run, 3, "plan", moved("edge.npz", 0.35, 0.0), "--no-pictures")
    assert "was not seen" in over  # the map ends at the table's edge, as in the closed loop
    away = refused(run, 2, "plan", moved("away.npz", 0.0, -1.5), "--no-pictures")
    assert "the table is not in view" in away


@pytest.mark.parametrize(("by", "words"), [(0.012, "mm above"), (-0.046, "mm below")])
def test_a_table_of_another_height_is_refused_with_the_difference(run, by, words):
    message = refused(run, 2, "plan", moved("pose.npz", 0.0, 0.0, by), "--no-pictures")
    assert words in message and "camera's pose" in message
    assert f"{1e3 * abs(by):.0f} mm" in message


@pytest.fixture(scope="module")
def towel_plan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A plan of the shipped towel, made at the command line."""
    folder = tmp_path_factory.mktemp("towel")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            sys,
            "argv",
            ["unwrinkle", "plan", str(TOWEL), "--no-pictures", "--out", str(folder / "out")],
        )
        with pytest.raises(SystemExit) as stop:
            cli.main()
    assert not stop.value.code
    return folder / "out" / "plan.npz"


def test_the_shipped_towel_gives_a_plan_a_verdict_and_a_page(run, towel_plan):
    folder = towel_plan.parent
    assert json.loads((folder / "verdict.json").read_text())["passed"] is True
    page = (folder / "preview.html").read_text()
    assert load_archive(towel_plan)[0]["content_hash"] in page
    assert len(page) < 10_000_000
    assert {p.name for p in folder.iterdir()} >= {"analysis.json", "range_map.npz"}
    code, message = run("verify", towel_plan)
    assert code == 0, message


def test_a_plan_from_elsewhere_is_made_and_verified_there(run):
    start = "0.2,0.3,0,0,0,0,0,-0.3,0,0,0,0,0"
    code, message = run("plan", TOWEL, "--no-pictures", "--start", start, "--out", "out")
    assert code == 0, message
    assert json.loads(Path("out/verdict.json").read_text())["passed"] is True
    assert run("verify", "out/plan.npz", "--start", start)[0] == 0
    assert run("verify", "out/plan.npz")[0] == 3


def test_a_start_that_is_none_is_refused_before_anything_is_done(run):
    for start in ("nowhere", "0,0", "inf" + 12 * ",0"):
        assert "13 finite angles" in refused(run, 2, "plan", TOWEL, "--start", start)


@pytest.mark.parametrize("command", ["verify", "preview"])
def test_plan_files_that_cannot_be_trusted(run, towel_plan, command):
    options = ["--html", "page.html"] if command == "preview" else []
    assert "no such file" in refused(run, 2, command, "absent.npz", *options)
    data = bytearray(towel_plan.read_bytes())
    data[len(data) // 2] ^= 1
    Path("flipped.npz").write_bytes(bytes(data))
    assert "flipped.npz" in refused(run, 2, command, "flipped.npz", *options)
    header, arrays = load_archive(towel_plan)
    damaged = {**header, "events": [{**header["events"][0], "dwell": None}, header["events"][1]]}
    save_archive("dwell.npz", damaged, arrays)
    assert "events[0].dwell" in refused(run, 2, command, "dwell.npz", *options)
    save_archive("edited.npz", {**header, "speed": 0.5}, arrays)
    assert "hash" in refused(run, 2, command, "edited.npz", *options)
    save_archive("new.npz", {**header, "version": 99}, arrays)
    assert "version 99" in refused(run, 2, command, "new.npz", *options)
    Path("other.scenario.yaml").write_text("Lab: {gripper: {opening: 0.02}}\n")
    message = refused(run, 2, command, towel_plan, "--scenario", "other.scenario.yaml", *options)
    assert "another model of the cell" in message


def test_a_flat_garment_needs_no_plan_and_keeps_none(run):
    """Regression: an earlier run's plan stayed beside the analysis of a flat garment."""
    rows, columns = np.mgrid[0:480, 0:640]
    flat = table() - 8.0 * ((np.abs(rows - 240) < 110) & (np.abs(columns - 320) < 110))
    Path("result").mkdir()
    Path("result/plan.npz").write_text("of an earlier run")
    Path("result/notes.txt").write_text("of the user")
    code, message = run("plan", depth_png("flat.png", flat), "--no-pictures", "--out", "result")
    assert code == 0, message
    assert {path.name for path in Path("result").iterdir()} == {
        "analysis.json",
        "range_map.npz",
        "notes.txt",
    }
