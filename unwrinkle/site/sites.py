"""Find a site by its name or file, and load its cell."""

import dataclasses as dc
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from unwrinkle.models.errors import InputError
from unwrinkle.models.io.loader_yaml import models_dir
from unwrinkle.models.site import NO_DEVICE, Site, load_site

if TYPE_CHECKING:
    from unwrinkle.models.robot import Cell

_SUFFIX = ".site.yaml"


def shipped_sites() -> tuple[str, ...]:
    """Return the names of the sites that the package ships."""
    files = (models_dir() / "sites").glob(f"*{_SUFFIX}")
    return tuple(sorted(path.name.removesuffix(_SUFFIX) for path in files))


def site_file(name: str | Path) -> Path:
    """Return the file of a site: a file, or a shipped site by its name.

    Raises:
        InputError: there is no such site.
    """
    path = Path(name)
    if str(name) in shipped_sites() and not path.is_file():
        return models_dir() / "sites" / f"{name}{_SUFFIX}"
    if not path.is_file():
        known = ", ".join(shipped_sites())
        raise InputError(
            f"there is no site '{name}': give a *{_SUFFIX} file, or a shipped site: {known}"
        )
    return path


def find_site(name: str | Path, *, settings: Sequence[str] = ()) -> Site:
    """Read a site from a file, or a shipped site by its name.

    Relative paths in a site file are relative to the folder of the file.

    Args:
        name: of the file, or of the shipped site.
        settings: changes of the file's values, e.g. `("controller.lead=0.1",)`.

    Raises:
        InputError: there is no such site, or its file is wrong.
    """
    path = site_file(name)
    site = load_site(path, settings=settings)
    try:
        _check_kinds(site)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    folder = path.resolve().parent
    return dc.replace(
        site,
        scenario=_beside(folder, site.scenario),
        calibration=_beside(folder, site.calibration),
        cameras=dc.replace(site.cameras, folder=_beside(folder, site.cameras.folder)),
    )


def site_cell(site: Site) -> "Cell":
    """Load the cell of a site.

    Raises:
        InputError: its scenario is missing or wrong.
    """
    from unwrinkle.models.robot import load_cell
    from unwrinkle.models.scenario import load_scenario

    return load_cell(load_scenario(site.scenario or None))


def _check_kinds(site: Site) -> None:
    """Refuse devices without a driver."""
    # Imported here: slow, and commands without a site do not need them.
    from unwrinkle.hardware.backend import check_kind
    from unwrinkle.hardware.cameras.factory import CAMERAS
    from unwrinkle.hardware.grippers.factory import GRIPPERS

    check_kind("grippers.kind", site.grippers.kind, (NO_DEVICE, *GRIPPERS))
    check_kind("cameras.kind", site.cameras.kind, (NO_DEVICE, *CAMERAS))


def _beside(folder: Path, name: str) -> str:
    if not name or name.startswith("package://") or Path(name).is_absolute():
        return name
    return str(folder / name)
