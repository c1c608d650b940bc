"""The benchmark `trajectories`: its paths, its judge, its methods and its yardstick can fail, a"""

import dataclasses as dc
import json

import numpy as np
import pytest

from benchmarks.harness.results import to_json
from benchmarks.planning.trajectories import benchmark as trajectories
from benchmarks.planning.trajectories.measures import NO_DEVIATION, judge, limit_ratios, offsets
from benchmarks.planning.trajectories.methods import METHODS, PERIOD, Failure, Law
from benchmarks.planning.trajectories.moveit import Waypoints, smooth
from benchmarks.planning.trajectories.optimum import PathProgramme, joint_bound
from benchmarks.planning.trajectories.paths import (
    HOLDING,
    NAMES,
    SHIPPED,
    PathMaker,
    content_hash,
    load_paths,
)
from benchmarks.planning.trajectories.results import (
    Judgement,
    PieceFailure,
    PieceOptimum,
    TimedPath,
)
from benchmarks.planning.trajectories.trials import find, problem_of
from unwrinkle.models.errors import InputError
from unwrinkle.models.io.archive import load_archive, save_archive
from unwrinkle.models.robot import load_cell
from unwrinkle.planning.robot.kinematics import Kinematics
from unwrinkle.planning.search.key_poses import POSES
from unwrinkle.planning.timing.joint_path import JointPath, PathLimits
from unwrinkle.planning.timing.straight_lines import time_line
from unwrinkle.testing.targets import tasks

SET = load_paths()
LIMITS = SET.limits
FULL = PathLimits(LIMITS.velocity, LIMITS.acceleration, LIMITS.jerk)
KINEMATICS = Kinematics(load_cell())
PATH = SET.paths[20]
PROBLEM = problem_of(PATH, LIMITS)


def test_the_shipped_set_is_what_its_hash_says():
    header, arrays = load_archive(SHIPPED)
    assert content_hash(header, arrays) == header["sha256"]
    assert len(header["paths"]) == 40
    assert {entry["group"] for entry in header["paths"]} == {"forward", "lateral", "wide"}
    assert len({entry["name"] for entry in header["paths"]}) == 40
    assert SHIPPED.stat().st_size < 2_000_000


def test_a_changed_set_is_refused(tmp_path):
    header, arrays = load_archive(SHIPPED)
    q = arrays["q"].copy()
    q[1234, 5] += 1e-9
    save_archive(tmp_path / "changed.npz", header, {**arrays, "q": q})
    with pytest.raises(InputError, match="does not match its hash"):
        load_paths(tmp_path / "changed.npz")
    save_archive(tmp_path / "other.npz", {**header, "version": 99}, arrays)
    with pytest.raises(InputError, match="no set of seven-pose paths"):
        load_paths(tmp_path / "other.npz")


def test_the_set_is_read_in_five_lines_of_numpy():
    archive = np.load(SHIPPED, allow_pickle=False)
    header = json.loads(str(archive["header"]))
    q = archive["q"][(archive["path"] == 7) & (archive["piece"] == 1)]
    assert np.array_equal(q, SET.paths[7].pieces[1].q)
    assert header["limits"]["jerk"] == LIMITS.jerk.tolist()


def test_pieces_join_and_carry_the_seven_poses():
    for path in SET.paths:
        assert [piece.name for piece in path.pieces] == list(NAMES)
        for before, after in zip(path.pieces[:-1], path.pieces[1:], strict=True):
            assert np.allclose(before.q[-1], after.q[0], atol=1e-9)
        assert [name for name, _, _ in path.poses] == list(POSES)
        assert [k for _, k, _ in path.poses] == [1, 1, 1, 2, 2, 3, 3]
        for piece in path.pieces:
            assert np.allclose(KINEMATICS.tcp_positions(piece.q), piece.p_WT, atol=1e-9)
            step = np.linalg.norm(np.diff(piece.p_WT, axis=0), axis=2).max()
            assert step < 0.02
            assert np.all((piece.q >= LIMITS.lower) & (piece.q <= LIMITS.upper))
        assert path.pieces[HOLDING].holding


