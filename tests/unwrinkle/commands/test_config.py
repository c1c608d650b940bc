"""`unwrinkle config` and `--set`: sources, precedence, output that loads again."""

from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from unwrinkle.models.scenario import load_scenario, shipped_scenario
from unwrinkle.site.sites import find_site

Main = Callable[..., int]


def sources(text: str) -> dict[str, str]:
    """Return the source of each last key, of a printed configuration."""
    rows = [line.partition("#") for line in text.splitlines()[1:] if "#" in line]
    return {row[0].split(":")[0].strip(): row[2].strip() for row in rows}


def test_the_output_is_a_scenario(
    main: Main, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main("config", "--set", "loop.mode=paper", "--set", "gaze=[0.1, -0.2]") == 0
    text = capsys.readouterr().out
    file = tmp_path / "mine.scenario.yaml"
    file.write_text(text)
    assert load_scenario(file) == load_scenario(settings=("loop.mode=paper", "gaze=[0.1, -0.2]"))
    found = sources(text)
    assert found["mode"] == found["gaze"] == "--set"
    assert found["order"] == shipped_scenario().name


def test_sources_of_a_file_that_leaves_things_out(
    main: Main, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "lab.scenario.yaml"
    file.write_text("A: {}\nB:\n  speed: 0.4\n  clearance: {arm_arm: 0.05}\n")
    assert main("config", "--scenario", file, "--name", "B", "--set", "speed=0.3") == 0
    text = capsys.readouterr().out
    found = sources(text)
    assert (found["speed"], found["arm_arm"], found["arm_table"]) == ("--set", file.name, "default")
    assert yaml.safe_load(text)["B"]["speed"] == 0.3


def test_the_output_is_a_site(
    main: Main, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main("config", "--site", "loopback", "--set", "controller.lead=0.1") == 0
    text = capsys.readouterr().out
    file = tmp_path / "mine.site.yaml"
    file.write_text(text)
    assert find_site(file) == find_site("loopback", settings=("controller.lead=0.1",))
    assert sources(text)["lead"] == "--set"


@pytest.mark.parametrize(
    "arguments",
    [
        ["--set", "loop.mod=paper"],
        ["--set", "loop.mode=papers"],
        ["--set", "loop.actions=many"],
        ["--site", "loopback", "--scenario", "a.yaml"],
        ["--site", "nowhere"],
        ["--scenario", "missing.yaml"],
    ],
)
def test_refusals(main: Main, arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main("config", *arguments) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("unwrinkle: ")


def test_an_option_wins_over_set_and_set_over_the_file(
    main: Main, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = {}

    def stop(options: object, cell: object) -> None:
        import dataclasses as dc

        rules = cell.scenario.loop
        mode = options.mode if options.mode is not None else rules.mode
        found.update(dc.asdict(dc.replace(rules, mode=mode)))
        raise KeyboardInterrupt

    monkeypatch.setattr("unwrinkle.commands.analyse.flattener_for", stop)
    file = tmp_path / "lab.scenario.yaml"
    file.write_text("A:\n  loop: {mode: between, order: height, actions: 4}\n")
    chosen = ("--scenario", file, "--set", "loop.mode=paper", "--set", "loop.order=pull")
    assert main("analyse", "depth.png", *chosen, "--mode", "foot") == 130
    assert (found["mode"], found["order"], found["actions"]) == ("foot", "pull", 4)


def test_a_resumed_run_keeps_its_settings(main: Main, tmp_path: Path) -> None:
    assert main("flatten", "--resume", tmp_path, "--set", "speed=0.5") == 2
