"""Every name that a face lists is there, and importing the package imports none of it."""

import ast
import importlib
import subprocess
import sys
from pathlib import Path

import pytest

FACES = sorted(
    path.relative_to(Path(__file__).parents[1]).as_posix()
    for folder in (
        "flattening",
        "hardware",
        "models",
        "perception",
        "planning",
        "simulation",
        "systems",
        "unwrinkle",
    )
    for path in (Path(__file__).parents[1] / folder).rglob("__init__.pyi")
)


def _names(face: Path) -> list[str]:
    return [
        alias.asname or alias.name
        for node in ast.parse(face.read_text(encoding="utf-8")).body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    ]


@pytest.mark.parametrize("face", FACES)
def test_every_name_of_a_face_is_there(face: str, repository: Path) -> None:
    parts = Path(face).parent.parts
    name = ".".join(parts if parts[0] == "unwrinkle" else ("unwrinkle", *parts))
    module = importlib.import_module(name)
    names = _names(repository / face)
    assert names and len(set(names)) == len(names)
    assert set(names) == set(module.__all__)
    assert all(getattr(module, each) is not None for each in names)


def test_importing_the_package_loads_neither_drake_nor_numpy() -> None:
    heavy = ("pydrake", "numpy", "typer")
    script = f"import sys, unwrinkle; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"
