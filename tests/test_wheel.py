"""The wheel as a user gets it: right import names, nothing forgotten, nothing at the top level."""

import os
import shutil
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import pytest

# The folder in the repository of each subpackage; everything in it belongs to the wheel.
FOLDERS = [
    "flattening",
    "hardware",
    "models",
    "perception",
    "planning",
    "simulation",
    "systems",
    "unwrinkle",
]

pytestmark = [pytest.mark.slow, pytest.mark.alone]


def _run(*command: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    environment = {k: v for k, v in os.environ.items() if not k.startswith("PYTHON")}
    return subprocess.run(
        command, cwd=cwd, env=environment, capture_output=True, text=True, check=False
    )


def _checked(*command: str | Path, cwd: Path) -> str:
    result = _run(*command, cwd=cwd)
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


@pytest.fixture(scope="module")
def wheel(repository: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the sdist from a copy of the sources, and the wheel from the sdist."""
    sources = tmp_path_factory.mktemp("sources")
    for file in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(repository / file, sources)
    for folder in FOLDERS:
        shutil.copytree(
            repository / folder,
            sources / folder,
            symlinks=True,
            ignore=shutil.ignore_patterns("__pycache__"),
        )
    _checked(sys.executable, "-m", "build", "--no-isolation", "--outdir", "dist", cwd=sources)
    (built,) = (sources / "dist").glob("*.whl")
    return built


@pytest.fixture(scope="module")
def environment(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A virtual environment with the wheel, which finds third parties where they are now.

    A `.pth` file lends this environment's packages; the development install of unwrinkle is not
    among them, since the `.pth` files of a lent folder are not read.
    """
    folder = tmp_path_factory.mktemp("environment")
    _checked(sys.executable, "-m", "venv", "--without-pip", folder, cwd=folder)
    python = folder / "bin" / "python"
    (site,) = folder.glob("lib/python*/site-packages")
    (site / "lent.pth").write_text(sysconfig.get_path("purelib") + "\n")
    pip = [sys.executable, "-m", "pip", "--python", python, "install"]
    _checked(*pip, "--no-index", "--no-deps", "--ignore-installed", wheel, cwd=folder)
    return folder


def test_wheel_holds_every_source_file(wheel: Path, repository: Path) -> None:
    expected = set()
    for folder in FOLDERS:
        prefix = "" if folder == "unwrinkle" else "unwrinkle/"
        for path in (repository / folder).rglob("*"):
            if path.is_file() and "__pycache__" not in path.parts:
                expected.add(prefix + path.relative_to(repository).as_posix())
    found = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    assert "unwrinkle/py.typed" in found
    assert found == expected


def test_wheel_holds_no_benchmark(wheel: Path) -> None:
    names = zipfile.ZipFile(wheel).namelist()
    assert not [name for name in names if "benchmark" in name or "robustness" in name]


def test_wheel_carries_the_licence(wheel: Path) -> None:
    names = zipfile.ZipFile(wheel).namelist()
    assert any(name.endswith(".dist-info/licenses/LICENSE") for name in names)


@pytest.mark.parametrize("folder", FOLDERS)
def test_subpackage_is_imported_from_the_wheel(
    folder: str, environment: Path, tmp_path: Path
) -> None:
    name = "unwrinkle" if folder == "unwrinkle" else f"unwrinkle.{folder}"
    python = environment / "bin" / "python"
    origin = _checked(python, "-c", f"import {name}; print({name}.__file__)", cwd=tmp_path)
    assert Path(origin.strip()).is_relative_to(environment)


@pytest.mark.parametrize("folder", ["benchmarks", *(f for f in FOLDERS if f != "unwrinkle")])
def test_folder_is_no_top_level_package(folder: str, environment: Path, tmp_path: Path) -> None:
    result = _run(environment / "bin" / "python", "-c", f"import {folder}", cwd=tmp_path)
    assert result.returncode == 1
    assert f"No module named '{folder}'" in result.stderr


def test_installed_command_says_where_the_benchmarks_are(environment: Path, tmp_path: Path) -> None:
    result = _run(environment / "bin" / "unwrinkle", "bench", "plans", cwd=tmp_path)
    assert result.returncode == 2
    assert "checkout" in result.stderr


def test_installed_command_runs(environment: Path, tmp_path: Path) -> None:
    out = _checked(environment / "bin" / "unwrinkle", "--version", cwd=tmp_path)
    assert out.startswith("unwrinkle ")
