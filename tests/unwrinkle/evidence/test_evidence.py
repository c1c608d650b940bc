"""Evidence: figures against Drake's own and against dense samples; refusals."""

import dataclasses as dc
import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from unwrinkle.evidence.body_motion import body_motions
from unwrinkle.evidence.motion import sampled_motion
from unwrinkle.evidence.pack import Evidence, collect_evidence
from unwrinkle.evidence.stopping import hold_travels
from unwrinkle.evidence.swept import swept_space
from unwrinkle.models.errors import NoVerifiedPlanError
from unwrinkle.models.robot import Cell
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.search.planner import FlatteningPlanner
from unwrinkle.planning.verification.motion import legs
from unwrinkle.testing.targets import flattening_task

Main = Callable[..., int]


@pytest.fixture(scope="module")
def pull(cell: Cell) -> FlatteningPlan:
    result = FlatteningPlanner(cell).plan(flattening_task((0.0, -1.10), 0.2))
    assert result.plan is not None
    return result.plan


@pytest.fixture(scope="module")
def plan_file(pull: FlatteningPlan, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("evidence") / "plan.npz"
    pull.save(path)
    return path


@pytest.fixture(scope="module")
def evidence(plan_file: Path) -> Evidence:
    return collect_evidence(plan_file, "loopback")


def test_energies_are_drakes(evidence: Evidence, cell: Cell) -> None:
    motion = evidence.motion
    plant = cell.diagram.plant()
    context = plant.CreateDefaultContext()
    shapeless = [
        body
        for body in map(plant.get_body, plant.GetBodyIndices(plant.GetModelInstanceByName("r1")))
        if str(body.scoped_name().get_full()) not in motion.names
    ]
    assert sum(body.get_mass(context) for body in shapeless) < 0.1
    # The bodies with a shape have all of the robot's energy but that of two pan brackets.
    missing = motion.total_energies - motion.energies.sum(axis=1)
    assert missing.min() > -1e-9
    assert missing.max() < 0.01 * motion.total_energies.max()
    assert evidence.total_energy[0] == pytest.approx(motion.total_energies.max())


def test_tool_speeds_are_those_of_drakes_jacobian(evidence: Evidence, cell: Cell) -> None:
    from pydrake.multibody.tree import JacobianWrtVariable

    plant = cell.diagram.plant()
    context = plant.CreateDefaultContext()
    columns = [
        plant.GetJointByName(
            name.split("::")[1], plant.GetModelInstanceByName(name.split("::")[0])
        ).position_start()
        for name in [*cell.robot.axes, *cell.robot.grippers]
    ]
    fastest = np.zeros(2)
    for leg in legs(evidence.plan, cell.scenario.gripper.opening):
        dense = leg.at_times(np.linspace(leg.times[0], leg.times[-1], 400))
        for q15, v15 in zip(dense.positions, dense.velocities, strict=True):
            q, v = plant.GetPositions(context), np.zeros(plant.num_velocities())
            q[columns], v[columns] = q15, v15
            plant.SetPositions(context, q)
            for i, arm in enumerate(cell.robot.arms):
                frame = plant.GetFrameByName("tcp", plant.GetModelInstanceByName(arm.gripper))
                world = plant.world_frame()
                J = plant.CalcJacobianTranslationalVelocity(
                    context, JacobianWrtVariable.kV, frame, [0.0, 0.0, 0.0], world, world
                )
                fastest[i] = max(fastest[i], float(np.linalg.norm(J @ v)))
    assert [speed for _, speed, _ in evidence.tools] == pytest.approx(fastest, rel=2e-3)


def test_bodies_speeds_are_those_of_their_corners_in_time(evidence: Evidence) -> None:
    motion = evidence.motion
    step = np.diff(motion.times)
    even = step > 1e-4
    for name in ("r1::link_5", "r2_gripper::palm", "turntable::mast"):
        b = motion.names.index(name)
        shape = motion.shapes[b][0]
        corner_B = shape.X_BG[:3, :3] @ (0.5 * np.array(shape.size)) + shape.X_BG[:3, 3]
        p_W = motion.X_WB[:, b, :3, :3] @ corner_B + motion.X_WB[:, b, :3, 3]
        speeds = np.linalg.norm(np.diff(p_W, axis=0), axis=1)[even] / step[even]
        found = next(body for body in body_motions(motion) if body.name == name)
        assert found.speed >= speeds.max() * (1.0 - 1e-3)
        assert found.speed < 1.5 * speeds.max() + 0.1


def test_the_swept_space_holds_every_point_and_is_no_larger_than_a_shell(
    evidence: Evidence, pull: FlatteningPlan, cell: Cell
) -> None:
    space, motion = evidence.space, sampled_motion(pull, cell, step=0.0007)
    rng = np.random.default_rng(0)
    group = {
        b: next(g for g, name in enumerate(space.groups) if _is_of(motion.names[b], name))
        for b in range(len(motion.names))
    }
    for b, shapes in enumerate(motion.shapes):
        for shape in shapes:
            inside = rng.uniform(-0.5, 0.5, (30, 3))
            if shape.kind == "cylinder":
                inside[:, :2] *= np.sqrt(0.5)
            elif shape.kind == "ellipsoid":
                inside *= np.sqrt(1.0 / 3.0)
            p_B = (inside * shape.size) @ shape.X_BG[:3, :3].T + shape.X_BG[:3, 3]
            chosen = rng.integers(0, len(motion.times), 60)
            X = motion.X_WB[chosen, b]
            p_W = np.einsum("nij,cj->nci", X[:, :3, :3], p_B) + X[:, None, :3, 3]
            cells = np.floor((p_W.reshape(-1, 3) - space.origin) / space.resolution).astype(int)
            assert space.passed[group[b]][tuple(cells.T)].all()
    low, high = space.bounds()
    bodies = body_motions(motion)
    least = np.min([body.lower for body in bodies], axis=0)
    most = np.max([body.upper for body in bodies], axis=0)
    assert np.all(low <= least) and np.all(high >= most)
    assert np.all(low > least - 3.0 * space.resolution)
    assert np.all(high < most + 3.0 * space.resolution)


def _is_of(body: str, group: str) -> bool:
    arm = {"r1": "right arm", "r2": "left arm"}.get(body.split("::")[0].split("_")[0])
    return group == (arm or "turn-table and head")


def test_the_volume_of_a_resting_box_is_its_own_with_a_shell(
    evidence: Evidence,
) -> None:
    motion = evidence.motion
    b = motion.names.index("turntable::r750")
    at_rest = dc.replace(
        motion,
        times=motion.times[:1],
        names=("box",),
        shapes=(motion.shapes[b][:1],),
        X_WB=motion.X_WB[:1, b : b + 1],
    )
    size = np.array(motion.shapes[b][0].size)
    for resolution in (0.05, 0.02):
        space = swept_space(at_rest, {"box": [0]}, resolution)
        # Every voxel touched is counted; none farther away than its own diagonal.
        assert space.volume() >= np.prod(size)
        assert space.volume() <= np.prod(size + 2.0 * np.sqrt(3.0) * resolution + resolution)


def test_holds_are_longer_at_full_speed_and_end_in_the_plan(
    evidence: Evidence, pull: FlatteningPlan, cell: Cell
) -> None:
    site = evidence.site.controller
    slow = hold_travels(pull, cell, site, 0.2, step=0.4)
    fast = hold_travels(pull, cell, site, 1.0, step=0.4)
    assert max(hold.travel for hold in slow) < 0.4 * max(hold.travel for hold in fast)
    assert max(hold.duration for hold in slow) < max(hold.duration for hold in fast)
    for hold in (*slow, *fast):
        assert hold.duration == pytest.approx(hold.lead + hold.braking + hold.latency)
        assert 0.0 <= hold.lead <= site.lead + 1e-6
        assert hold.latency == site.latency
    # Braking from the greatest speed takes at least half of what the way takes at that speed.
    worst = max(fast, key=lambda hold: hold.travel)
    greatest = max(speed for _, speed, _ in evidence.tools)
    assert worst.travel <= greatest * worst.duration


def test_figures_at_the_site_scale_with_its_speed(evidence: Evidence) -> None:
    full, slow = (dc.replace(evidence, speed=speed).to_json() for speed in (1.0, 0.2))
    for a, b in zip(slow["bodies"], full["bodies"], strict=True):
        assert a["speed_at_site_m_s"] == pytest.approx(0.2 * b["speed_planned_m_s"])
        assert a["energy_at_site_J"] == pytest.approx(0.04 * b["energy_planned_J"])


def test_commissioning_slows_the_tools(plan_file: Path, tmp_path: Path) -> None:
    site = tmp_path / "lab.site.yaml"
    site.write_text("name: lab\nspeed: 1.0\ncommissioning: true\n")
    found = collect_evidence(plan_file, site)
    assert found.speed * max(speed for _, speed, _ in found.tools) <= 0.25
    assert found.speed > 0.1
    assert [name for name, passed, _ in found.site_checks if not passed] == ["head calibration"]


def test_the_document(plan_file: Path, main: Main, tmp_path: Path) -> None:
    assert main("evidence", plan_file, "--site", "loopback", "-o", tmp_path) == 0
    record = json.loads((tmp_path / "evidence.json").read_text())
    plan = FlatteningPlan.load(plan_file)
    assert record["hashes"]["plan"] == plan.content_hash
    assert record["verdict"]["passed"] is True
    page = (tmp_path / "evidence.html").read_text()
    assert plan.content_hash in page
    assert "Content-Security-Policy" in page
    assert not re.search(r'(src|href)="(?!data:)', page)
    for body in record["bodies"]:
        assert body["name"] in page
    words = re.sub(r"<[^>]*>|\s+", " ", page).lower()
    for claim in ("proved", "certified", "collaborative", "safe plan", "guarantee"):
        assert claim not in words


@pytest.mark.parametrize("change", ["unverified", "other cell", "damaged"])
def test_refusals_write_nothing(
    change: str, pull: FlatteningPlan, main: Main, tmp_path: Path
) -> None:
    plan, site = tmp_path / "plan.npz", "loopback"
    changed = dc.replace(pull, events=pull.events[:1]) if change == "unverified" else pull
    changed.save(plan)
    if change == "other cell":
        (tmp_path / "lab.scenario.yaml").write_text("Lab:\n  clearance: {arm_arm: 0.05}\n")
        site = tmp_path / "lab.site.yaml"
        site.write_text("name: lab\nscenario: lab.scenario.yaml\nvirtual: true\n")
    elif change == "damaged":
        plan.write_bytes(plan.read_bytes()[:-20])
    code = 3 if change == "unverified" else 2
    assert main("evidence", plan, "--site", site, "-o", tmp_path / "out") == code
    assert not (tmp_path / "out").exists()


def test_errors_are_types(pull: FlatteningPlan, tmp_path: Path) -> None:
    dc.replace(pull, events=pull.events[:1]).save(tmp_path / "plan.npz")
    with pytest.raises(NoVerifiedPlanError):
        collect_evidence(tmp_path / "plan.npz", "loopback")
