"""Export of a range map as a point cloud: PLY or PCD, binary.

One point per measured cell, at the cell's centre, in the world frame: m, z up, origin at the
robot's base on the floor. `garment` is 1 on the garment, else 0; colours only where the map has
them.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.errors import InputError
from unwrinkle.models.io.files import atomic_path
from unwrinkle.perception.range_map import RangeMap

_PLACE = [("x", "<f4"), ("y", "<f4"), ("z", "<f4")]
_PLY_TYPES = {"<f4": "float", "|u1": "uchar"}
_PCD_TYPES = {"f": "F", "u": "U"}


def export_cloud(range_map: RangeMap, path: str | Path, *, garment_only: bool = False) -> int:
    """Write a range map as a point cloud.

    Args:
        range_map: the map.
        path: file to write, atomically: `.ply` or `.pcd`.
        garment_only: leave out the cells beside the garment.

    Returns:
        The number of points.

    Raises:
        InputError: the suffix is another, no cell is measured, or the file cannot be written.
    """
    path = Path(path)
    if path.suffix not in (".ply", ".pcd"):
        raise InputError(f"{path}: give a file *.ply or *.pcd for a range map")
    chosen = range_map.valid & range_map.garment if garment_only else range_map.valid
    if not chosen.any():
        raise InputError("the range map has no measured cell, so there is no point to write")
    data = _ply(range_map, chosen) if path.suffix == ".ply" else _pcd(range_map, chosen)
    with atomic_path(path) as temporary:
        temporary.write_bytes(data)
    return int(np.count_nonzero(chosen))


def _points(
    range_map: RangeMap, chosen: NDArray[np.bool_], colour: list[tuple[str, str]]
) -> NDArray[np.void]:
    """Return a structured array of the chosen cells; the fields of colour are left empty."""
    rows, columns = np.nonzero(chosen)
    points = np.zeros(len(rows), dtype=[*_PLACE, *colour, ("garment", "|u1")])
    place = range_map.world_from_cell(np.column_stack([columns, rows]))
    points["x"], points["y"] = place[:, 0], place[:, 1]
    points["z"] = range_map.table_height + range_map.height[chosen].astype(float)
    points["garment"] = range_map.garment[chosen]
    return points


def _ply(range_map: RangeMap, chosen: NDArray[np.bool_]) -> bytes:
    names = ("red", "green", "blue") if range_map.colour is not None else ()
    points = _points(range_map, chosen, [(name, "|u1") for name in names])
    for channel, name in enumerate(names):
        assert range_map.colour is not None
        points[name] = range_map.colour[chosen][:, channel]
    kinds = {name: _PLY_TYPES[points.dtype[name].str] for name in points.dtype.names or ()}
    lines = [
        "ply",
        "format binary_little_endian 1.0",
        "comment world frame, m; z up; origin at the robot's base on the floor",
        f"element vertex {len(points)}",
        *(f"property {kind} {name}" for name, kind in kinds.items()),
        "end_header",
    ]
    return "\n".join(lines).encode() + b"\n" + points.tobytes()


def _pcd(range_map: RangeMap, chosen: NDArray[np.bool_]) -> bytes:
    packed = [("rgb", "<f4")] if range_map.colour is not None else []
    points = _points(range_map, chosen, packed)
    if range_map.colour is not None:
        red, green, blue = range_map.colour[chosen].astype(np.uint32).T
        points["rgb"] = (red << 16 | green << 8 | blue).astype("<u4").view("<f4")
    names = points.dtype.names or ()
    types = [points.dtype[name] for name in names]
    lines = [
        "# .PCD v0.7 - world frame, m; z up; origin at the robot's base on the floor",
        "VERSION 0.7",
        f"FIELDS {' '.join(names)}",
        f"SIZE {' '.join(str(kind.itemsize) for kind in types)}",
        f"TYPE {' '.join(_PCD_TYPES[kind.kind] for kind in types)}",
        f"COUNT {' '.join('1' for _ in names)}",
        f"WIDTH {len(points)}",
        "HEIGHT 1",
        "VIEWPOINT 0 0 0 1 0 0 0",
        f"POINTS {len(points)}",
        "DATA binary",
    ]
    return "\n".join(lines).encode() + b"\n" + points.tobytes()
