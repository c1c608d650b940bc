"""Messages between perception, policy, planning, verification and the supervisor; all immutable."""

from dataclasses import dataclass, field

import numpy as np

from unwrinkle.flattening.observation import Observation
from unwrinkle.models.arrays import Array
from unwrinkle.models.shared import Shared
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.target import FlatteningTarget, NoTarget
from unwrinkle.planning.plan import GarmentSurface
from unwrinkle.planning.search.planner import PlanResult
from unwrinkle.planning.trajectory import AXES
from unwrinkle.planning.verification.verdict import Verdict


@dataclass(frozen=True, eq=False)
class Perceived(Shared):
    """The range map of a look.

    Attributes:
        number: of the head command whose pictures it is from; 0 before the first.
        range_map: of the garment; None where there is none.
        reason: why there is none; else empty.
        empty: whether the table was seen without a garment on it.
        unseen: least height of a garment that the sensor can tell from the table, m.
        seconds: computing time, wall clock, s.
    """

    number: int = 0
    range_map: RangeMap | None = None
    reason: str = ""
    empty: bool = False
    unseen: float = 0.0
    seconds: float = 0.0


@dataclass(frozen=True, eq=False)
class Analysed(Shared):
    """The observation of a look.

    Attributes:
        number: of the look.
        observation: wrinkles and features; None where there is none.
        reason: why there is none; else empty.
        seconds: computing time, wall clock, s.
    """

    number: int = 0
    observation: Observation | None = None
    reason: str = ""
    seconds: float = 0.0


def _at_zero() -> Array:
    zero = np.zeros(AXES)
    zero.setflags(write=False)
    return zero


@dataclass(frozen=True, eq=False)
class PlanRequest(Shared):
    """A request for a plan.

    Attributes:
        number: counts up with every request; 0 is none.
        target: to plan for.
        arms: `any`, `dual` or `single`.
        start: (13,) where the robot stands, rad.
        garment: as it was seen; stored in the plan for its preview.
    """

    number: int = 0
    target: FlatteningTarget | NoTarget = field(
        default_factory=lambda: NoTarget("no plan was requested yet")
    )
    arms: str = "any"
    start: Array = field(default_factory=_at_zero)
    garment: GarmentSurface | None = None

    def __post_init__(self) -> None:
        """Copy and freeze the start."""
        start = np.array(self.start, dtype=float)
        start.setflags(write=False)
        object.__setattr__(self, "start", start)


@dataclass(frozen=True, eq=False)
class Planned(Shared):
    """The planner's answer.

    Attributes:
        number: of the request; 0 before the first.
        result: of the planner; None where there was nothing to plan for.
        reason: why there is no plan; else empty.
        seconds: computing time, wall clock, s.
        request: that was answered.
    """

    number: int = 0
    result: PlanResult | None = None
    reason: str = ""
    seconds: float = 0.0
    request: PlanRequest = field(default_factory=PlanRequest)


@dataclass(frozen=True, eq=False)
class Verified(Shared):
    """The verdict on a plan.

    Attributes:
        number: of the request; 0 before the first.
        plan_hash: content hash of the plan; empty where there is none.
        verdict: None where there was no plan.
        seconds: computing time, wall clock, s.
        reason: why there is no verdict; else empty.
    """

    number: int = 0
    plan_hash: str = ""
    verdict: Verdict | None = None
    seconds: float = 0.0
    reason: str = ""
