"""The verification's own parts against brute force, and unchanged plans that all pass."""

import dataclasses as dc
import json
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.geometry import (
    Box,
    Cylinder,
    FramePoseVector,
    GeometryFrame,
    GeometryInstance,
    ProximityProperties,
    SceneGraph,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform
from scipy.optimize import lsq_linear

from unwrinkle.models.robot import Cell
from unwrinkle.perception.target import FlatteningTarget
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.search.planner import FlatteningPlanner
from unwrinkle.planning.trajectory import Trajectory
from unwrinkle.planning.verification.clearance import _pair_speeds
from unwrinkle.planning.verification.joint_limits import JUMP_FACTOR
from unwrinkle.planning.verification.model import CellModel
from unwrinkle.planning.verification.motion import Leg, legs
from unwrinkle.planning.verification.shapes import face_gaps, gaps, measure, outlines
from unwrinkle.planning.verification.speed_bounds import (
    derivative_bounds,
    distances_to_axes,
    speed_bounds,
)
from unwrinkle.planning.verification.verdict import CHECKS, NEAR_BY_DESIGN
from unwrinkle.planning.verification.verifier import verify

Targets = Callable[[int, int], list[FlatteningTarget]]


@pytest.fixture(scope="module")
def model(cell: Cell) -> CellModel:
    return CellModel(cell)


@pytest.fixture(scope="module")
def plan(
    planner: FlatteningPlanner, make_target: Callable[..., FlatteningTarget]
) -> FlatteningPlan:
    result = planner.plan(make_target(phi=np.radians(70.0), half=0.22, pull=0.02))
    assert result.plan is not None
    return result.plan


def random_leg(rng: np.random.Generator, count: int = 6, scale: float = 1.0) -> Leg:
    """A wild motion through random samples."""
    return Leg(
        "approach",
        np.cumsum(rng.uniform(0.05, 0.15, count)),
        scale * rng.uniform(-0.4, 0.4, (count, 15)) * np.append(np.ones(13), [0.03, 0.03]),
        scale * rng.uniform(-2.0, 2.0, (count, 15)) * np.append(np.ones(13), [0.0, 0.0]),
        held=True,
        contact=None,
    )


# Extremes of the cubic.


@given(st.lists(st.floats(-3.0, 3.0), min_size=4, max_size=4), st.floats(0.01, 1.0))
@settings(max_examples=200, deadline=None)
def test_extremes_are_exact(values: list[float], step: float) -> None:
    p0, p1, v0, v1 = values
    leg = Leg(
        "approach",
        np.array([1.0, 1.0 + step]),
        np.array([[p0] * 15, [p1] * 15]),
        np.array([[v0] * 15, [v1] * 15]),
        held=False,
        contact=None,
    )
    t = np.linspace(0.0, step, 2001)
    a, j = leg.acceleration[0][0, 0], leg.jerk[0, 0]
    p = p0 + t * (v0 + t * (a / 2 + t * j / 6))
    v = v0 + t * (a + t * j / 2)
    scale = 1.0 + np.abs(p).max() + np.abs(v).max()
    assert p[-1] == pytest.approx(p1, abs=1e-9 * scale)
    assert v[-1] == pytest.approx(v1, abs=1e-9 * scale)
    assert leg.at(1.0 + 0.3 * step)[4] == pytest.approx(
        np.interp(0.3 * step, t, p), abs=1e-5 * scale
    )
    low, high = leg.position_extremes()
    assert low[0, 0] <= p.min() + 1e-9 * scale
    assert high[0, 0] >= p.max() - 1e-9 * scale
    assert low[0, 0] == pytest.approx(p.min(), abs=1e-5 * scale)
    assert high[0, 0] == pytest.approx(p.max(), abs=1e-5 * scale)
    assert leg.greatest_velocity[0, 0] >= np.abs(v).max() - 1e-9 * scale
    assert leg.greatest_velocity[0, 0] == pytest.approx(np.abs(v).max(), abs=1e-5 * scale)
    assert leg.greatest_acceleration[0, 0] == pytest.approx(max(abs(a), abs(a + j * step)))


@pytest.mark.parametrize("mirrored", [True, False])
def test_jump_bound_is_sharp(mirrored: bool) -> None:
    """Jerk of +-1 that switches once before and once after a sample.

    The bound is nearly met, never passed.
    """
    count = 3000
    worst = 0.0
    for switch in np.linspace(0.0, 1.0, 61):
        before = np.where(np.arange(count) < switch * count, -1.0, 1.0)
        jerk = np.concatenate([before, before[::-1] if mirrored else -before])
        a = np.concatenate([[0.0], np.cumsum(jerk) / count])
        v = np.concatenate([[0.0], np.cumsum(0.5 * (a[1:] + a[:-1])) / count])
        # Exact for piecewise constant jerk.
        p = np.concatenate(
            [[0.0], np.cumsum(v[:-1] + a[:-1] / 2 / count + jerk / 6 / count**2) / count]
        )
        rows = [0, count, 2 * count]
        p, v = (np.repeat(x[rows, None], 15, axis=1) for x in (p, v))
        leg = Leg("approach", np.arange(3.0), p, v, held=False, contact=None)
        begin, end = leg.acceleration
        worst = max(worst, abs(begin[1, 0] - end[0, 0]))
        assert np.abs(leg.jerk[:, 0]).max() <= 1.0 + 1e-6
    assert worst <= 2 * JUMP_FACTOR + 1e-6
    assert not mirrored or worst >= 0.98 * 2 * JUMP_FACTOR


# Bounds of motion.


@pytest.mark.parametrize("seed", range(3))
def test_no_point_is_faster_than_its_bound(model: CellModel, seed: int) -> None:
    leg = random_leg(np.random.default_rng(seed))
    X_WJ, _ = model.frames(leg.positions)
    directions = model.axis_directions()
    tightest = 0.0
    for chain, corners in zip(model.chains, model.corners, strict=True):
        rho = distances_to_axes(corners, X_WJ, directions, chain)
        prismatic = [model.prismatic[joint] for joint in chain]
        bound = speed_bounds(rho, leg.step[:, 0], leg.greatest_velocity[:, chain], prismatic)
        for i, h in enumerate(leg.step[:, 0]):
            t = leg.times[i] + np.linspace(0.0, h, 60)
            X, _ = model.frames(np.array([leg.at(float(time)) for time in t]))
            last = X[:, chain[-1]]
            p_W = np.einsum("nij,mj->nmi", last[:, :3, :3], corners) + last[:, None, :3, 3]
            # Against the world, and against the frame of the chain's first joint.
            for k, base in ((0, np.broadcast_to(np.eye(4), X[:, 0].shape)), (1, X[:, chain[0]])):
                p = np.einsum("nji,nmj->nmi", base[:, :3, :3], p_W - base[:, None, :3, 3])
                path = np.linalg.norm(np.diff(p, axis=0), axis=2).sum(axis=0)
                assert path.max() <= bound[i, k] * h * (1.0 + 1e-9) + 1e-12
                if k == 0:
                    tightest = max(tightest, path.max() / (bound[i, 0] * h))
    assert tightest > 0.3


@pytest.mark.parametrize("seed", range(3))
def test_derivatives_of_a_tip_keep_their_bounds(model: CellModel, seed: int) -> None:
    leg = random_leg(np.random.default_rng(seed))
    X_WJ, X_WT = model.frames(leg.positions)
    chain = (0, 7, 8, 9, 10, 11, 12)
    p_JT = (np.linalg.inv(X_WJ[0, 12]) @ X_WT[0, 1])[None, :3, 3]
    rho = distances_to_axes(p_JT, X_WJ, model.axis_directions(), chain)
    columns = list(chain)
    bounds = derivative_bounds(
        rho,
        leg.step[:, 0],
        leg.greatest_velocity[:, columns],
        leg.greatest_acceleration[:, columns],
        np.abs(leg.jerk)[:, columns],
    )
    for i, h in enumerate(leg.step[:, 0]):
        t = np.linspace(0.0, h, 81)
        positions = np.array([leg.at(float(leg.times[i] + time)) for time in t])
        p = model.frames(positions)[1][:, 1, :3, 3]
        for order, bound in enumerate(bounds, start=1):
            derivative = np.diff(p, n=order, axis=0) / (t[1] ** order)
            assert np.linalg.norm(derivative, axis=1).max() <= bound[i] * (1.0 + 1e-6) + 1e-6


# Distances.


def random_pairs(
    model: CellModel, seed: int, count: int
) -> tuple[np.ndarray, np.ndarray, tuple[np.ndarray, np.ndarray], np.ndarray]:
    rng = np.random.default_rng(seed)
    first, second = rng.integers(0, len(model.shapes.ids), (2, count))
    R = np.linalg.qr(rng.normal(size=(2, count, 3, 3)))[0]
    return first, second, (R[0], R[1]), rng.normal(scale=0.8, size=(count, 3))


def test_gaps_never_exceed_the_distance_of_boxes(model: CellModel) -> None:
    first, second, R, p = random_pairs(model, 0, 300)
    boxes = (model.shapes.disk[first] + model.shapes.disk[second]) == 0.0
    face = face_gaps(model.shapes, first, second, R, p)
    exact = 0
    for k in np.flatnonzero(boxes):
        limit = np.concatenate([model.shapes.half[first[k]], model.shapes.half[second[k]]])
        matrix = np.hstack([R[0][k], -R[1][k]])
        x = lsq_linear(matrix, p[k], bounds=(-limit, limit), method="bvls", tol=1e-14).x
        between = p[k] - matrix @ x
        distance = np.linalg.norm(between)
        assert face[k] <= distance + 1e-9
        if distance > 1e-6:
            one = [k]
            n = (between / distance)[None, None]
            gap = gaps(model.shapes, first[one], second[one], (R[0][one], R[1][one]), p[one], n)
            assert gap[0, 0] == pytest.approx(distance, abs=1e-9)
            exact += 1
    assert exact > 100


def measured(
    shapes: tuple[Shape, Shape], poses: tuple[RigidTransform, RigidTransform]
) -> tuple[float, float]:
    """What Drake claims for two shapes, and what is bounded."""
    scene_graph = SceneGraph()
    source = scene_graph.RegisterSource("test")
    ids = []
    for i, (shape, pose) in enumerate(zip(shapes, poses, strict=True)):
        frame = scene_graph.RegisterFrame(source, GeometryFrame(f"frame{i}"))
        instance = GeometryInstance(pose, shape, f"shape{i}")
        instance.set_proximity_properties(ProximityProperties())
        ids.append(scene_graph.RegisterGeometry(source, frame, instance))
    context = scene_graph.CreateDefaultContext()
    vector = FramePoseVector()
    inspector = scene_graph.model_inspector()
    for geometry in ids:
        vector.set_value(inspector.GetFrameId(geometry), RigidTransform())
    scene_graph.get_source_pose_port(source).FixValue(context, vector)
    query = scene_graph.get_query_output_port().Eval(context)
    claimed = query.ComputeSignedDistancePairClosestPoints(*ids).distance
    R = tuple(pose.rotation().matrix() for pose in poses)
    p = poses[1].translation() - poses[0].translation()
    bounded, _ = measure(query, outlines(inspector, ids, "test"), 0, 1, (R[0], R[1]), p)
    return claimed, bounded


def test_parallel_boxes_that_drake_gets_wrong() -> None:
    """FCL issue 508: two unit cubes 4 m apart along y are 3 m, not 3.16 m apart."""
    poses = RigidTransform(), RigidTransform([0.0, 4.0, 0.0])
    claimed, bounded = measured((Box(1, 1, 1), Box(1, 1, 1)), poses)
    assert bounded == pytest.approx(3.0, abs=1e-12)
    assert claimed >= 3.0 - 1e-9


def test_round_shapes() -> None:
    away = RigidTransform([0.3, 0.4, 0.0])
    _, bounded = measured((Cylinder(0.1, 0.5), Sphere(0.05)), (RigidTransform(), away))
    assert bounded == pytest.approx(0.35, abs=1e-5)
    assert bounded <= 0.35 + 1e-9
    _, deep = measured(
        (Box(0.2, 0.2, 0.2), Box(0.2, 0.2, 0.2)), (RigidTransform(), RigidTransform([0.19, 0, 0]))
    )
    assert deep == pytest.approx(-0.01, abs=1e-9)


# Pairs.


def test_pairs_have_the_right_padding(cell: Cell, model: CellModel) -> None:
    pairs = {frozenset(pair.names): pair for pair in model.pairs}

    def padding(a: str, b: str) -> tuple[str, float]:
        pair = pairs[frozenset((a, b))]
        return pair.kind, pair.required

    assert padding("r1::link_4", "r2_gripper::palm") == ("arm-arm", 0.030)
    assert padding("r1::link_6", "t2::desk") == ("arm-table", 0.020)
    assert padding("r2_gripper::palm", "t2::desk") == ("palm-table", 0.010)
    assert padding("r2_gripper::upper_finger", "t2::desk") == ("finger-table", 0.010)
    assert padding("r2_gripper::upper_finger", "t1::desk") == ("surroundings", 0.010)
    assert padding("r1::link_3", "turntable::mast") == ("surroundings", 0.010)
    assert padding("r1::link_3", "left_ptu::tilted") == ("surroundings", 0.010)
    assert padding("r1::link_5", "floor::slab") == ("surroundings", 0.010)
    assert padding("turntable::r750", "t1::desk") == ("surroundings", 0.010)
    assert padding("r1::link_2", "turntable::r750") == ("adjacent", 0.0)
    assert padding("r1::link_3", "r1::link_5") == ("self", 0.0)
    for a, b in (
        ("r1::link_1", "r1::link_2"),
        ("r1::link_7", "r1_gripper::palm"),
        ("r1_gripper::lower_finger", "r1_gripper::upper_finger"),
        ("t1::desk", "floor::slab"),
        ("turntable::r750", "turntable::mast"),
    ):
        assert frozenset((a, b)) not in pairs
    # Fingers alone may touch the table, each arm's in that arm's contact windows.
    for pair in model.pairs:
        sides = [name.startswith(f"r{i}") for i in (1, 2) for name in pair.names]
        arm = 0 if any(sides[:2]) else 1
        assert pair.arm == (arm if pair.kind == "finger-table" else -1), pair.names
    # Every body of one arm meets every body of the other, but the two bases, which are bolted to
    # one plate.
    arm_arm = [pair for pair in model.pairs if pair.kind == "arm-arm"]
    assert len(arm_arm) == 10 * 10 - 1


def test_a_gripper_moves_its_upper_blade_alone(model: CellModel) -> None:
    q = np.random.default_rng(5).uniform(-0.5, 0.5, 13)
    X_WJ, X_WT = model.frames(np.array([[*q, 0.03, 0.0], [*q, 0.0, 0.0]]))
    assert np.allclose(X_WT[0], X_WT[1], atol=1e-12)
    moved = np.linalg.norm(X_WJ[0, :, :3, 3] - X_WJ[1, :, :3, 3], axis=1)
    assert moved[13] == pytest.approx(0.03)
    assert np.delete(moved, 13).max() < 1e-12


# Whole plans.


@pytest.mark.slow
def test_bounds_of_clearances_hold_in_brute_force(
    plan: FlatteningPlan, cell: Cell, model: CellModel
) -> None:
    """At 800 times, no pair is nearer than its bound, nor much nearer than the distance found."""
    verdict = verify(plan, cell)
    assert verdict.passed
    smallest = np.full(len(model.pairs), np.inf)
    lipschitz = -np.inf
    for leg in legs(plan, cell.scenario.gripper.opening):
        X_WJ, _ = model.frames(leg.positions)
        speed = _pair_speeds(model, leg, X_WJ)
        clock = np.vstack([np.zeros(len(model.pairs)), np.cumsum(speed * leg.step, axis=0)])
        before = None
        times = np.linspace(leg.times[0], leg.times[-1], 160)
        for time in times:
            q = leg.at(float(time))
            query = model.set_positions(q)
            axes, centres = (a[0] for a in model.outline_poses(model.frames(q[None])[0]))
            R = axes[model.first], axes[model.second]
            p = centres[model.second] - centres[model.first]
            distances = face_gaps(model.shapes, model.first, model.second, R, p)
            near = distances < 0.15
            for g in np.flatnonzero(near):
                a, b = int(model.first[g]), int(model.second[g])
                distances[g], _ = measure(query, model.shapes, a, b, (axes[a], axes[b]), p[g])
            np.minimum.at(smallest, model.pair_of[near], distances[near])
            s = np.array([np.interp(time, leg.times, column) for column in clock.T])[model.pair_of]
            if before is not None:
                both = near & before[2]
                change = np.abs(distances - before[0]) - (s - before[1])
                lipschitz = max(lipschitz, float(change[both].max()))
            before = distances, s, near
    assert lipschitz < 1e-6
    listed = {pair.bodies: pair for pair in verdict.clearances}
    for found, pair in zip(smallest, model.pairs, strict=True):
        known = listed.get(pair.names)
        bound = verdict.elsewhere if known is None else known.bound
        assert found >= bound - 1e-7, pair.names
        if known is not None and known.margin < 0.03:
            assert found >= known.distance - 5e-3, pair.names


def test_verdict_can_be_read(plan: FlatteningPlan, cell: Cell) -> None:
    verdict = verify(plan, cell)
    assert [check.name for check in verdict.checks] == list(CHECKS)
    assert all(check.passed for check in verdict.checks)
    text = json.dumps(verdict.to_json(), allow_nan=False)
    data = json.loads(text)
    assert data["passed"] is True
    assert data["plan_hash"] == plan.content_hash
    assert verdict.smallest is not None
    assert data["smallest_clearance"]["bodies"] == list(verdict.smallest.bodies)
    assert verdict.smallest.bound <= verdict.smallest.distance
    assert len(verdict.rows()) == len(CHECKS)
    assert all(len(row) == 6 for row in verdict.rows() + verdict.clearance_rows())
    assert plan.content_hash[:12] in verdict.summary()
    with pytest.raises(KeyError):
        verdict.check("nonsense")


def test_a_check_of_clearances_is_that_of_the_pair_with_the_smallest_margin(
    plan: FlatteningPlan, cell: Cell
) -> None:
    verdict = verify(plan, cell)
    assert [pair.margin for pair in verdict.clearances] == sorted(
        pair.margin for pair in verdict.clearances
    )
    free = [pair for pair in verdict.clearances if pair.kind not in NEAR_BY_DESIGN]
    fingers = [pair for pair in verdict.clearances if pair.kind == "finger-table"]
    for name, (pair, *_) in (("clearance", free), ("finger_table", fingers)):
        check = verdict.check(name)
        assert (check.limit, check.margin) == (pair.required, pair.margin)
        assert check.value == pytest.approx(pair.required + pair.margin)
        assert (check.unit, check.where) == ("m", " - ".join(pair.bodies))
        assert check.time is not None and 0.0 <= check.time <= plan.segments[-1].end


def test_a_plan_whose_motion_cannot_be_looked_at_has_no_clearances(
    plan: FlatteningPlan, cell: Cell
) -> None:
    first, *others = plan.segments
    track = first.trajectory
    wild = Trajectory(track.times, track.positions + 9.0, track.velocities)
    long = Trajectory(
        track.times + 1e4 * np.arange(len(track.times)), track.positions, track.velocities
    )
    for segments in (
        (),
        (dc.replace(first, trajectory=wild), *others),
        (dc.replace(first, trajectory=long), *others),
    ):
        verdict = verify(dc.replace(plan, segments=segments), cell)
        assert not verdict.passed
        assert (verdict.clearances, verdict.elsewhere, verdict.queries) == ((), 0.0, 0)


def test_single_arm_plan_passes(
    planner: FlatteningPlanner, cell: Cell, make_target: Callable[..., FlatteningTarget]
) -> None:
    result = planner.plan(make_target(phi=0.3, half=0.2, pull=0.02), arms="single")
    assert result.plan is not None
    assert not result.plan.dual
    verdict = verify(result.plan, cell)
    assert verdict.violations == ()
    # To the other hand's grasp point, since nothing holds the cloth there.
    assert verdict.check("stretch").where == "right tip to the other grasp point"


def test_slow_plan_passes(cell: Cell, make_target: Callable[..., FlatteningTarget]) -> None:
    slow = cell.with_speed(0.2)
    result = FlatteningPlanner(slow).plan(make_target(phi=0.5, half=0.22, pull=0.02))
    assert result.plan is not None
    assert verify(result.plan, slow).violations == ()
    assert verify(result.plan, cell).violations == ()
