"""Units of stored depth: metres per unit, as the programs that write depth call it.

librealsense's `depth_units` and its drivers' `depth_scale` are metres per unit (0.001, 0.0001);
`depth_factor` and the `depth_scale` of TUM's and Open3D's files are units per metre (5000, 1000).
The two ranges do not meet, so that each number says which of them it is.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.errors import InputError

#: Keys of a header that name the unit.
UNIT_KEYS = ("depth_unit", "depth_units", "depth_scale", "depth_factor", "units_per_metre")

#: Units by name, metres.
_NAMED = {
    "m": 1.0,
    "metre": 1.0,
    "metres": 1.0,
    "meters": 1.0,
    "cm": 0.01,
    "mm": 0.001,
    "millimetre": 0.001,
    "millimetres": 0.001,
    "millimeters": 0.001,
    "um": 1e-6,
}

#: Unit of integers, metres.
_MILLIMETRE = 0.001

#: Largest unit of integers, metres; and least number of units per metre.
_MAX_UNIT = 0.1
_MIN_PER_METRE = 10.0

#: Limits of a plausible median depth, metres; and the largest depth that is taken without a unit:
#: the cameras of a cell look from nearer, and a quarter of a millimetre reads as four times as far.
_MIN_MEDIAN_M = 0.1
_MAX_MEDIAN_M = 10.0
_MAX_UNSTATED_M = 2.5

#: Quantile of the readings that is compared with it: much of the view may be floor.
_NEAR = 0.1


def stated_unit(header: Mapping[str, Any], path: Path) -> float | None:
    """Return the unit, metres, that the header of a file states; None if it states none.

    Raises:
        InputError: two different units, or one that is none.
    """
    found = {key: _unit(key, header[key], path) for key in UNIT_KEYS if key in header}
    units = list(found.values())
    if any(abs(unit / units[0] - 1.0) > 1e-6 for unit in units):
        raise InputError(
            f"{path}: {' and '.join(f'{key} {header[key]}' for key in found)} are different units; "
            "keep one"
        )
    return units[0] if units else None


def _unit(key: str, value: Any, path: Path) -> float:
    """Return metres per unit of a value under a key of the header."""
    if isinstance(value, str):
        if value.strip().lower() not in _NAMED:
            raise InputError(f"{path}: {key} {value!r} must be metres per unit, e.g. 0.001, or mm")
        return _NAMED[value.strip().lower()]
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if number and 0.0 < value <= _MAX_UNIT and key != "units_per_metre":
        return float(value)
    if number and value >= _MIN_PER_METRE and key != "depth_unit":
        return 1.0 / float(value)
    if value == 1.0 and key != "units_per_metre":
        return 1.0
    raise InputError(f"{path}: {key} {value!r} must be metres per unit, over 0, e.g. 0.001")


def depth_in_metres(
    raw: NDArray[Any], given: float | None, stated: float | None, path: Path
) -> NDArray[np.float32]:
    """Return stored depth in metres, 0 where 65535 or an integer type's largest value says
    "no reading".

    Args:
        raw: (h, w) integers or floats.
        given: metres per unit by the user; it precedes the file's.
        stated: metres per unit by the file.
        path: of the file, for messages.

    Raises:
        InputError: another shape or type, a unit that is none, a unit of floats that are metres as
            well as units, or integers without a unit that lie too far away as millimetres.
    """
    if raw.ndim != 2:
        raise InputError(f"{path}: depth has shape {raw.shape}, wanted (rows, columns)")
    if given is not None and not 0.0 < given <= 1.0:
        raise InputError(
            f"{path}: the depth unit {given:g} is no unit; give metres per unit, e.g. 0.001"
        )
    if np.issubdtype(raw.dtype, np.floating):
        return _floats(raw, given, stated, path)
    if not np.issubdtype(raw.dtype, np.integer):
        raise InputError(f"{path}: depth is {raw.dtype}, wanted integers (mm) or floats (m)")
    unit = given if given is not None else stated
    if unit is not None and unit > _MAX_UNIT:
        raise InputError(f"{path}: integers of {unit:g} m are no depth; give metres per unit")
    none = (raw == np.iinfo(raw.dtype).max) | (raw == np.iinfo(np.uint16).max)
    depth = np.where(none, 0, raw).astype(np.float64) * (_MILLIMETRE if unit is None else unit)
    seen = depth[depth > 0.0]
    if unit is None and seen.size and float(np.quantile(seen, _NEAR)) > _MAX_UNSTATED_M:
        raise InputError(
            f"{path}: read as millimetres, most lies {np.median(seen):.1f} m away; is its unit "
            "another (0.1 mm: --depth-unit 0.0001, 1/5000 m: --depth-unit 0.0002)? If it is "
            "right, say --depth-unit 0.001"
        )
    return depth.astype(np.float32)


def _floats(
    raw: NDArray[Any], given: float | None, stated: float | None, path: Path
) -> NDArray[np.float32]:
    """Return stored floats in metres: they are metres, or units where only that is plausible."""
    depth = raw.astype(np.float64)
    if given is not None:
        return (depth * given).astype(np.float32)
    if stated is None or stated == 1.0:
        return depth.astype(np.float32)
    seen = depth[np.isfinite(depth) & (depth > 0.0)]
    middle = float(np.median(seen)) if seen.size else 0.0
    plausible = [_MIN_MEDIAN_M <= middle * unit <= _MAX_MEDIAN_M for unit in (1.0, stated)]
    if all(plausible):
        raise InputError(
            f"{path}: depth is floats, which are metres, and has the unit {stated:g} m; both are "
            "plausible, leave the unit out or give --depth-unit"
        )
    return (depth * (stated if plausible[1] else 1.0)).astype(np.float32)
