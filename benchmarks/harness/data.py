"""Find the folder of real captures."""

import os
from pathlib import Path

from unwrinkle.models.errors import InputError


def data_folder(name: str) -> Path:
    """Return a data set's folder below UNWRINKLE_DATA, by default ../shared/data beside the repository.

    Raises:
        InputError: it is not there.
    """
    folder = Path(os.environ.get("UNWRINKLE_DATA", Path("..") / "shared" / "data")) / name
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; set UNWRINKLE_DATA to the folder of captures")
    return folder
