"""Files that a model file refers to: meshes, included models, and the buffers of a glTF."""

import json
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

from unwrinkle.models.errors import InputError

#: Addresses that a package map resolves; anything else is relative to the file that names it.
_ADDRESSES = ("package://", "model://", "file://")


def files_named_by(path: Path, resolve_address: Callable[[str], str]) -> list[Path]:
    """List the files on which the geometry of a model depends, beside its own file.

    Args:
        path: of a URDF or SDF (meshes and included models) or of a glTF file (buffers); other files
            have none.
        resolve_address: maps an address with a scheme to a path.

    Raises:
        InputError: a file is missing, or the model file cannot be read.
    """
    if path.suffix in (".urdf", ".sdf", ".xml"):
        names = _of_xml(path)
    elif path.suffix == ".gltf":
        names = _of_gltf(path)
    else:
        return []
    return [_found(name, path, resolve_address) for name in names]


def _of_xml(path: Path) -> list[str]:
    try:
        root = ET.parse(path).getroot()
    except (ET.ParseError, OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read as a model: {error}") from None
    names = [mesh.get("filename") for mesh in root.iter("mesh")]  # URDF
    names += [
        uri.text for kind in ("mesh", "include") for x in root.iter(kind) for uri in x.iter("uri")
    ]
    return [name.strip() for name in names if name and name.strip()]


def _of_gltf(path: Path) -> list[str]:
    try:
        buffers = json.loads(path.read_text(encoding="utf-8")).get("buffers", [])
        names = [item.get("uri", "") for item in buffers]
    except (OSError, ValueError, AttributeError, RecursionError) as error:
        raise InputError(f"{path}: cannot be read as glTF: {error}") from None
    return [name for name in names if name and not name.startswith("data:")]


def _found(name: str, path: Path, resolve_address: Callable[[str], str]) -> Path:
    try:
        found = Path(resolve_address(name)) if name.startswith(_ADDRESSES) else path.parent / name
    except RuntimeError as error:
        raise InputError(f"{path}: refers to {name}, which cannot be found: {error}") from None
    if not found.is_file():
        raise InputError(f"{path}: refers to {name}, which does not exist")
    return found
