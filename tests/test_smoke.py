"""Short run of everything, for each Python version: modules, commands, one plan, one loop.

`make smoke PYTHON=...` runs it with that interpreter's own versions of Drake and NumPy; the whole
suite runs with one interpreter.
"""

import json
import subprocess
import sys
from pathlib import Path

import pytest
import typer
import typer.testing

from unwrinkle import cli
from unwrinkle.models.io.loader_yaml import models_dir
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.runs.folder import RunFolder

pytestmark = pytest.mark.smoke

#: Imports every module of the package; prints how many.
_IMPORT_ALL = """
import importlib, pkgutil, unwrinkle
names = [m.name for m in pkgutil.walk_packages(unwrinkle.__path__, "unwrinkle.")]
for name in names:
    if not name.endswith("__main__"):
        importlib.import_module(name)
print(len(names))
"""


def _commands() -> list[tuple[str, ...]]:
    """Return the path of each command and each group of commands."""

    def walk(command: object, path: tuple[str, ...]) -> list[tuple[str, ...]]:
        inner = getattr(command, "commands", {})
        return [path] + [p for name, each in inner.items() for p in walk(each, (*path, name))]

    return walk(typer.main.get_command(cli.app), ())


def _run(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-W", "error", "-m", "unwrinkle", *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


def test_every_module_imports_without_a_warning() -> None:
    command = [sys.executable, "-W", "error", "-c", _IMPORT_ALL]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 300


@pytest.mark.parametrize("command", _commands(), ids=" ".join)
def test_every_command_has_help(command: tuple[str, ...]) -> None:
    result = typer.testing.CliRunner().invoke(cli.app, [*command, "--help"])
    assert result.exit_code == 0, result.output
    assert "Usage" in result.output


def test_a_plan_is_made_and_verified(tmp_path: Path) -> None:
    capture = models_dir() / "captures" / "towel.npz"
    done = _run(tmp_path, "plan", str(capture), "--out", "plan")
    assert done.returncode == 0, done.stderr
    plan = FlatteningPlan.load(tmp_path / "plan" / "plan.npz")
    verdict = json.loads((tmp_path / "plan" / "verdict.json").read_text())
    assert verdict["plan_hash"] == plan.content_hash
    again = _run(tmp_path, "verify", "plan/plan.npz")
    assert again.returncode == 0, again.stderr


def test_a_loop_acts_once(tmp_path: Path) -> None:
    scenario = "Small:\n  station: {garment: {nodes: 40}}\n"
    (tmp_path / "small.scenario.yaml").write_text(scenario, encoding="utf-8")
    done = _run(
        tmp_path,
        *("flatten", "--no-live", "--scenario", "small.scenario.yaml", "--start", "ridge"),
        *("--sensor", "xtion", "--station", "loopback", "--actions", "1", "--out", "run"),
    )
    assert done.returncode in (0, 3), done.stderr + done.stdout
    first = RunFolder.open(tmp_path / "run").looks()[0]
    assert first.action().outcome == "done"
    assert first.action().violations == ()