def test_the_maker_makes_the_shipped_path_again():
    made = PathMaker(load_cell()).pieces(tasks(SET.header["seed"])[int(PATH.name[-3:])])
    assert made is not None
    for piece, shipped in zip(made[0], PATH.pieces, strict=True):
        assert piece.q.shape == shipped.q.shape
        assert np.allclose(piece.q, shipped.q, atol=1e-6)


def test_ours_keeps_to_the_path_and_the_limits_and_the_others_do_not():
    rows = {
        key: judge(PATH.pieces, method(PROBLEM), LIMITS, KINEMATICS)
        for key, (_, method) in METHODS.items()
    }
    assert all(row.failures == () for row in rows.values())
    ours = rows["ours"]
    assert sum(ours.violations.values()) == 0
    assert ours.deviation < NO_DEVIATION and ours.joint_deviation < 1e-5
    assert rows["toppra"].ratio["jerk"] > 10.0
    assert rows["toppra"].deviation < NO_DEVIATION
    assert rows["toppra"].duration < ours.duration
    assert rows["moveit_sent"].violations["jerk"] > 0
    assert rows["moveit_motion"].deviation > 0.01
    assert rows["tracking"].deviation > 0.01
    assert sum(rows["ruckig"].violations.values()) == 0
    assert rows["ruckig"].deviation < NO_DEVIATION
    assert ours.duration < min(rows[k].duration for k in ("ruckig", "tracking"))
    assert ours.duration == pytest.approx(rows["without_start"].duration, rel=5e-3)


def test_the_judge_sees_each_violation():
    """One axis at twice a limit, and nothing else."""
    t = np.linspace(0.0, 2.0, 251)
    for power, name in ((1, "velocity"), (2, "acceleration"), (3, "jerk")):
        limit = getattr(LIMITS, name)
        omega = 1.0
        q, v = np.zeros((len(t), 13)), np.zeros((len(t), 13))
        size = 2.0 * limit[3] / omega**power
        q[:, 3] = size * np.sin(omega * t)
        v[:, 3] = size * omega * np.cos(omega * t)
        ratios = limit_ratios((t, q, v), LIMITS)[name]
        # Rest before and after counts as a jump of acceleration, which is none for velocity and
        # acceleration.
        inner = ratios[5:-5] if name == "jerk" else ratios
        assert inner[:, 3].max() == pytest.approx(2.0, rel=0.03)
        assert np.delete(ratios, 3, axis=1).max() == 0.0


def test_the_judge_sees_a_jump_of_acceleration():
    """A trapezoid of speed, sampled.

    The jerk seen is the jump over the period, however small the period.
    """
    for period in (0.01, 0.001):
        t = np.arange(0.0, 1.0 + period / 2, period)
        v = np.zeros((len(t), 13))
        v[:, 1] = np.where(t <= 0.5, t, 1.0 - t)
        q = np.concatenate([np.zeros((1, 13)), np.cumsum(0.5 * (v[1:] + v[:-1]), axis=0) * period])
        jerk = limit_ratios((t, q, v), LIMITS)["jerk"][:, 1].max() * LIMITS.jerk[1]
        assert jerk == pytest.approx(2.0 / period, rel=0.01)


def test_deviation_and_failures_are_seen():
    result = METHODS["ours"][1](PROBLEM)
    t, q, v = result[1]
    moved = q.copy()
    moved[:, 0] += 0.01  # the turn-table: both tools move by 0.01 rad times their distance
    row = judge(PATH.pieces, [result[0], (t, moved, v), *result[2:]], LIMITS, KINEMATICS)
    assert 0.003 < row.deviation < 0.03
    assert row.joint_deviation > 0.001
    row = judge(PATH.pieces, [*result[:4], Failure("tired")], LIMITS, KINEMATICS)
    assert row.failures == (PieceFailure("transit out", "tired"),)


def test_offsets_are_from_the_segments_and_not_from_the_corners():
    curve = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    points = np.array([[0.4, 0.1], [1.2, 0.6], [-0.3, 0.0], [0.9, 0.0]])
    assert np.allclose(
        np.linalg.norm(offsets(points, curve), axis=1), [0.1, 0.2, 0.3, 0.0], atol=1e-12
    )


