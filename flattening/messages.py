"""What travels between perception, planning, verification and the supervisor.

All of it is immutable, so that Drake, which copies what a state or a port holds, need not: a copy is the value itself.
"""

from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.wrinkles.analysis import Analysis
from unwrinkle.planning.search.planner import PlanResult
from unwrinkle.planning.trajectory import AXES
from unwrinkle.planning.verification.verdict import Verdict


class Shared:
    """Base of frozen values that are shared, never copied."""

    def __copy__(self) -> Self:
        """Return the value itself."""
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        """Return the value itself."""
        return self


@dataclass(frozen=True, eq=False)
class Perceived(Shared):
    """What a look gave.

    Attributes:
        number: of the head command whose pictures it is from; 0 before the first.
        range_map: of the garment; None where there is none.
        reason: why there is none; else empty.
        empty: the table was seen, and no garment on it.
        unseen: a garment lower than this the sensor does not tell from the table, m.
        seconds: of computing, wall clock.
    """

    number: int = 0
    range_map: RangeMap | None = None
    reason: str = ""
    empty: bool = False
    unseen: float = 0.0
    seconds: float = 0.0


@dataclass(frozen=True, eq=False)
class Analysed(Shared):
    """What was found on a range map.

    Attributes:
        number: of the look.
        analysis: wrinkles, largest first; None where there is none.
        reason: why there is none; else empty.
        seconds: of computing, wall clock.
    """

    number: int = 0
    analysis: Analysis | None = None
    reason: str = ""
    seconds: float = 0.0


def _nowhere() -> NDArray[np.float64]:
    nowhere = np.zeros(AXES)
    nowhere.setflags(write=False)
    return nowhere


@dataclass(frozen=True, eq=False)
class PlanRequest(Shared):
    """What is to be planned.

    Attributes:
        number: counts up with every request; 0 is none.
        look: number of the look that the wrinkle is counted in.
        wrinkle: its index, largest first.
        arms: any, dual or single.
        start: (13,) where the robot stands, rad.
    """

    number: int = 0
    look: int = 0
    wrinkle: int = 0
    arms: str = "any"
    start: NDArray[np.float64] = field(default_factory=_nowhere)

    def __post_init__(self) -> None:
        """Copy and freeze the start."""
        start = np.array(self.start, dtype=float)
        start.setflags(write=False)
        object.__setattr__(self, "start", start)


@dataclass(frozen=True, eq=False)
class Planned(Shared):
    """What planning gave.

    Attributes:
        number: of the request; 0 before the first.
        result: of the planner; None where there was nothing to plan for.
        reason: why there is no plan; else empty.
        seconds: of computing, wall clock.
        request: what was asked.
    """

    number: int = 0
    result: PlanResult | None = None
    reason: str = ""
    seconds: float = 0.0
    request: PlanRequest = field(default_factory=PlanRequest)


@dataclass(frozen=True, eq=False)
class Verified(Shared):
    """What verification says of a plan.

    Attributes:
        number: of the request; 0 before the first.
        plan_hash: content hash of the plan; empty where there is none.
        verdict: None where there was no plan.
        seconds: of computing, wall clock.
        reason: why there is no verdict; else empty.
    """

    number: int = 0
    plan_hash: str = ""
    verdict: Verdict | None = None
    seconds: float = 0.0
    reason: str = ""
