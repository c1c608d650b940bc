"""Flattening targets: the output of perception and the input of planning.

A wrinkle is pulled flat from both sides. A target holds the source paper's four parameters for each
hand: grasp position, grasp direction, pull direction, pull distance. It is computed by
`unwrinkle.perception.wrinkles.targeting`; the types here check their values.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.choices import PullReading
from unwrinkle.models.errors import InputError

Vector = NDArray[np.float64]

#: Limit of the grippers' final distance, multiples of the geodesic distance between them.
STRETCH_LIMIT = 1.10

#: Margin to the stretch limit, metres: the grippers of a planned motion are up to 0.1 mm further
#: apart than its target states, and the verification has no tolerance.
STRETCH_MARGIN = 0.001


def _frozen_vector(value: Any, size: int, name: str) -> Vector:
    vector = np.array(value, dtype=float)
    if vector.shape != (size,) or not np.all(np.isfinite(vector)):
        raise InputError(f"{name} must be {size} finite numbers, got {value!r}")
    vector.setflags(write=False)
    return vector


def _unit_vector(value: Any, name: str) -> Vector:
    vector = _frozen_vector(value, 2, name)
    norm = float(np.hypot(*vector))
    if abs(norm - 1.0) > 1e-6:
        raise InputError(f"{name} must have length 1, got {norm:.6f}")
    return vector


@dataclass(frozen=True, eq=False)
class HandTarget:
    """Four parameters of one hand. World frame W, z up, metres.

    Attributes:
        p_WG: (3,) grasp point at the garment's contour, z = the table's height.
        grasp_direction: (2,) horizontal unit vector in which the fingers approach: the inward
            normal of the smoothed contour.
        pull_direction: (2,) horizontal unit vector away from the wrinkle.
        pull_distance: distance that this hand moves, >= 0.
    """

    p_WG: Vector
    grasp_direction: Vector
    pull_direction: Vector
    pull_distance: float

    def __post_init__(self) -> None:
        """Check and freeze the fields.

        Raises:
            InputError: a value is not finite, a direction not a unit vector, or a distance
                negative.
        """
        object.__setattr__(self, "p_WG", _frozen_vector(self.p_WG, 3, "p_WG"))
        for name in ("grasp_direction", "pull_direction"):
            object.__setattr__(self, name, _unit_vector(getattr(self, name), name))
        if not (math.isfinite(self.pull_distance) and self.pull_distance >= 0.0):
            raise InputError(f"pull_distance must be finite and >= 0, got {self.pull_distance!r}")

    def to_json(self) -> dict[str, Any]:
        """Return the fields as plain lists and numbers."""
        return {
            "p_WG": self.p_WG.tolist(),
            "grasp_direction": self.grasp_direction.tolist(),
            "pull_direction": self.pull_direction.tolist(),
            "pull_distance": float(self.pull_distance),
        }

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> HandTarget:
        """Read what `to_json` wrote.

        Raises:
            InputError: a field is missing, unknown or unusable.
        """
        _demand_keys(data, ("p_WG", "grasp_direction", "pull_direction", "pull_distance"))
        return cls(**data)


@dataclass(frozen=True, eq=False)
class FlatteningTarget:
    """Dual-arm pull that flattens one wrinkle. World frame W, metres.

    Attributes:
        hands: hands[0] on the -n side of the wrinkle, hands[1] on the +n side, where
            n = (-dy, dx) is the normal of `wrinkle_direction` = (dx, dy).
        p_WC: (3,) the wrinkle's centre on the cloth.
        wrinkle_direction: (2,) unit principal direction of the wrinkle.
        geodesic_distance: arc length of the cloth's section between the grasp points. The grippers'
            final distance is at most STRETCH_LIMIT times this.
        mode: reading of Eq. 5 that gave the pull distance; text is converted.
    """

    hands: tuple[HandTarget, HandTarget]
    p_WC: Vector
    wrinkle_direction: Vector
    geodesic_distance: float
    mode: PullReading

    def __post_init__(self) -> None:
        """Check and freeze the fields.

        Raises:
            InputError: a value is not usable, or the pull would exceed the stretch limit.
        """
        if len(self.hands) != 2:
            raise InputError(f"a flattening target has two hands, got {len(self.hands)}")
        object.__setattr__(self, "hands", tuple(self.hands))
        object.__setattr__(self, "p_WC", _frozen_vector(self.p_WC, 3, "p_WC"))
        direction = _unit_vector(self.wrinkle_direction, "wrinkle_direction")
        object.__setattr__(self, "wrinkle_direction", direction)
        object.__setattr__(self, "mode", PullReading(self.mode))
        if not (math.isfinite(self.geodesic_distance) and self.geodesic_distance > 0.0):
            raise InputError(f"geodesic_distance must be > 0, got {self.geodesic_distance!r}")
        limit = STRETCH_LIMIT * self.geodesic_distance
        if self.final_grip_distance > limit + 1e-9:
            raise InputError(
                f"the grippers would end {self.final_grip_distance:.4f} m apart, more than the "
                f"limit {limit:.4f} m ({STRETCH_LIMIT} x geodesic distance)"
            )

    @property
    def final_grip_distance(self) -> float:
        """Horizontal distance between the grippers after the pull, metres."""
        ends = [hand.p_WG[:2] + hand.pull_distance * hand.pull_direction for hand in self.hands]
        return float(np.hypot(*(ends[1] - ends[0])))

    def pulled_further(self, gain: float, extra: float) -> FlatteningTarget:
        """Return the target with each hand's pull lengthened by a gain and an offset.

        Each hand moves gain * pull_distance + extra, metres, because cloth slides and stretches
        before the rest of a wrinkle is pulled out. The lengthening is reduced so that the grippers
        end at most STRETCH_LIMIT x geodesic distance - STRETCH_MARGIN apart; no pull is shortened.

        Raises:
            InputError: a gain below 1, an extra below 0, or one of them not finite.
        """
        finite = math.isfinite(gain) and math.isfinite(extra)
        if not (finite and gain >= 1.0 and extra >= 0.0):
            raise InputError(f"pull: gain {gain!r} must be 1 or more, extra {extra!r} m 0 or more")
        begin = [hand.p_WG[:2] + hand.pull_distance * hand.pull_direction for hand in self.hands]
        more = [(gain - 1.0) * hand.pull_distance + extra for hand in self.hands]
        wider = more[1] * self.hands[1].pull_direction - more[0] * self.hands[0].pull_direction
        limit = STRETCH_LIMIT * self.geodesic_distance - STRETCH_MARGIN
        share = _share_within(begin[1] - begin[0], wider, limit)
        hands = [
            replace(hand, pull_distance=hand.pull_distance + share * further)
            for hand, further in zip(self.hands, more, strict=True)
        ]
        return replace(self, hands=(hands[0], hands[1]))

    def to_json(self) -> dict[str, Any]:
        """Return the fields as plain lists and numbers."""
        return {
            "hands": [hand.to_json() for hand in self.hands],
            "p_WC": self.p_WC.tolist(),
            "wrinkle_direction": self.wrinkle_direction.tolist(),
            "geodesic_distance": float(self.geodesic_distance),
            "mode": self.mode.value,
        }

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> FlatteningTarget:
        """Read what `to_json` wrote.

        Raises:
            InputError: a field is missing, unknown or unusable.
        """
        _demand_keys(data, ("hands", "p_WC", "wrinkle_direction", "geodesic_distance", "mode"))
        hands = tuple(HandTarget.from_json(hand) for hand in data["hands"])
        return cls(**{**data, "hands": hands})


@dataclass(frozen=True)
class NoTarget:
    """Why there is no flattening target.

    Attributes:
        reason: one sentence: what, where, by how much, what to try.
        flat: True if every wrinkle is below the halting pull; False if there is a wrinkle that
            cannot be grasped.
    """

    reason: str
    flat: bool = False


def _share_within(begin: Vector, change: Vector, limit: float) -> float:
    """Return the largest s in [0, 1] with |begin + s * change| <= limit, for vectors (2,)."""
    a, b = float(change @ change), float(begin @ change)
    c = float(begin @ begin) - limit * limit
    if a + 2.0 * b + c <= 0.0 or a == 0.0:
        return 1.0
    root = math.sqrt(max(b * b - a * c, 0.0))
    return min(max((root - b) / a, 0.0), 1.0)


def _demand_keys(data: Any, keys: tuple[str, ...]) -> None:
    if not isinstance(data, dict):
        raise InputError(
            f"expected a JSON object with {', '.join(keys)}, got {type(data).__name__}"
        )
    missing, unknown = sorted(set(keys) - set(data)), sorted(set(data) - set(keys))
    if missing or unknown:
        raise InputError(f"missing fields {missing}, unknown fields {unknown} in a target")
