"""Settings of the planner: the shape of the seven-pose motion, and the freedoms the search may use."""

from dataclasses import dataclass, field, replace
from math import radians


@dataclass(frozen=True)
class MotionShape:
    """Distances of the seven poses, m. Steps are along the tool's horizontal approach direction.

    Attributes:
        touch_distance: from the grasp point back to where the blade meets the table.
        back_off: from there further back to the plan pose.
        height: of the plan and leave poses above the table.
        lift: of the pull pose above the table.
        table_gap: between the lower blade's edge and the table when down.
        free_distance: from the put-down point back to where the blade is out of the cloth.
        leave_distance: from the put-down point back to the leave pose.
        blend: radius of the rounded corners.
    """

    touch_distance: float = 0.060
    back_off: float = 0.050
    height: float = 0.120
    lift: float = 0.015
    table_gap: float = 0.003
    free_distance: float = 0.050
    leave_distance: float = 0.080
    blend: float = 0.035


NORMAL_STROKE = MotionShape()
SHORT_STROKE = MotionShape(
    touch_distance=0.030,
    back_off=0.0,
    height=0.100,
    free_distance=0.020,
    leave_distance=0.020,
    blend=0.025,
)


@dataclass(frozen=True)
class Stage:
    """One round of the search: every combination of its freedoms, cheapest first. Angles in rad."""

    offsets: tuple[float, ...] = (0.0,)
    tilts: tuple[float, ...] = (radians(45), radians(60), radians(30))
    turntable: tuple[float, ...] = (0.0,)
    swap: bool = False
    shape: MotionShape = NORMAL_STROKE
    shares: tuple[tuple[float, float], ...] = ((1.0, 1.0),)


def _degrees(*values: float) -> tuple[float, ...]:
    return tuple(radians(value) for value in values)


_TILTS = _degrees(45, 60, 30, 75, 90)
_TURNS = _degrees(0, 15, -15, 30, -30, 45, -45)
_WIDE_TURNS = (*_TURNS, *_degrees(60, -60, 75, -75, 90, -90))
_OFFSETS = _degrees(0, 15, -15, 30, -30)
_WIDE_OFFSETS = (*_OFFSETS, *_degrees(45, -45, 60, -60))

STAGES = (
    Stage(),
    Stage(tilts=_TILTS, turntable=_TURNS),
    Stage(tilts=_TILTS, turntable=_TURNS, offsets=_OFFSETS, swap=True),
    Stage(tilts=_TILTS, turntable=_WIDE_TURNS, offsets=_WIDE_OFFSETS, swap=True),
    Stage(
        tilts=_TILTS,
        turntable=_WIDE_TURNS,
        offsets=_WIDE_OFFSETS,
        swap=True,
        shape=SHORT_STROKE,
        shares=((1.0, 1.0), (1.5, 0.5), (0.5, 1.5), (2.0, 0.0), (0.0, 2.0)),
    ),
)


@dataclass(frozen=True)
class PlannerSettings:
    """What the planner may do and how long it may take.

    Attributes:
        stages: rounds of the search, in order.
        budget: s, after which the search gives up and says so.
        transit_budget: s, for one transit found by sampling.
        path_step: m, distance of the points at which Cartesian pieces are solved.
        sample_time: s, period of the samples that a plan carries at catalogue speed; a slower plan has a longer one, see
            `sampling_period`.
        margin: fraction of velocity, acceleration and jerk limits that the timing leaves unused, for the controller's
            cubic interpolation between samples.
        seed: of the sampling transit planner.
        refusals: so many plans of one kind (two arms, one arm) may be refused by whoever is asked, before it is given up.
        longest: s, of one piece of a motion; a plan that takes longer is refused.
    """

    stages: tuple[Stage, ...] = STAGES
    budget: float = 5.0
    transit_budget: float = 2.0
    path_step: float = 0.010
    sample_time: float = 0.008
    margin: float = 0.015
    seed: int = 0
    refusals: int = 8
    longest: float = 600.0
    weights: "CostWeights" = field(default_factory=lambda: CostWeights())


@dataclass(frozen=True)
class CostWeights:
    """Cost of a candidate per unit of each freedom: offsets weigh, the rest are preferences.

    Algorithm 1 of the paper multiplies the two arms' offsets, which lets one arm's offset be free where the other's is zero;
    here they are summed.
    """

    offset: float = 1.0 / radians(15)
    turntable: float = 0.02 / radians(15)
    tilt: float = 0.01 / radians(15)
    preferred_tilt: float = radians(52.5)
    swap: float = 0.05
    share: float = 0.5


def with_turntable_at(settings: PlannerSettings, angle: float) -> PlannerSettings:
    """The settings with every stage's turn-table at one angle, rad."""
    stages = tuple(replace(stage, turntable=(angle,)) for stage in settings.stages)
    return replace(settings, stages=stages)
