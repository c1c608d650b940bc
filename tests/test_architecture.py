"""The import arrows of docs/architecture.md, and a few house rules, read from the sources."""

import ast
import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[1]

# What each folder may import of ours. An entry with a dot allows that module alone.
_LOWER = {"models", "perception", "planning", "simulation", "hardware"}
_WIRE = {"hardware.wire", "hardware.link"}
_VALUE_TYPES = {"perception.range_map", "perception.target", "perception.wrinkle"}
ALLOWED = {
    "models": set(),
    "perception": {"models"},
    "planning": {"models", *_VALUE_TYPES},
    "simulation": {"models", "perception.camera", "perception.depth_file", *_WIRE},
    "hardware": {"models", "planning.sent", "planning.trajectory"},
    "systems": _LOWER,
    "benchmarks": _LOWER | {"systems"},
    "unwrinkle": _LOWER | {"systems", "benchmarks"},
}
# Third parties that a folder must do without.
FORBIDDEN = {
    "perception": {"pydrake"},
    "planning": {"pydrake.systems"},
    "hardware": {"pydrake"},
}
# Where a distribution is imported by another name than its own.
IMPORT_NAMES = {
    "drake": "pydrake",
    "opencv-python-headless": "cv2",
    "pyserial": "serial",
    "python-can": "can",
    "pyyaml": "yaml",
}
FACE_ONLY = {"rich", "typer"}  # belong to the command line

MODULES = sorted(
    path.relative_to(REPOSITORY).as_posix()
    for folder in ALLOWED
    for path in (REPOSITORY / folder).rglob("*.py")
)
TESTS = sorted(p.relative_to(REPOSITORY).as_posix() for p in REPOSITORY.glob("tests/**/*.py"))


def _below(name: str, roots: set[str]) -> bool:
    return any(name == root or name.startswith(root + ".") for root in roots)


def _imports(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield (line, dotted name) for all that is imported anywhere in the module."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield node.lineno, alias.name
        elif isinstance(node, ast.ImportFrom):
            for alias in node.names:
                yield node.lineno, f"{'.' * node.level}{node.module or ''}.{alias.name}"


def _arrow_fault(folder: str, name: str) -> str | None:
    """Say what is wrong with importing `name` in `folder`; None if nothing is."""
    top, _, inner = name.partition(".")
    if name.startswith("."):
        return f"relative import {name}"
    if name.endswith(".*"):
        return f"star import {name}"
    if top in ALLOWED and top != "unwrinkle":
        return f"{name} without the leading 'unwrinkle.'"
    if _below(name, {"pydrake.all"}):
        return "pydrake.all"
    if _below(name, FORBIDDEN.get(folder, set())):
        return f"{folder} must do without {name}"
    if top in FACE_ONLY and folder != "unwrinkle":
        return f"{top} outside the command line"
    if top != "unwrinkle" or folder == "unwrinkle":
        return None
    if not _below(inner, ALLOWED[folder] | {folder}):
        return f"no arrow from {folder} to {name}"
    return None


def faults(path: str, source: str) -> list[str]:
    """Return every broken rule in the module at `path` (relative to the repository)."""
    folder = Path(path).parts[0]
    tree = ast.parse(source)
    found = [
        f"{path}:{line}: {fault}"
        for line, name in _imports(tree)
        if (fault := _arrow_fault(folder, name))
    ]
    if folder != "unwrinkle":
        found += [
            f"{path}:{node.lineno}: print outside the command line"
            for node in ast.walk(tree)
            if isinstance(node, ast.Call)
            and isinstance(node.func, ast.Name)
            and node.func.id == "print"
        ]
    return found


def empty_tests(source: str) -> list[str]:
    """Return the names of the test functions in `source` that can never fail."""
    return [
        node.name
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and node.name.startswith("test")
        and not any(_asserts(inner) for inner in ast.walk(node))
    ]


def _asserts(node: ast.AST) -> bool:
    if isinstance(node, ast.Assert):
        return True
    if not isinstance(node, ast.Call):
        return False
    name = ast.unparse(node.func).rpartition(".")[2]
    return name in {"raises", "warns", "fail"} or name.startswith(("assert_", "check_"))


@pytest.mark.parametrize("path", MODULES)
def test_module_keeps_the_rules(path: str) -> None:
    assert faults(path, (REPOSITORY / path).read_text()) == []


@pytest.mark.parametrize("path", TESTS)
def test_every_test_asserts(path: str) -> None:
    assert empty_tests((REPOSITORY / path).read_text()) == []


@pytest.mark.parametrize(
    ("path", "source"),
    [
        ("models/a.py", "import unwrinkle.planning"),
        ("models/a.py", "def f():\n    from unwrinkle.perception import noise"),
        ("perception/a.py", "from pydrake.math import RigidTransform"),
        ("perception/a.py", "import pydrake"),
        ("planning/a.py", "from pydrake.systems.framework import DiagramBuilder"),
        ("planning/a.py", "from unwrinkle.perception.spline import fit"),
        ("planning/a.py", "from unwrinkle.simulation import cloth"),
        ("planning/a.py", "from pydrake.systems import framework"),
        ("hardware/a.py", "import pydrake.math"),
        ("simulation/a.py", "import unwrinkle.systems.station"),
        ("systems/a.py", "from unwrinkle.commands import bench"),
        ("systems/a.py", "from unwrinkle import cli"),
        ("systems/a.py", "from pydrake.all import Simulator"),
        ("systems/a.py", "from numpy import *"),
        ("unwrinkle/a.py", "from . import cli"),
        ("unwrinkle/a.py", "from planning import plan"),
        ("models/a.py", "import rich.table"),
        ("models/a.py", "print('x')"),
    ],
)
def test_a_broken_rule_is_found(path: str, source: str) -> None:
    assert len(faults(path, source)) == 1


@pytest.mark.parametrize(
    ("path", "source"),
    [
        ("perception/a.py", "import numpy as np\nfrom unwrinkle.models import errors"),
        ("planning/a.py", "from unwrinkle.perception.target import FlatteningTarget"),
        ("planning/a.py", "from pydrake.multibody.plant import MultibodyPlant"),
        ("planning/a.py", "from unwrinkle.planning.plan import FlatteningPlan"),
        ("unwrinkle/a.py", "from unwrinkle import __version__\nprint(__version__)"),
        ("systems/a.py", "from pydrake.systems.framework import LeafSystem"),
    ],
)
def test_what_the_rules_allow_passes(path: str, source: str) -> None:
    assert faults(path, source) == []


def test_a_test_without_assertion_is_found() -> None:
    source = "def test_a():\n    f()\n\ndef test_b():\n    assert f()\n"
    assert empty_tests(source) == ["test_a"]


def test_every_third_party_import_is_a_declared_dependency() -> None:
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    requirements = sum((extras[name] for name in extras if name != "dev"), project["dependencies"])
    names = {re.match(r"[\w-]+", requirement).group() for requirement in requirements}
    declared = {IMPORT_NAMES.get(name, name) for name in names}
    used = {
        name.partition(".")[0]
        for path in MODULES
        for _, name in _imports(ast.parse((REPOSITORY / path).read_text()))
    }
    assert used - set(sys.stdlib_module_names) - {"unwrinkle"} <= declared


def test_all_folders_are_read() -> None:
    assert {Path(path).parts[0] for path in MODULES} == set(ALLOWED)
