"""Values of the cloth simulation: cloth state, support and grips."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.errors import InputError, UnwrinkleError
from unwrinkle.models.io.archive import load_archive, save_archive
from unwrinkle.models.shared import Shared

HANDS = ("right", "left")


class ClothError(UnwrinkleError):
    """The cloth solver failed: positions not finite, yarns torn, or too many contacts."""


def checked_pose(X: NDArray[np.floating[Any]], what: str) -> NDArray[np.float64]:
    """Check a pose (4, 4); return a read-only copy.

    Raises:
        InputError: wrong shape, not finite, or not a rigid transform.
    """
    pose = np.array(X, dtype=float)
    if pose.shape != (4, 4) or not np.isfinite(pose).all():
        raise InputError(f"{what}: a pose is (4, 4) and finite, got {pose.shape}")
    R = pose[:3, :3]
    fault = max(
        float(np.abs(R @ R.T - np.eye(3)).max()), float(np.abs(pose[3] - [0, 0, 0, 1]).max())
    )
    if fault > 1e-6 or np.linalg.det(R) < 0.0:
        raise InputError(f"{what}: is no rigid pose (off by {fault:.1e}); give [R p; 0 0 0 1]")
    pose.flags.writeable = False
    return pose


@dataclass(frozen=True, eq=False)
class Grip:
    """Nodes held by a gripper.

    Attributes:
        nodes: (k,) grid numbers.
        p_TN: (k, 3) positions in the tool frame T, m.
        X_WT: (4, 4) last pose of the tool.
    """

    nodes: NDArray[np.intp]
    p_TN: NDArray[np.float64]
    X_WT: NDArray[np.float64]

    def __post_init__(self) -> None:
        """Check the arrays and make them read-only."""
        nodes = np.array(self.nodes, dtype=np.intp)
        p_TN = _frozen(self.p_TN, (len(nodes), 3), "grip: p_TN")
        nodes.flags.writeable = False
        object.__setattr__(self, "nodes", nodes)
        object.__setattr__(self, "p_TN", p_TN)
        object.__setattr__(self, "X_WT", checked_pose(self.X_WT, "grip: X_WT"))

    def at(self, X_WT: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the world positions (k, 3), m, of the nodes with the tool at X_WT."""
        return self.p_TN @ X_WT[:3, :3].T + X_WT[:3, 3]


Grips = tuple[Grip | None, Grip | None]


@dataclass(frozen=True, eq=False)
class ClothState(Shared):
    """State of a cloth with S = nx * ny nodes; node (i, j) has the number i * ny + j.

    Attributes:
        time: s.
        positions: (3, S) in the world, m. Nodes that are not cloth have any finite position.
        velocities: (3, S), m/s.
        curvatures: (4, S) plastic rest values of the bending along i, both diagonals and j, as
            second differences of positions, m.
        grips: of the right and the left hand.
        asleep: whether the cloth is at rest until a hand moves.
        quiet: time since the last motion, s; see `QUIET_TIME`.
    """

    time: float
    positions: NDArray[np.float64]
    velocities: NDArray[np.float64]
    curvatures: NDArray[np.float64]
    grips: Grips = (None, None)
    asleep: bool = False
    quiet: float = 0.0

    def __post_init__(self) -> None:
        """Check shapes, values and grips, and make the arrays read-only."""
        if not (np.isfinite(self.time) and np.isfinite(self.quiet)):
            raise InputError(f"cloth state: time {self.time} s, quiet {self.quiet} s; give numbers")
        positions = np.asarray(self.positions)
        size = positions.shape[1] if positions.ndim == 2 else 0
        for name, count in (("positions", 3), ("velocities", 3), ("curvatures", 4)):
            value = _frozen(getattr(self, name), (count, size), f"cloth state: {name}")
            object.__setattr__(self, name, value)
        if len(self.grips) != 2:
            raise InputError(f"cloth state: {len(self.grips)} grips; give right and left, or None")
        held = [grip.nodes for grip in self.grips if grip is not None]
        every = np.concatenate([np.empty(0, dtype=np.intp), *held])
        if len(every) and (every.min() < 0 or every.max() >= size):
            raise InputError(f"cloth state: a grip holds a node outside 0 to {size - 1}")
        if len(np.unique(every)) < len(every):
            raise InputError("cloth state: a node is held twice; two grips cannot share nodes")

    @property
    def held(self) -> bool:
        """Whether a hand holds cloth."""
        return any(grip is not None for grip in self.grips)

    @property
    def speed(self) -> float:
        """Largest velocity component of any node, m/s."""
        return float(np.abs(self.velocities).max())

    def save(self, path: str | Path) -> None:
        """Write one `.npz`, atomically.

        Raises:
            InputError: the file cannot be written.
        """
        header: dict[str, Any] = {
            "kind": "cloth state",
            "time": self.time,
            "asleep": self.asleep,
            "quiet": self.quiet,
            "held": [grip is not None for grip in self.grips],
        }
        arrays: dict[str, NDArray[Any]] = {
            "positions": self.positions,
            "velocities": self.velocities,
            "curvatures": self.curvatures,
        }
        for hand, grip in zip(HANDS, self.grips, strict=True):
            if grip is not None:
                arrays |= {
                    f"{hand}_nodes": grip.nodes,
                    f"{hand}_p_TN": grip.p_TN,
                    f"{hand}_X_WT": grip.X_WT,
                }
        save_archive(path, header, arrays)

    @staticmethod
    def load(path: str | Path) -> "ClothState":
        """Load a state that `save` wrote, bit for bit.

        Raises:
            InputError: the file is missing, damaged, or not a cloth state.
        """
        header, arrays = load_archive(path)
        if header.get("kind") != "cloth state":
            raise InputError(f"{path}: holds no cloth state; it is {header.get('kind', 'unknown')}")
        try:
            grips = [
                _loaded_grip(arrays, hand) if held else None
                for hand, held in zip(HANDS, header["held"], strict=True)
            ]
            return ClothState(
                float(header["time"]),
                arrays["positions"],
                arrays["velocities"],
                arrays["curvatures"],
                (grips[0], grips[1]),
                bool(header["asleep"]),
                float(header["quiet"]),
            )
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"{path}: lacks a part of the cloth state ({error})") from None
        except InputError as error:
            raise InputError(f"{path}: {error}") from None


def _loaded_grip(arrays: Mapping[str, NDArray[Any]], hand: str) -> Grip:
    return Grip(arrays[f"{hand}_nodes"], arrays[f"{hand}_p_TN"], arrays[f"{hand}_X_WT"])


def _frozen(value: NDArray[Any], shape: tuple[int, int], what: str) -> NDArray[np.float64]:
    array = np.array(value, dtype=float)
    if array.shape != shape or array.size == 0:
        raise InputError(f"{what} has shape {array.shape}, not {shape}")
    if not np.isfinite(array).all():
        raise InputError(f"{what}: {int((~np.isfinite(array)).sum())} values are not finite")
    array.flags.writeable = False
    return array
