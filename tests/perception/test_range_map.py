"""Range maps: checked fields, read-only arrays, saving and loading without pickle."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from unwrinkle.models.errors import InputError
from unwrinkle.perception.range_map import RangeMap


def _map(**changes: Any) -> RangeMap:
    rng = np.random.default_rng(0)
    fields: dict[str, Any] = {
        "height": rng.normal(size=(5, 7)).astype(np.float32),
        "valid": rng.random((5, 7)) > 0.3,
        "garment": rng.random((5, 7)) > 0.5,
        "resolution": 0.002,
        "origin": np.array([-0.3, -1.4]),
        "table_height": 0.7,
        "sensor": "xtion",
        "colour": rng.integers(0, 255, (5, 7, 3)).astype(np.uint8),
    }
    return RangeMap(**{**fields, **changes})


@pytest.mark.parametrize("with_colour", [True, False])
def test_round_trip(tmp_path: Path, with_colour: bool) -> None:
    saved = _map() if with_colour else _map(colour=None)
    saved.save(tmp_path / "map.npz")
    loaded = RangeMap.load(tmp_path / "map.npz")
    for name in ("height", "valid", "garment", "origin", "colour"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(saved, name))
    assert (loaded.resolution, loaded.table_height, loaded.sensor) == (0.002, 0.7, "xtion")
    assert [p.name for p in tmp_path.iterdir()] == ["map.npz"]


def test_arrays_are_copies_and_read_only() -> None:
    height = np.ones((4, 4), dtype=np.float32)
    mask = np.ones((4, 4), dtype=bool)
    range_map = _map(height=height, valid=mask, garment=mask, colour=None)
    height[0, 0] = 5.0
    assert range_map.height[0, 0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        range_map.height[0, 0] = 2.0


def test_height_is_zero_where_not_valid_even_if_nan() -> None:
    valid = np.ones((5, 7), dtype=bool)
    valid[2, 3] = False
    height = np.ones((5, 7), dtype=np.float32)
    height[2, 3] = np.nan
    assert _map(height=height, valid=valid).height[2, 3] == 0.0


def test_cells_and_world() -> None:
    range_map = _map()
    np.testing.assert_allclose(range_map.world_from_cell(np.array([3.0, 2.0])), [-0.294, -1.396])
    np.testing.assert_allclose(range_map.cell_from_world(np.array([-0.294, -1.396])), [3.0, 2.0])
    np.testing.assert_allclose(range_map.extent, (-0.301, -0.287, -1.401, -1.391))


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"height": np.zeros(5)}, "height"),
        ({"height": np.full((5, 7), np.nan), "valid": np.ones((5, 7), bool)}, "NaN"),
        ({"valid": np.ones((5, 6), bool)}, "valid"),
        ({"garment": np.ones((5, 7))}, "garment"),
        ({"resolution": 0.0}, "resolution"),
        ({"resolution": float("nan")}, "resolution"),
        ({"origin": np.zeros(3)}, "origin"),
        ({"table_height": float("inf")}, "table height"),
        ({"colour": np.zeros((5, 7), np.uint8)}, "colour"),
    ],
)
def test_refuses(changes: dict[str, Any], named: str) -> None:
    with pytest.raises(InputError, match=named):
        _map(**changes)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9, 0.999])
def test_truncated_file(tmp_path: Path, share: float) -> None:
    path = tmp_path / "map.npz"
    _map().save(path)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(InputError, match=r"map\.npz"):
        RangeMap.load(path)


def test_other_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "map.npz"
    np.savez(path, height=np.zeros((3, 3)))
    with pytest.raises(InputError, match="no range map"):
        RangeMap.load(path)
    np.savez(path, height=np.array([{"a": 1}], dtype=object))
    with pytest.raises(InputError, match="pickled"):
        RangeMap.load(path)
    with pytest.raises(InputError, match="no such file"):
        RangeMap.load(tmp_path / "absent.npz")
