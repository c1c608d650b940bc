"""What code a result belongs to: results of other code do not count."""

import ast
import functools
import hashlib
import importlib.util
from collections.abc import Iterator
from pathlib import Path

from unwrinkle.models.errors import InputError
from unwrinkle.models.io.loader_yaml import models_dir

#: Packages whose modules count.
_PACKAGES = ("unwrinkle.", "benchmarks.", "tests.robustness.")
_DATA = ("*.yaml", "*.urdf", "*.sdf")
#: What only keeps results, and has no part in them.
_KEEPERS = {f"benchmarks.harness.{name}" for name in ("digest", "report", "results", "trials")}


@functools.cache
def code_digest(module: str) -> str:
    """SHA-256 over a module, all modules of this package that it imports, and all data of `models`.

    Imports inside functions count, and those of the imported; modules that only keep results do
    not. Files count by their names within the package, not by where it is installed.

    Args:
        module: dotted name.

    Raises:
        InputError: there is no such module.
    """
    if _file(module) is None:
        raise InputError(f"{module}: no such module")
    root = models_dir()
    files = {str(path.relative_to(root)): path for kind in _DATA for path in root.rglob(kind)}
    todo = [module]
    while todo:
        name = todo.pop()
        path = _file(name)
        if name in files or name in _KEEPERS or path is None:
            continue
        files[name] = path
        tree = ast.parse(path.read_text(encoding="utf-8"))
        todo += [wanted for wanted in _imported(tree) if wanted.startswith(_PACKAGES)]
    digest = hashlib.sha256()
    for name in sorted(files):
        digest.update(name.encode())
        digest.update(files[name].read_bytes())
    return digest.hexdigest()


@functools.cache
def _file(name: str) -> Path | None:
    """A module's file, a package's `__init__.py`; None where there is no such module."""
    try:
        spec = importlib.util.find_spec(name)
    except ModuleNotFoundError:
        return None
    return None if spec is None or spec.origin is None else Path(spec.origin)


def _imported(tree: ast.AST) -> Iterator[str]:
    """Dotted names that are imported, submodules among them.

    Some are no modules but what is in one.
    """
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module is not None and node.level == 0:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
