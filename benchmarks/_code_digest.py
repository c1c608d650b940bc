"""What code a result belongs to: results of other code do not count."""

import ast
import functools
import hashlib
import importlib.util
from collections.abc import Iterator
from pathlib import Path

from unwrinkle.models.errors import InputError

#: Whose files decide how the simulated cell and what works in it behave.
PRODUCT = ("models", "perception", "planning", "simulation", "hardware", "systems")
_KINDS = ("*.py", "*.yaml", "*.urdf", "*.sdf")


@functools.cache
def code_digest(module: str) -> str:
    """SHA-256 over the product's sources and models, a benchmark module, and the benchmark modules it imports.

    Files count by their names within the package, not by where it is installed.

    Args:
        module: dotted name, below `unwrinkle.benchmarks`.

    Raises:
        InputError: there is no such module.
    """
    files = {}
    for name in PRODUCT:
        root = _location(f"unwrinkle.{name}")
        for kind in _KINDS:
            files.update({f"{name}/{p.relative_to(root)}": p for p in root.rglob(kind)})
    files.update({name: _location(name) for name in _closure(module)})
    digest = hashlib.sha256()
    for name in sorted(files):
        digest.update(name.encode())
        digest.update(files[name].read_bytes())
    return digest.hexdigest()


def _location(name: str) -> Path:
    """A package's folder or a module's file."""
    spec = importlib.util.find_spec(name)
    if spec is None or spec.origin is None:
        raise InputError(f"{name}: no such module")
    path = Path(spec.origin)
    return path.parent if spec.submodule_search_locations else path


def _closure(module: str) -> set[str]:
    """A module and the modules of its package that it imports, directly or through others."""
    package = module.rpartition(".")[0]
    found, todo = set[str](), [module]
    while todo:
        name = todo.pop()
        if name in found:
            continue
        found.add(name)
        tree = ast.parse(_location(name).read_text(encoding="utf-8"))
        todo += [wanted for wanted in _imported(tree) if wanted.startswith(f"{package}.")]
    return found


def _imported(tree: ast.AST) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module is not None and node.level == 0:
            yield node.module
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
