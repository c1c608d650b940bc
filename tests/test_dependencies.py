"""What the package imports is what it declares."""

import re
import sys
import tomllib
from pathlib import Path

import grimp
import pytest

#: Distributions that are imported by another name than their own.
IMPORT_NAMES = {
    "drake": "pydrake",
    "foxglove-sdk": "foxglove",
    "lazy-loader": "lazy_loader",
    "opencv-python-headless": "cv2",
    "pyserial": "serial",
    "python-can": "can",
    "pyyaml": "yaml",
    "rerun-sdk": "rerun",
}


@pytest.fixture(scope="module")
def graph() -> grimp.ImportGraph:
    return grimp.build_graph(
        "unwrinkle", "benchmarks", include_external_packages=True, cache_dir=None
    )


def test_every_third_party_import_is_a_declared_dependency(
    graph: grimp.ImportGraph, repository: Path
) -> None:
    project = tomllib.loads((repository / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    requirements = sum((extras[name] for name in extras if name != "dev"), project["dependencies"])
    names = {re.match(r"[\w-]+", requirement).group() for requirement in requirements}
    declared = {IMPORT_NAMES.get(name, name) for name in names}
    used = {name for name in graph.modules if graph.is_module_squashed(name)}
    assert "pydrake" in used
    assert used - set(sys.stdlib_module_names) <= declared


#: Test folders that may import the benchmarks: their own tests, and the page of the faults.
BENCHMARK_TESTS = {"benchmarks", "robustness"}


def test_no_other_test_imports_the_benchmarks(repository: Path) -> None:
    tests = repository / "tests"
    importing = {
        path.relative_to(tests).parts[0]
        for path in tests.rglob("*.py")
        if re.search(r"^\s*(from|import) benchmarks\b", path.read_text("utf-8"), re.MULTILINE)
    }
    assert importing <= BENCHMARK_TESTS


#: Folders of the package; each folder in them is a room.
FOLDERS = (
    "benchmarks",
    "flattening",
    "hardware",
    "models",
    "perception",
    "planning",
    "simulation",
    "systems",
)


def test_no_room_is_wider_than_fifteen_files(repository: Path) -> None:
    rooms = [
        room
        for folder in (*FOLDERS, "unwrinkle", "tests/robustness")
        for room in [repository / folder, *(repository / folder).rglob("*/")]
        if room.name != "__pycache__" and not any(p.is_symlink() for p in [room, *room.parents])
    ]
    widths = {room: len(list(room.glob("*.py"))) for room in rooms}
    assert len(rooms) > 40
    assert {name: width for name, width in widths.items() if width > 15} == {}
