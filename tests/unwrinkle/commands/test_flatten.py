"""`unwrinkle flatten`: bad input, faults, interrupts, resuming; the whole loop at small scale."""

import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from unwrinkle import cli
from unwrinkle.closed_loop.recorder import Recorder
from unwrinkle.closed_loop.run import FlatteningRun, Seconds
from unwrinkle.closed_loop.session import Choices, Session, begin_run, resume_run
from unwrinkle.closed_loop.setup import open_loop, scenario_text, with_choices
from unwrinkle.closed_loop.station_view import StationView
from unwrinkle.flattening.execution.state import Phase
from unwrinkle.flattening.state import SupervisorState
from unwrinkle.models.errors import InputError
from unwrinkle.models.scenario import load_scenario
from unwrinkle.runs.folder import RunFolder
from unwrinkle.systems.station.world import StationFaults

Run = Callable[..., tuple[int, str]]
SMALL = "station: {garment: {nodes: 40, start: ridge}}"


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Run:
    monkeypatch.chdir(tmp_path)

    def call(*arguments: object) -> tuple[int, str]:
        monkeypatch.setattr(sys, "argv", ["unwrinkle", "flatten", *map(str, arguments)])
        with pytest.raises(SystemExit) as stop:
            cli.main()
        captured = capsys.readouterr()
        return int(stop.value.code or 0), captured.err + captured.out

    return call


def scenario_file(text: str) -> Path:
    path = Path("site.scenario.yaml")
    path.write_text(f"Site:\n  {text}\n", encoding="utf-8")
    return path


class At:
    """Watcher with one action when the supervisor enters a state for the n-th time."""

    def __init__(self, mode: str, count: int, action: Callable[[], None]) -> None:
        self.mode, self.count, self.action = mode, count, action

    def update(
        self, before: SupervisorState, now: SupervisorState, station: StationView, seconds: Seconds
    ) -> None:
        if now.mode == self.mode != before.mode:
            self.count -= 1
        if self.count == 0 and (
            now.execution.phase == Phase.MOVING or self.mode not in ("move", "grip")
        ):
            self.count = -1
            self.action()


def interrupt() -> None:
    os.kill(os.getpid(), signal.SIGINT)


def at_rest(station: StationView) -> bool:
    return bool(np.abs(station.velocities).max() < 2e-3)


@pytest.mark.parametrize(
    ("text", "options", "words"),
    [
        ("loop: {pace: 3}", (), "pace"),
        ("table: {size: [0.4, 0.4]}", (), "larger than the table"),
        ("station: {garment: {material: chainmail}}", (), "chainmail"),
        ("speed: 1.0", ("--garment", "sock"), "sock"),
        ("speed: 1.0", ("--sensor", "sonar"), "sonar"),
        ("speed: 1.0", ("--scale", "0.3"), "0.3"),
        ("speed: 1.0", ("--resume", "elsewhere"), "uses the scenario"),
    ],
)
def test_bad_input_is_refused(run: Run, text: str, options: tuple[str, ...], words: str) -> None:
    path = scenario_file(text)
    code, said = run("--scenario", path, "--no-live", *options)
    assert code == 2 and words in said
    assert [item.name for item in Path().iterdir()] == [path.name]


def test_going_on_with_nothing(run: Run) -> None:
    assert run("--resume", "nowhere")[0] == 2
    code, said = run("--resume", "nowhere", "--seed", "3")
    assert code == 2 and "--seed" in said


def test_scenario_text_is_the_scenario(tmp_path: Path) -> None:
    chosen = with_choices(
        load_scenario(),
        garment="tshirt",
        sensor="xtion",
        actions=3,
        mode="between",
        order="together",
    )
    path = tmp_path / "scenario.yaml"
    path.write_text(scenario_text(chosen), encoding="utf-8")
    assert load_scenario(path) == chosen and chosen.sensor.kind == "depth"
    assert (chosen.loop.mode, chosen.loop.order) == ("between", "together")


@pytest.mark.slow
@pytest.mark.end_to_end
def test_flat_towel_needs_no_action(run: Run) -> None:
    path = scenario_file(SMALL)
    options = (
        "--scenario",
        path,
        "--start",
        "flat",
        "--scale",
        "0.25",
        "--no-live",
        "--out",
        "run",
    )
    code, said = run(*options)
    assert code == 0 and "0 actions" in said, said
    folder = RunFolder.open("run")
    assert folder.status == "flat" and folder.figures["actions"] == 0
    assert folder.look(0).action().outcome == "flat"
    assert (folder.path / "report.html").is_file()


@pytest.fixture
def small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Session]:
    monkeypatch.chdir(tmp_path)

    def session(**choices: object) -> Session:
        chosen = Choices(scale=0.25, **choices)  # type: ignore[arg-type]
        return begin_run(chosen, scenario_file(SMALL), Path("run"))

    return session


@pytest.mark.slow
@pytest.mark.end_to_end
def test_interrupt_while_pulling_then_going_on(small: Callable[..., Session]) -> None:
    session = small(sensor="truth")
    seen: list[bool] = []

    class Ended:
        def update(
            self,
            before: SupervisorState,
            now: SupervisorState,
            station: StationView,
            seconds: Seconds,
        ) -> None:
            if now.over:
                seen.append(at_rest(station))

    ending = session.run((At("move", 2, interrupt), Ended()))
    assert ending.status == "interrupted" and "SIGINT" in session.folder.reason
    assert seen == [True]
    folder = RunFolder.open("run")
    assert folder.status == "interrupted" and folder.last_complete() is None
    assert folder.look(0).motion().segments[0].name == "approach"

    again = resume_run(Path("run"), Choices(actions=2)).run()
    assert again.status in ("flat", "stopped")
    folder = RunFolder.open("run")
    last = folder.last_complete()
    assert last is not None and last >= 1
    for look in folder.looks()[:last]:
        record, verdict = look.action(), look.verdict()
        assert verdict["passed"] and verdict["plan_hash"] == look.plan().content_hash
        assert record.following_error is not None and record.following_error < 1e-3
        assert record.outcome in ("done", "missed")
    with pytest.raises(InputError, match="cannot change when a run is resumed"):
        resume_run(Path("run"), Choices(garment="tshirt"))


@pytest.mark.slow
def test_a_disk_that_is_full_ends_at_rest(
    small: Callable[..., Session], monkeypatch: pytest.MonkeyPatch
) -> None:
    session = small(sensor="truth")
    stations: list[StationView] = []

    def full(self: Recorder, now: SupervisorState) -> None:
        raise InputError("cannot write plan.npz: no space left on device")

    class Keep:
        def update(
            self,
            before: SupervisorState,
            now: SupervisorState,
            station: StationView,
            seconds: Seconds,
        ) -> None:
            stations[:] = [station]

    monkeypatch.setattr(Recorder, "_confirmed", full)
    with pytest.raises(InputError, match="no space left"):
        session.run((Keep(),))
    folder = RunFolder.open("run")
    assert folder.status == "fault" and "no space left" in folder.reason
    assert at_rest(stations[0]) and stations[0].time < 10.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cameras", "words"),
    [({1: "nothing", 2: "nothing"}, "returned no image"), ({1: "black", 2: "noise"}, "2 looks")],
)
def test_cameras_that_fail_twice(cameras: dict[int, str], words: str) -> None:
    scenario = with_choices(load_scenario(), start="flat", scale=0.125)
    with open_loop(scenario, faults=StationFaults(cameras=cameras)) as loop:
        ending = FlatteningRun(loop).run()
    assert ending.status == "stopped" and words in ending.reason
    assert ending.supervisor_state.policy_state.actions == 0
