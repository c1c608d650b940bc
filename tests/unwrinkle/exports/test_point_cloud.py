"""A range map as a point cloud: read back with other libraries."""

import dataclasses as dc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from unwrinkle.exports.point_cloud import export_cloud
from unwrinkle.models.errors import InputError
from unwrinkle.perception.range_map import RangeMap

Main = Callable[..., int]


@pytest.fixture
def range_map() -> RangeMap:
    rng = np.random.default_rng(3)
    shape = (7, 9)
    return RangeMap(
        height=rng.uniform(0.0, 0.05, shape).astype(np.float32),
        valid=rng.uniform(size=shape) > 0.2,
        garment=rng.uniform(size=shape) > 0.5,
        resolution=0.01,
        origin=np.array([0.3, -1.2]),
        table_height=0.7,
        sensor="xtion",
        colour=rng.integers(0, 256, (*shape, 3), dtype=np.uint8),
    )


def wanted(range_map: RangeMap, chosen: np.ndarray) -> np.ndarray:
    """Return the points (n, 3) of cells, one after the other."""
    rows, columns = np.nonzero(chosen)
    return np.array(
        [
            (0.3 + 0.01 * j, -1.2 + 0.01 * i, 0.7 + range_map.height[i, j])
            for i, j in zip(rows, columns, strict=True)
        ]
    )


def test_ply(range_map: RangeMap, tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    path = tmp_path / "map.ply"
    assert export_cloud(range_map, path) == np.count_nonzero(range_map.valid)
    found = trimesh.load(path)
    np.testing.assert_allclose(found.vertices, wanted(range_map, range_map.valid), atol=1e-6)
    np.testing.assert_array_equal(found.colors[:, :3], range_map.colour[range_map.valid])


def test_pcd_of_the_garment_alone(range_map: RangeMap, tmp_path: Path) -> None:
    pypcd4 = pytest.importorskip("pypcd4")
    path = tmp_path / "map.pcd"
    chosen = range_map.valid & range_map.garment
    assert export_cloud(range_map, path, garment_only=True) == np.count_nonzero(chosen)
    found = pypcd4.PointCloud.from_path(path)
    assert found.fields == ("x", "y", "z", "rgb", "garment")
    points = found.numpy(("x", "y", "z"))
    np.testing.assert_allclose(points, wanted(range_map, chosen), atol=1e-6)
    colours = pypcd4.PointCloud.decode_rgb(found.pc_data["rgb"])
    np.testing.assert_array_equal(colours, range_map.colour[chosen])
    assert np.all(found.pc_data["garment"] == 1)


def test_without_colour(range_map: RangeMap, tmp_path: Path) -> None:
    pypcd4 = pytest.importorskip("pypcd4")
    path = tmp_path / "map.pcd"
    export_cloud(dc.replace(range_map, colour=None), path)
    found = pypcd4.PointCloud.from_path(path)
    assert found.fields == ("x", "y", "z", "garment")
    np.testing.assert_array_equal(found.pc_data["garment"], range_map.garment[range_map.valid])


def test_refusals(range_map: RangeMap, tmp_path: Path, main: Main) -> None:
    with pytest.raises(InputError):
        export_cloud(range_map, tmp_path / "map.xyz")
    nothing = dc.replace(range_map, valid=np.zeros_like(range_map.valid))
    with pytest.raises(InputError):
        export_cloud(nothing, tmp_path / "map.ply")
    (tmp_path / "no.npz").write_bytes(b"PK")
    assert main("export", "map", tmp_path / "no.npz", "--out", tmp_path / "map.ply") == 2
    assert [path.name for path in tmp_path.iterdir()] == ["no.npz"]


def test_the_command(range_map: RangeMap, tmp_path: Path, main: Main) -> None:
    range_map.save(tmp_path / "map.npz")
    assert main("export", "map", tmp_path / "map.npz", "--out", tmp_path / "map.ply") == 0
    assert (tmp_path / "map.ply").read_bytes().startswith(b"ply\n")
