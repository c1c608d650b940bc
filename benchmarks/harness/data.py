"""Data that benchmarks share.

The folder of real captures, and the table of scenes without a robot.
"""

import os
from pathlib import Path

from unwrinkle.models.errors import InputError
from unwrinkle.models.table import Table

#: The shipped cell's working table, for scenes that are made without a robot.
TABLE = Table((0.0, -1.2), (0.8, 0.8), 0.70)
#: World x, y where scenes without a robot have the garment's centre, m.
GARMENT_CENTRE = (0.0, -1.10)


def data_folder(name: str) -> Path:
    """A data set's folder below UNWRINKLE_DATA, by default ../shared/data beside the repository.

    Raises:
        InputError: it is not there.
    """
    folder = Path(os.environ.get("UNWRINKLE_DATA", Path("..") / "shared" / "data")) / name
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; set UNWRINKLE_DATA to the folder of captures")
    return folder
