"""Cloth states: exact round trips through files, and refused values."""

import dataclasses as dc
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from unwrinkle.models.errors import InputError
from unwrinkle.models.io.archive import save_archive
from unwrinkle.simulation.cloth.state import ClothState, Grip, checked_pose


def make(size: int = 12, **changes: Any) -> ClothState:
    rng = np.random.default_rng(1)
    values: dict[str, Any] = {
        "time": 1.25,
        "positions": rng.normal(size=(3, size)),
        "velocities": rng.normal(size=(3, size)),
        "curvatures": rng.normal(size=(4, size)),
    }
    return ClothState(**(values | changes))


def grip(nodes: list[int]) -> Grip:
    return Grip(np.array(nodes), np.full((len(nodes), 3), 0.1), np.eye(4))


def test_a_state_is_saved_bit_for_bit(tmp_path: Path) -> None:
    state = make(grips=(None, grip([3, 5])), asleep=True, quiet=0.06)
    path = tmp_path / "state.npz"
    state.save(path)
    loaded = ClothState.load(path)
    for name in ("positions", "velocities", "curvatures"):
        assert getattr(loaded, name).tobytes() == getattr(state, name).tobytes()
    assert (loaded.time, loaded.asleep, loaded.quiet) == (1.25, True, 0.06)
    assert loaded.grips[0] is None
    assert loaded.grips[1] is not None
    np.testing.assert_array_equal(loaded.grips[1].nodes, [3, 5])
    np.testing.assert_array_equal(loaded.grips[1].p_TN, state.grips[1].p_TN)  # type: ignore[union-attr]


@pytest.mark.parametrize("name", ["positions", "velocities", "curvatures"])
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_what_is_not_finite_is_refused(name: str, bad: float) -> None:
    values = getattr(make(), name).copy()
    values[1, 2] = bad
    with pytest.raises(InputError, match=f"{name}: 1 values are not finite"):
        make(**{name: values})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"time": np.nan}, "time"),
        ({"positions": np.zeros((12, 3))}, "shape"),
        ({"velocities": np.zeros((3, 11))}, "velocities has shape"),
        ({"curvatures": np.zeros((3, 12))}, "curvatures has shape"),
        ({"positions": np.zeros((3, 0))}, "shape"),
        ({"grips": (None,)}, "1 grips"),
        ({"grips": (grip([3]), grip([2, 3]))}, "held twice"),
        ({"grips": (grip([12]), None)}, "outside 0 to 11"),
    ],
)
def test_what_is_no_state_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        make(**changes)


def test_arrays_are_read_only() -> None:
    state = make()
    with pytest.raises(ValueError, match="read-only"):
        state.positions[0, 0] = 1.0
    with pytest.raises(dc.FrozenInstanceError):
        state.time = 2.0  # type: ignore[misc]


def test_other_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        ClothState.load(tmp_path / "none.npz")
    save_archive(tmp_path / "other.npz", {"kind": "range map"}, {})
    with pytest.raises(InputError, match="holds no cloth state"):
        ClothState.load(tmp_path / "other.npz")
    save_archive(tmp_path / "part.npz", {"kind": "cloth state", "held": [False, False]}, {})
    with pytest.raises(InputError, match="lacks a part"):
        ClothState.load(tmp_path / "part.npz")


@pytest.mark.parametrize(
    "X",
    [
        np.eye(3),
        np.full((4, 4), np.nan),
        np.diag([1.0, 1.0, -1.0, 1.0]),
        2.0 * np.eye(4),
        np.vstack([np.eye(4)[:3], [0.0, 0.0, 0.1, 1.0]]),
    ],
)
def test_what_is_no_pose_is_refused(X: np.ndarray) -> None:
    with pytest.raises(InputError, match="hand"):
        checked_pose(X, "hand")