def test_toppras_law_starts_and_ends_at_rest_and_agrees_with_its_derivatives():
    law = Law(PROBLEM.paths[1], PROBLEM.limits, None)
    t = np.linspace(0.0, law.duration, 20001)
    q, v, a = law.at(t)
    assert np.abs(v[[0, -1]]).max() < 1e-9
    assert np.allclose(q[[0, -1]], PATH.pieces[1].q[[0, -1]], atol=1e-9)
    assert np.allclose(np.gradient(q, t[1], axis=0)[1:-1], v[1:-1], atol=2e-3)
    assert np.median(np.abs(np.gradient(v, t[1], axis=0) - a)) < 1e-3


def test_moveits_smoothing_stretches_what_ruckig_refuses():
    """A target that is only reached from beyond the speed limit is refused until its velocity has
    been divided.
    """
    fast = LIMITS.velocity
    q = np.zeros((3, 13))
    q[1], q[2] = 0.1 * fast, 0.2 * fast
    v, a = np.zeros((3, 13)), np.zeros((3, 13))
    v[1], a[1] = fast, -0.5 * LIMITS.acceleration
    given = Waypoints(np.array([0.2, 0.2]), q, v, a)
    result = smooth(given, LIMITS, mitigate=False)
    assert result.incomplete is None and result.factor >= 1.1
    assert result.waypoints.durations[0] == pytest.approx(0.2 * result.factor)
    assert np.all(result.waypoints.velocities[1] < fast)
    assert np.array_equal(result.waypoints.positions, q)
    assert given.durations[0] == 0.2
    assert result.waypoints.durations[-1] == result.motions[-1].duration
    smooth_already = dc.replace(given, velocities=0.1 * v, accelerations=0.0 * a)
    assert smooth(smooth_already, LIMITS, mitigate=False).factor == 1.0


def test_the_programme_finds_the_optimum_of_a_line():
    """Along a straight line ruckig's rest-to-rest motion is the optimum."""
    rng = np.random.default_rng(3)
    start, goal = rng.uniform(-0.5, 0.5, (2, 13))
    optimal = time_line(start, goal, LIMITS, 0.0, PERIOD)[3]
    path = JointPath.through(np.linspace(start, goal, 20))
    theta = np.linspace(0.0, 1.0, 61)
    found = PathProgramme(path, FULL, 60).solve(theta**3 * (10 - 15 * theta + 6 * theta**2))
    assert found.duration == pytest.approx(optimal, rel=5e-3)
    assert found.duration <= found.dense * (1.0 + 1e-9)


def test_the_programme_is_not_slower_than_ours_and_not_under_the_bound():
    piece = PATH.pieces[3]
    path = piece.path()
    theta = np.linspace(0.0, 1.0, 121)
    found = PathProgramme(path, FULL).solve(theta**3 * (10 - 15 * theta + 6 * theta**2))
    t, _, _ = METHODS["ours"][1](PROBLEM)[3]
    assert joint_bound(piece.q, LIMITS) <= found.duration
    assert 0.94 * t[-1] < found.duration < t[-1]


def test_page_of_results_with_failures_is_written(tmp_path):
    row = dc.replace(
        judge(PATH.pieces, METHODS["ours"][1](PROBLEM), LIMITS, KINEMATICS), computing=0.1
    )
    lost = Judgement(
        failures=(PieceFailure("pull", "lost its way"),), ratio={}, violations={}, computing=0.1
    )
    optimum = tuple(
        PieceOptimum(name, 0.4, 0.4, 0.5, 0.5, 0.51, (0.5, 0.5), 2, 1.0) for name in NAMES
    )
    path = TimedPath(
        path=PATH.name,
        group=PATH.group,
        jerk_free=row.duration / 1.3,
        methods={key: (row if key == "ours" else lost) for key in METHODS},
        optimum=optimum,
    )
    results = trajectories.summary([path])
    assert results.headline.clean_on_every_path == ("ours",)
    assert results.headline.target_met_by == ("ours",)
    assert results.start.paths == 0
    page = trajectories.table(results)
    assert "lost its way" in page and "| toppra alone | 1 | 0 of 1 |" in page
    json.dumps(to_json(results), allow_nan=False)
    trajectories.plot(results, tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 10_000


def test_an_unknown_path_is_refused():
    with pytest.raises(InputError, match="no path 'nowhere'"):
        find(SET, "nowhere")
