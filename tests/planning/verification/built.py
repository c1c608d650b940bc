"""Legs, tool motions and a plan at rest, built from a few numbers."""

import dataclasses as dc
from collections.abc import Callable, Sequence

import numpy as np

from unwrinkle.models.arrays import Array
from unwrinkle.models.robot import Cell
from unwrinkle.perception.target import FlatteningTarget
from unwrinkle.planning.plan import ArmChoice, FlatteningPlan, GripperEvent, PoseMark, Segment
from unwrinkle.planning.trajectory import Trajectory
from unwrinkle.planning.verification.motion import JOINTS, Leg
from unwrinkle.planning.verification.tools import ToolLeg, ToolMotion
from unwrinkle.planning.verification.verdict import Check, Findings

#: Axes of a plan.
AXES = 13
#: Height of the working table of the shipped cell, m.
TABLE = 0.70


def leg(
    times: Sequence[float],
    positions: dict[int, Sequence[float]] | None = None,
    velocities: dict[int, Sequence[float]] | None = None,
    *,
    name: str = "pull",
    held: bool = False,
    contact: tuple[float, float] | None = None,
) -> Leg:
    """A leg in which a few columns move and the others stay at 0."""
    clock = np.array(times, dtype=float)
    values = []
    for columns in (positions or {}, velocities or {}):
        array = np.zeros((len(clock), JOINTS))
        for column, samples in columns.items():
            array[:, column] = samples
        values.append(array)
    return Leg(name, clock, *values, held, contact)


def wild_leg(seed: int, count: int = 5, **fields: object) -> Leg:
    """A leg through random samples at uneven times."""
    rng = np.random.default_rng(seed)
    times = 1.0 + np.cumsum(rng.uniform(0.1, 0.6, count))
    positions, velocities = rng.uniform(-1.0, 1.0, (2, count, JOINTS))
    return Leg(
        str(fields.get("name", "pull")),
        times,
        positions,
        3.0 * velocities,
        held=False,
        contact=None,
    )


def tool(
    times: Sequence[float],
    p_WT: Array,
    *,
    R_WT: Array | None = None,
    velocity: Array | None = None,
    P2: float = 0.0,
    Q2: float = 0.0,
    P3: float = 0.0,
    W2: float = 0.0,
) -> ToolMotion:
    """A tool's motion through places (n, 3), with the same bounds in every interval."""
    count = len(times)
    X = np.tile(np.eye(4), (count, 1, 1))
    X[:, :3, 3] = p_WT
    if R_WT is not None:
        X[:, :3, :3] = R_WT
    v = np.zeros((count, 3)) if velocity is None else np.asarray(velocity, dtype=float)
    bounds = (np.full(count - 1, value) for value in (P2, Q2, P3, W2))
    return ToolMotion(np.array(times, dtype=float), X, v, *bounds)


def tool_leg(right: ToolMotion, left: ToolMotion, like: Leg | None = None) -> ToolLeg:
    """The tools' motion over a leg, by default one that holds cloth and whose axes rest."""
    return ToolLeg(like if like is not None else leg(right.times, held=True), (right, left))


def resting_plan(cell: Cell, target: FlatteningTarget) -> FlatteningPlan:
    """A plan whose structure is as required and whose axes never leave home.

    Approach 0 to 2 s, pull 2.5 to 3.5 s, release 4 to 6 s.
    """

    def segment(
        name: str,
        start: float,
        duration: float,
        poses: dict[str, float],
        contact: tuple[float, float],
        closed: bool = False,
    ) -> Segment:
        times = np.array([0.0, 0.5 * duration, duration])
        still = np.zeros((3, AXES))
        marks = tuple(PoseMark(key, time) for key, time in poses.items())
        trajectory = Trajectory(times, still, still)
        return Segment(name, start, trajectory, (closed, closed), marks, contact)

    return FlatteningPlan(
        robot=cell.robot.name,
        robot_hash=cell.robot_hash,
        limits_hash=cell.limits_hash,
        speed=cell.scenario.speed,
        target=target,
        arms=(
            ArmChoice(0, offset=0.0, tilt=np.radians(45.0), share=1.0),
            ArmChoice(1, offset=0.0, tilt=np.radians(45.0), share=1.0),
        ),
        turntable=0.0,
        segments=(
            segment(
                "approach", 0.0, 2.0, {"plan": 1.0, "touch-table": 1.5, "grasp": 2.0}, (1.0, 2.0)
            ),
            segment("pull", 2.5, 1.0, {"pull": 0.5, "put-on-table": 1.0}, (0.0, 1.0), closed=True),
            segment("release", 4.0, 2.0, {"free-garment": 0.5, "leave-table": 1.0}, (0.0, 1.0)),
        ),
        events=(GripperEvent(2.0, (True, True), 0.5), GripperEvent(3.5, (False, False), 0.5)),
    )


def alone(plan: FlatteningPlan, arm: int) -> FlatteningPlan:
    """The plan in which the other arm takes no part."""
    arms: list[ArmChoice | None] = [None, None]
    arms[arm] = plan.arms[arm]
    return dc.replace(plan, arms=(arms[0], arms[1]))


def found_by(check: Callable[..., object], *values: object) -> Findings:
    """What a check finds."""
    found = Findings()
    check(*values, found)
    return found


def kinds_of(found: Findings) -> set[str]:
    """The kinds of violation."""
    return {violation.kind for violation in found.violations}


def result(found: Findings, name: str) -> Check:
    """The check of that name."""
    return next(check for check in found.checks() if check.name == name)


def times_of(found: Findings, kind: str) -> list[float | None]:
    """The times of the violations of a kind, s."""
    return [violation.time for violation in found.violations if violation.kind == kind]
