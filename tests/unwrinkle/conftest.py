"""Fixtures of the tests of pages and pictures: a plan that waves its arms, and the garment beside it."""

from collections.abc import Callable

import numpy as np
import pytest

from unwrinkle.models.robot import Cell, load_cell
from unwrinkle.perception.target import FlatteningTarget, HandTarget
from unwrinkle.planning.plan import (
    ArmChoice,
    FlatteningPlan,
    GarmentSurface,
    GripperEvent,
    PoseMark,
    Segment,
)
from unwrinkle.planning.poses import POSES
from unwrinkle.planning.trajectory import Trajectory

RIGHT, LEFT = ArmChoice(1, 0.1, 0.8, 1.0), ArmChoice(0, -0.1, 0.9, 0.5)


@pytest.fixture(scope="session")
def cell() -> Cell:
    return load_cell()


def _garment(n: int = 12) -> GarmentSurface:
    x, y = np.meshgrid(np.linspace(-0.2, 0.2, n), np.linspace(-1.3, -0.9, n))
    z = 0.7 + 0.02 * np.exp(-((x / 0.02) ** 2))
    p_WV = np.column_stack([x.ravel(), y.ravel(), z.ravel()]).astype(np.float32)
    index = np.arange(n * n).reshape(n, n)
    a, b = index[:-1, :-1].ravel(), index[:-1, 1:].ravel()
    c, d = index[1:, 1:].ravel(), index[1:, :-1].ravel()
    triangles = np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    colours = np.full((n * n, 3), 150, dtype=np.uint8)
    ridge = np.array([[0.0, -1.2, 0.72], [0.0, -1.1, 0.72], [0.0, -1.0, 0.72]], dtype=np.float32)
    corners = p_WV[index[[0, 0, -1, -1, 0], [0, -1, -1, 0, 0]]]
    return GarmentSurface(p_WV, triangles.astype(np.int32), colours, ridge, corners)


def _plan(
    cell: Cell, *, stretch: float = 1.0, garment: GarmentSurface | None = None
) -> FlatteningPlan:
    """A plan that waves its arms from home and back, each segment of the duration 1 s * stretch."""
    times = stretch * np.linspace(0.0, 1.0, 41)
    s, v = np.linspace(0.0, 1.0, 41), 1.0 / stretch
    rise, slope = s * s * (3.0 - 2.0 * s), 6.0 * s * (1.0 - s) * v
    way = np.linspace(0.1, 0.3, 13)
    legs = ((0.0, 1.0), (1.0, 1.5), (1.5, 0.0))
    marks = ((0.5, 0.8, 1.0), (0.5, 1.0), (0.3, 0.6))
    names = iter(POSES)
    segments, clock = [], 0.0
    for k, (a, b) in enumerate(legs):
        positions = np.outer(a + (b - a) * rise, way)
        poses = tuple(PoseMark(next(names), m * stretch) for m in marks[k])
        closed = (True, True) if k == 1 else (False, False)
        segments.append(
            Segment(
                ("approach", "pull", "release")[k],
                clock,
                Trajectory(times, positions, np.outer((b - a) * slope, way)),
                closed,
                poses,
                (0.0, stretch),
            )
        )
        clock += stretch + 0.75
    ends = [segment.end for segment in segments]
    hands = tuple(
        HandTarget(np.array([x, -1.1, 0.7]), np.array([-np.sign(x), 0.0]), np.array([u, 0.0]), 0.02)
        for x, u in ((0.2, 1.0), (-0.2, -1.0))
    )
    return FlatteningPlan(
        robot=cell.robot.name,
        robot_hash=cell.robot_hash,
        limits_hash=cell.limits_hash,
        speed=1.0,
        target=FlatteningTarget(
            (hands[0], hands[1]), np.array([0.0, -1.1, 0.72]), np.array([0.0, 1.0]), 0.44, "foot"
        ),
        arms=(RIGHT, LEFT),
        turntable=0.0,
        segments=tuple(segments),
        events=(
            GripperEvent(ends[0], (True, True), 0.75),
            GripperEvent(ends[1], (False, False), 0.75),
        ),
        garment=garment,
    )


@pytest.fixture(scope="session")
def waving_plan(cell: Cell) -> Callable[..., FlatteningPlan]:
    """Make a plan: its duration over 3.5 s, and the number of the garment's vertices a side."""

    def make(stretch: float = 1.0, vertices: int = 12) -> FlatteningPlan:
        return _plan(cell, stretch=stretch, garment=_garment(vertices))

    return make


@pytest.fixture(scope="session")
def plan(waving_plan: Callable[..., FlatteningPlan]) -> FlatteningPlan:
    return waving_plan()
