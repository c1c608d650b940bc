"""Steps of a plan in order: segments, gripper strokes, and the way back from a missed grasp."""

from dataclasses import dataclass
from enum import StrEnum

from unwrinkle.flattening.execution.retreat import retreat
from unwrinkle.models.shared import Shared
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.trajectory import Trajectory

#: Names of the strokes, in the order of a plan's events.
STROKES = ("close", "open")


class StepKind(StrEnum):
    """Kinds of a step."""

    MOVE = "move"
    GRIP = "grip"
    RETREAT = "retreat"


@dataclass(frozen=True, eq=False)
class Step(Shared):
    """A step of an execution.

    Attributes:
        name: approach, close, pull, open, release or retreat.
        kind: of the step.
        trajectory: of a motion; None for a stroke.
        closed: whether the right and the left gripper are closed, during a motion or at the end of
            a stroke.
        dwell: least time for a stroke, s.
    """

    name: str
    kind: StepKind
    trajectory: Trajectory | None = None
    closed: tuple[bool, bool] = (False, False)
    dwell: float = 0.0


@dataclass(frozen=True)
class StepRecord(Shared):
    """Record of an executed step; times on the caller's clock, s.

    Attributes:
        name: of the step.
        number: of the command.
        sent: time of the command.
        finished: time at which the device reported it done.
    """

    name: str
    number: int
    sent: float
    finished: float


def steps_of(plan: FlatteningPlan) -> tuple[Step, ...]:
    """Return the segments and strokes of a plan in order: approach, close, pull, open, release."""
    steps: list[Step] = []
    for index, segment in enumerate(plan.segments):
        steps.append(Step(segment.name, StepKind.MOVE, segment.trajectory, segment.closed))
        if index < len(plan.events):
            event = plan.events[index]
            stroke = Step(STROKES[index], StepKind.GRIP, closed=event.closed, dwell=event.dwell)
            steps.append(stroke)
    return tuple(steps)


def steps_back(plan: FlatteningPlan) -> tuple[Step, ...]:
    """Return the steps after a missed grasp: open, and retreat along the verified approach.

    Raises:
        InputError: the approach cannot be run backwards.
    """
    dwell = plan.events[0].dwell
    return (
        Step("open", StepKind.GRIP, dwell=dwell),
        Step("retreat", StepKind.RETREAT, retreat(plan.segments[0])),
    )
