"""Compute what a result belongs to: the code, and the versions of what computes.

Results of other code, or of other versions, do not count.
"""

import ast
import functools
import hashlib
import importlib.util
import json
import platform
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

from unwrinkle.models.errors import InputError
from unwrinkle.models.io.loader_yaml import models_dir

#: Packages whose modules count.
_PACKAGES = ("unwrinkle.", "benchmarks.", "tests.robustness.")
_DATA = ("*.yaml", "*.urdf", "*.sdf")
#: What only keeps results, and has no part in them.
_KEEPERS = {f"benchmarks.harness.{name}" for name in ("digest", "report", "results", "trials")}
#: Distributions that compute: another version may compute something else.
COMPUTING = ("drake", "numba", "numpy", "opencv-python-headless", "scipy")


def computing_versions() -> dict[str, str]:
    """Return the versions of Python and of what computes; an absent distribution is left out."""
    found = {"python": platform.python_version()}
    for name in COMPUTING:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found


def code_digest(module: str) -> str:
    """Compute the digest of what a module's results depend on, SHA-256, hex.

    It covers the module, all modules of this project that it imports (inside functions too, and
    those of the imported; not those that only keep results), all data of `models`, and the
    versions of Python and of the libraries that compute. Files count by their names within the
    project, not by where it is installed.

    Args:
        module: dotted name.

    Raises:
        InputError: there is no such module.
    """
    return _with_versions(_closure_digest(module))


def source_digest() -> str:
    """Compute the digest of every source and model file of the package, and of the versions."""
    return _with_versions(_package_digest())


def _with_versions(digest: str) -> str:
    text = json.dumps([digest, computing_versions()], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


@functools.cache
def _closure_digest(module: str) -> str:
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
def _package_digest() -> str:
    (package,) = map(Path, importlib.import_module("unwrinkle").__path__)
    robustness = package.resolve().parent / "tests" / "robustness"
    folders = [each.resolve() for each in package.iterdir() if each.is_dir()]
    digest = hashlib.sha256()
    for root in sorted({package.resolve(), models_dir(), robustness, *folders}):
        for path in sorted([*root.rglob("*.py"), *root.rglob("*.yaml"), *root.rglob("*.urdf")]):
            digest.update(path.name.encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()


@functools.cache
def _file(name: str) -> Path | None:
    """Return a module's file, a package's `__init__.py`; None where there is no such module."""
    try:
        spec = importlib.util.find_spec(name)
    except ModuleNotFoundError:
        return None
    return None if spec is None or spec.origin is None else Path(spec.origin)


def _imported(tree: ast.AST) -> Iterator[str]:
    """Yield the dotted names that are imported, submodules among them.

    Some are no modules but what is in one.
    """
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module is not None and node.level == 0:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
