"""``unwrinkle replay`` as a user runs it, and the live replay."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell
from unwrinkle.report.live import LiveReplay
from unwrinkle.report.tracks import LOOK_TIME
from unwrinkle.runs.folder import RunFolder, RunSettings
from unwrinkle.viewer.scene import start_meshcat

pytestmark = pytest.mark.alone

Main = Callable[..., int]
SETTINGS = RunSettings("towel", "terry", "bunched", 7, "stereo", 0.5, "any", "foot", 10)


@pytest.mark.end_to_end
def test_replay_writes_both_pages_of_a_killed_run(
    main: Main, synthetic_run: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = synthetic_run.write(tmp_path / "killed", status="running")
    before = {path: path.read_bytes() for path in run.path.rglob("*") if path.is_file()}
    assert main("replay", run.path) == 0
    out = capsys.readouterr().out
    for name in ("replay", "report"):
        page = run.path / f"{name}.html"
        assert f"{name}  {page}" in out
        assert page.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    assert all(path.read_bytes() == content for path, content in before.items())


def test_replay_opens_the_page_if_asked(
    main: Main, synthetic_run: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = synthetic_run.write(tmp_path / "run")
    opened: list[str] = []
    monkeypatch.setattr("typer.launch", opened.append)
    assert main("replay", run.path, "--open") == 0
    assert opened == [(run.path / "replay.html").resolve().as_uri()]


def _no_folder(path: Path) -> None:
    assert not path.exists()


def _no_run(path: Path) -> None:
    path.mkdir()


def _damaged(path: Path) -> None:
    RunFolder.create(path, SETTINGS)
    (path / "run.json").write_text('{"format"')


def _no_look(path: Path) -> None:
    RunFolder.create(path, SETTINGS)


def _bad_scenario(path: Path) -> None:
    scenario = "Glasgow:\n  sped: 1.0\n"
    RunFolder.create(path, RunSettings(**{**SETTINGS.to_json(), "scenario": scenario}))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (_no_folder, "no such folder; give the folder of a run"),
        (_no_run, "run.json is missing"),
        (_damaged, "run.json: cannot be read as JSON"),
        (_no_look, "ended before its first look"),
        (_bad_scenario, "sped"),
    ],
)
@pytest.mark.parametrize("options", [(), ("--live",)])
def test_replay_refuses_what_is_no_run(
    main: Main,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    make: Callable[[Path], None],
    message: str,
    options: tuple[str, ...],
) -> None:
    path = tmp_path / "run"
    make(path)
    assert main("replay", path, *options) == 2
    error = capsys.readouterr().err
    assert message in error
    assert str(path) in error
    assert error.count("\n") == 1
    assert list(tmp_path.rglob("*.html")) == []


# ---------------------------------------------------------------- live


def _click(meshcat: Any, name: str) -> None:
    """Return the message of a click, as msgpack."""
    text = name.encode()
    message = b"\x82\xa4type\xa6button\xa4name\xd9" + bytes([len(text)]) + text
    meshcat._InjectWebsocketMessage(message=message)


def _visible(meshcat: Any, path: str) -> bool:
    packed = bytes(meshcat._GetPackedProperty(f"/drake/{path}", "visible"))
    return packed.endswith(b"\xc3")


def test_live_replay_plays_jumps_and_stops(synthetic_run: Any, cell: Cell, tmp_path: Path) -> None:
    run = synthetic_run.write(tmp_path / "run")
    meshcat = start_meshcat()
    player = LiveReplay(run, cell, meshcat)
    motion = run.look(0).motion()
    second = LOOK_TIME + motion.end - motion.begin
    assert player.duration > 2.0 * second
    assert f"action 2: {second:.1f} s" in meshcat.GetButtonNames()
    assert meshcat.HasPath("loop/cloth")
    assert meshcat.HasPath("loop/left eye")
    assert _visible(meshcat, "run/look 0")
    assert not _visible(meshcat, "run/look 1")

    body = "/drake/illustration/r1/link_7"
    place = meshcat._GetPackedTransform(body)
    assert player.update(LOOK_TIME + 0.5) == pytest.approx(LOOK_TIME + 0.5)  # it opens playing
    assert meshcat._GetPackedTransform(body) != place
    meshcat.SetSliderValue("speed", 2.0)
    assert player.update(0.1) == pytest.approx(LOOK_TIME + 0.7)
    _click(meshcat, f"action 2: {second:.1f} s")
    assert player.update(0.0) == pytest.approx(second)
    assert _visible(meshcat, "run/look 1")
    assert not _visible(meshcat, "run/look 0")
    _click(meshcat, "play / pause")
    assert player.update(1.0) == pytest.approx(second)
    cloth = meshcat._GetPackedObject("loop/cloth")
    meshcat.SetSliderValue("time (s)", player.duration)
    assert player.update(1.0) == pytest.approx(player.duration)
    assert meshcat._GetPackedObject("loop/cloth") != cloth
    _click(meshcat, "play / pause")
    assert player.update(1.0) == 0.0  # it restarts


def test_live_replay_runs_until_it_is_told_to_stop(
    synthetic_run: Any, cell: Cell, tmp_path: Path
) -> None:
    run = synthetic_run.write(tmp_path / "killed", status="running")
    (run.path / "cloth.npz").unlink()
    player = LiveReplay(run, cell, start_meshcat())
    asked: list[float] = []

    def stop() -> bool:
        asked.append(player.update(0.0))
        return len(asked) > 3

    player.run(stop)
    assert asked[0] == 0.0
    assert np.all(np.diff(asked) >= 0.0)
    assert asked[-1] > 0.0
    with pytest.raises(InputError, match="ended before its first look"):
        LiveReplay(RunFolder.create(tmp_path / "empty", SETTINGS), cell, start_meshcat())
