"""Settings of the planner: shape of the seven-pose motion, freedoms and costs of the search,
sampling of transits.
"""

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
        pull_fraction: of the pull distance that is done when the pull pose is reached (no unit).
            The rest follows while the hand is lowered: cloth that is pulled fully while lifted
            becomes slack again on the table.
        table_gap: between the lower blade's edge and the table when down.
        free_distance: from the put-down point back to where the blade is out of the cloth.
        leave_distance: from the put-down point back to the leave pose.
        blend: radius of the rounded corners.
    """

    touch_distance: float = 0.060
    back_off: float = 0.050
    height: float = 0.120
    lift: float = 0.015
    pull_fraction: float = 0.5
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
    """One round of the search: every combination of its freedoms, cheapest first. Angles in rad.

    Attributes:
        offsets: turns of the grasp direction about the vertical.
        tilts: of the tool below the horizontal.
        turntable: angles of the turn-table.
        swap: whether each arm may also serve the hand on the other side.
        shape: distances of the seven poses.
        shares: pull distances of the target's two hands over their nominal ones.
    """

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
class CostWeights:
    """Cost of a candidate per unit of each freedom: the offsets dominate, the rest are preferences.

    Algorithm 1 of the paper multiplies the two arms' offsets, so that one arm's offset costs
    nothing where the other's is zero; here they are summed.

    Attributes:
        offset: per rad of the grasp direction's turn, each hand.
        turntable: per rad of the turn-table's angle.
        tilt: per rad of the tilt's difference from `preferred_tilt`, each hand.
        preferred_tilt: of the tool below the horizontal, rad; the middle of the default gripper's
            window.
        swap: for arms that serve the hand on the other side.
        share: per unit by which a hand's share of the pull differs from 1, half for each hand.
    """

    offset: float = 1.0 / radians(15)
    turntable: float = 0.02 / radians(15)
    tilt: float = 0.01 / radians(15)
    preferred_tilt: float = radians(52.5)
    swap: float = 0.05
    share: float = 0.5


@dataclass(frozen=True)
class TransitSettings:
    """How transits are sampled where no straight joint line is free.

    Attributes:
        leans: angles added to the second axis (L) of both arms half way, rad; negative leans the
            upper arms back, away from the table. Tried in this order.
        step: growth of a tree at a time, m: joint motion weighted by half the reach of each axis.
        turntable_spread: standard deviation of the samples about the straight line, rad.
        arm_spread: the same for the axes S, L, U, R, B, T of each arm; it grows from half to twice
            this with the samples.
        shortcuts: attempts at shortening a path that was found.
    """

    leans: tuple[float, ...] = (-0.15, -0.3)
    step: float = 1.2
    turntable_spread: float = 0.15
    arm_spread: tuple[float, ...] = (0.4, 0.4, 0.4, 0.5, 0.4, 0.4)
    shortcuts: int = 30


@dataclass(frozen=True)
class PlannerSettings:
    """Freedoms and budgets of the planner.

    Attributes:
        stages: rounds of the search, in order.
        budget: of one search, s; when it is spent the failure says so.
        transit_budget: of one transit found by sampling, s.
        path_step: distance of the points at which Cartesian pieces are solved, m.
        sample_time: s, period of the samples that a plan carries at catalogue speed; a slower plan
            has a longer one, see `sampling_period`.
        margin: fraction of velocity, acceleration and jerk limits that the timing leaves unused,
            for the controller's cubic interpolation between samples.
        seed: of the sampling transit planner.
        refusals: plans of one kind (two arms, one arm) that may be refused by `approve` before that
            kind is given up.
        longest: duration of one piece of a motion above which a plan is refused, s.
        weights: cost of the search's freedoms.
        transit: how transits are sampled.
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
    weights: CostWeights = field(default_factory=CostWeights)
    transit: TransitSettings = field(default_factory=TransitSettings)


def with_turntable_at(settings: PlannerSettings, angle: float) -> PlannerSettings:
    """Return the settings with the turn-table of every stage fixed at an angle, rad."""
    stages = tuple(replace(stage, turntable=(angle,)) for stage in settings.stages)
    return replace(settings, stages=stages)
