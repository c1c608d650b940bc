"""Good plans, each spoilt in one way: every one is refused, for the right reason."""

import dataclasses as dc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from unwrinkle.models.errors import InputError
from unwrinkle.models.io.loader_yaml import models_dir
from unwrinkle.models.robot import Cell, load_cell
from unwrinkle.models.scenario import GripperSettings, Scenario
from unwrinkle.perception.target import FlatteningTarget
from unwrinkle.planning.plan import ArmChoice, FlatteningPlan, GripperEvent
from unwrinkle.planning.search.planner import FlatteningPlanner
from unwrinkle.planning.trajectory import Trajectory
from unwrinkle.planning.verification.model import CellModel
from unwrinkle.planning.verification.verdict import Verdict
from unwrinkle.planning.verification.verifier import verify

PLANS = (np.radians(-20.0), np.radians(50.0))

SDF = """<sdf version="1.9"><model name="post"><link name="post"><collision name="post">
<geometry><box><size>{0} {1} {2}</size></box></geometry></collision></link></model></sdf>"""
DIRECTIVES = """directives:
- add_model:
    name: obstacle
    file: file://{path}
- add_weld:
    parent: world
    child: obstacle::post
    X_PC: {{translation: [{x}, {y}, {z}]}}
"""


@pytest.fixture(scope="module", params=PLANS, ids=["line", "oblique"])
def plan(
    request: pytest.FixtureRequest,
    planner: FlatteningPlanner,
    make_target: Callable[..., FlatteningTarget],
) -> FlatteningPlan:
    """A good plan."""
    result = planner.plan(make_target(phi=request.param, half=0.22, pull=0.02))
    assert result.plan is not None
    return result.plan


def segment(plan: FlatteningPlan, index: int, **changes: Any) -> FlatteningPlan:
    """The plan with one segment changed."""
    segments = list(plan.segments)
    segments[index] = dc.replace(segments[index], **changes)
    return dc.replace(plan, segments=tuple(segments))


def samples(plan: FlatteningPlan, index: int, **changes: Any) -> FlatteningPlan:
    """The plan with one segment's samples changed."""
    return segment(plan, index, trajectory=dc.replace(plan.segments[index].trajectory, **changes))


def faster(plan: FlatteningPlan, index: int, factor: float) -> FlatteningPlan:
    """The plan with one segment run faster; all that hangs on its clock goes with it."""
    old = plan.segments[index]
    t = old.trajectory
    return segment(
        plan,
        index,
        trajectory=Trajectory(t.times / factor, t.positions, t.velocities * factor),
        poses=tuple(dc.replace(mark, time=mark.time / factor) for mark in old.poses),
        contact=(old.contact[0] / factor, old.contact[1] / factor),
    )


def kinds(verdict: Verdict) -> set[str]:
    """The kinds of violation; each is in the check of that name too, and has a sentence."""
    assert not verdict.passed
    for violation in verdict.violations:
        assert not verdict.check(violation.kind).passed
        assert len(violation.message) > 20
    return {violation.kind for violation in verdict.violations}


def accept(plan: FlatteningPlan, cell: Cell) -> FlatteningPlan:
    """The same motion, claiming to be made for this cell: only the motion can then be wrong."""
    limits = cell.limits_hash
    return dc.replace(plan, robot_hash=cell.robot_hash, limits_hash=limits)


def test_unchanged_passes(plan: FlatteningPlan, cell: Cell) -> None:
    assert verify(plan, cell).violations == ()


def test_one_sample_shifted(plan: FlatteningPlan, cell: Cell) -> None:
    positions = plan.segments[0].trajectory.positions.copy()
    positions[40, 3] += 1e-3
    found = kinds(verify(samples(plan, 0, positions=positions), cell))
    assert {"acceleration", "jerk", "acceleration_jump"} <= found
    assert not found & {"hash", "start", "continuity", "structure"}


def test_jerk_spike(plan: FlatteningPlan, cell: Cell) -> None:
    velocities = plan.segments[2].trajectory.velocities.copy()
    velocities[30, 5] += 0.04
    found = kinds(verify(samples(plan, 2, velocities=velocities), cell))
    assert "jerk" in found
    assert found <= {"jerk", "acceleration_jump", "acceleration"}


@pytest.mark.parametrize("name", ["velocity", "acceleration", "jerk"])
def test_limit_lowered(plan: FlatteningPlan, cell: Cell, name: str) -> None:
    verdict = verify(plan, cell)
    fraction = 0.9 * verdict.check(name).value
    limits = dc.replace(cell.limits, **{name: getattr(cell.limits, name) * fraction})
    lower = dc.replace(cell, limits=limits)
    assert "hash" in kinds(verify(plan, lower))
    assert kinds(verify(accept(plan, lower), lower)) - {"acceleration_jump"} == {name}


def test_position_limit_lowered(plan: FlatteningPlan, cell: Cell) -> None:
    trajectory = plan.segments[1].trajectory
    upper = cell.limits.upper.copy()
    upper[2] = trajectory.positions[:, 2].max() - 1e-3
    lower = dc.replace(cell, limits=dc.replace(cell.limits, upper=upper))
    assert kinds(verify(accept(plan, lower), lower)) == {"position"}


def test_table_raised(plan: FlatteningPlan, cell: Cell, tmp_path: Path) -> None:
    source = (models_dir() / "cell.dmd.yaml").read_text()
    assert "translation: [0, -1.2, 0.70]" in source
    raised = tmp_path / "raised.dmd.yaml"
    raised.write_text(source.replace("[0, -1.2, 0.70]", "[0, -1.2, 0.72]"))
    other = load_cell(dc.replace(cell.scenario, directives=[str(raised)]))
    assert "hash" in kinds(verify(plan, other))
    found = kinds(verify(accept(plan, other), other))
    # The table comes up to the fingers, so that they are near it where they still sink fast.
    assert (
        {"finger_table", "grasp", "put_down"}
        <= found
        <= {"finger_table", "grasp", "put_down", "sinking"}
    )


def right_tip(cell: Cell, positions: np.ndarray) -> np.ndarray:
    """Where the right tool centre point is at (13,) positions."""
    _, X_WT = CellModel(cell).frames(np.append(positions, [0.03, 0.03])[None])
    return X_WT[0, 0, :3, 3]


def with_obstacle(cell: Cell, folder: Path, centre: np.ndarray, size: tuple[float, ...]) -> Cell:
    """The cell with one more box in it."""
    model, directives = folder / "post.sdf", folder / "obstacle.dmd.yaml"
    model.write_text(SDF.format(*size))
    x, y, z = (float(value) for value in centre)
    directives.write_text(DIRECTIVES.format(path=model, x=x, y=y, z=z))
    files = [*cell.scenario.directives, str(directives)]
    return load_cell(dc.replace(cell.scenario, directives=files))


def test_obstacle_in_the_way(plan: FlatteningPlan, cell: Cell, tmp_path: Path) -> None:
    positions = plan.segments[0].trajectory.positions
    centre = right_tip(cell, positions[len(positions) // 3])
    other = with_obstacle(cell, tmp_path, centre, (0.02, 0.02, 0.02))
    verdict = verify(accept(plan, other), other)
    assert kinds(verdict) == {"clearance"}
    assert all("obstacle::post" in violation.message for violation in verdict.violations)
    assert any("r1_gripper" in violation.message for violation in verdict.violations)


def test_obstacle_between_samples(plan: FlatteningPlan, cell: Cell, tmp_path: Path) -> None:
    """A small thing that no sample touches, since there are but two: the cubic goes through it."""

    def only(begin: np.ndarray, end: np.ndarray) -> FlatteningPlan:
        trajectory = Trajectory(np.array([0.0, 2.0]), np.array([begin, end]), np.zeros((2, 13)))
        first = segment(plan, 0, trajectory=trajectory, poses=(), contact=(0.0, 0.0))
        return dc.replace(first, segments=first.segments[:1])

    home = np.array(cell.robot.named_states["home"], dtype=float)
    swung = home.copy()
    swung[1] += 1.0
    centre = right_tip(cell, 0.5 * (home + swung))
    other = with_obstacle(cell, tmp_path, centre, (0.004, 0.004, 0.004))
    for still in (home, swung):
        assert "clearance" not in kinds(verify(accept(only(still, still), other), other))
    assert "clearance" in kinds(verify(accept(only(home, swung), other), other))


@pytest.mark.parametrize("index", [0, 1, 2])
def test_segment_dropped(plan: FlatteningPlan, cell: Cell, index: int) -> None:
    segments = plan.segments[:index] + plan.segments[index + 1 :]
    assert "structure" in kinds(verify(dc.replace(plan, segments=segments), cell))


def test_all_segments_dropped(plan: FlatteningPlan, cell: Cell) -> None:
    assert "structure" in kinds(verify(dc.replace(plan, segments=()), cell))


def test_arms_swapped(plan: FlatteningPlan, cell: Cell) -> None:
    found = kinds(verify(dc.replace(plan, arms=plan.arms[::-1]), cell))
    assert {"grasp", "pull", "put_down", "heading", "contact"} <= found
    assert not found & {"hash", "structure", "velocity", "acceleration", "jerk", "clearance"}


def test_both_arms_for_one_hand(plan: FlatteningPlan, cell: Cell) -> None:
    arms = (plan.arms[0], plan.arms[0])
    assert {"structure", "grasp"} <= kinds(verify(dc.replace(plan, arms=arms), cell))


def test_share_not_pulled(plan: FlatteningPlan, cell: Cell) -> None:
    arm = plan.arms[1]
    assert isinstance(arm, ArmChoice)
    arms = (plan.arms[0], dc.replace(arm, share=arm.share + 0.5))
    assert kinds(verify(dc.replace(plan, arms=arms), cell)) == {"put_down", "choice"}


@pytest.mark.parametrize("shift", [-0.1, 0.3])
def test_gripper_event_moved(plan: FlatteningPlan, cell: Cell, shift: float) -> None:
    event = plan.events[0]
    events = (dc.replace(event, time=event.time + shift), plan.events[1])
    assert kinds(verify(dc.replace(plan, events=events), cell)) == {"gripper"}


@pytest.mark.parametrize(
    "events",
    [
        lambda events: events[:1],
        lambda events: events[::-1],
        lambda events: (dc.replace(events[0], closed=(True, False)), events[1]),
        lambda events: (dc.replace(events[0], dwell=0.1), events[1]),
    ],
)
def test_gripper_event_wrong(
    plan: FlatteningPlan,
    cell: Cell,
    events: Callable[[tuple[GripperEvent, ...]], tuple[GripperEvent, ...]],
) -> None:
    assert kinds(verify(dc.replace(plan, events=events(plan.events)), cell)) == {"gripper"}


def test_gripper_open_while_pulling(plan: FlatteningPlan, cell: Cell) -> None:
    assert kinds(verify(segment(plan, 1, closed=(False, True)), cell)) == {"gripper"}


def test_gripper_closed_on_the_way_in(plan: FlatteningPlan, cell: Cell) -> None:
    found = kinds(verify(segment(plan, 0, closed=(True, True)), cell))
    assert {"gripper", "tip_speed"} <= found


def test_overstretch(plan: FlatteningPlan, cell: Cell) -> None:
    """The same motion on a shorter cloth."""
    distance = plan.target.final_grip_distance
    hands = tuple(dc.replace(hand, pull_distance=0.0) for hand in plan.target.hands)
    target = dc.replace(plan.target, hands=hands, geodesic_distance=distance / 1.12)
    verdict = verify(dc.replace(plan, target=target), cell)
    assert kinds(verdict) == {"stretch", "put_down", "pull"}
    assert verdict.check("stretch").margin == pytest.approx(-0.02 / 1.12 * distance, abs=1e-3)


def test_pushed_together(plan: FlatteningPlan, cell: Cell) -> None:
    """The pull run backwards: the cloth goes slack."""
    target = dc.replace(
        plan.target,
        hands=tuple(dc.replace(hand, pull_distance=0.0) for hand in plan.target.hands),
    )
    t = plan.segments[1].trajectory
    back = samples(plan, 1, positions=t.positions[::-1], velocities=-t.velocities[::-1])
    found = kinds(verify(dc.replace(back, target=target), cell))
    assert {"slack", "continuity"} <= found


def test_wrong_start(plan: FlatteningPlan, cell: Cell) -> None:
    start = np.array(cell.robot.named_states["home"], dtype=float)
    assert verify(plan, cell, start=start).passed
    start[9] += 2e-4
    assert kinds(verify(plan, cell, start=start)) == {"start"}


def test_nan_and_infinity(plan: FlatteningPlan, cell: Cell) -> None:
    for value in (np.nan, np.inf):
        positions = plan.segments[1].trajectory.positions.copy()
        positions[3, 4] = value
        with pytest.raises(InputError, match=r"positions\[3, 4\] is not a finite number"):
            samples(plan, 1, positions=positions)
    with pytest.raises(InputError, match="13 finite numbers"):
        verify(plan, cell, start=np.full(13, np.nan))


def test_one_byte_flipped(plan: FlatteningPlan, tmp_path: Path) -> None:
    path = tmp_path / "plan.npz"
    plan.save(path)
    data = path.read_bytes()
    rng = np.random.default_rng(0)
    changed = 0
    for place in rng.integers(0, len(data), 60):
        spoilt = bytearray(data)
        spoilt[place] ^= 1 << int(rng.integers(8))
        path.write_bytes(spoilt)
        try:
            loaded = FlatteningPlan.load(path)
        except InputError:
            changed += 1
            continue
        # A few bytes of the container (dates, attributes) mean nothing: the plan is then the same.
        assert loaded.content_hash == plan.content_hash
    assert changed > 40


def test_content_changed_under_its_hash(plan: FlatteningPlan, cell: Cell) -> None:
    spoilt = dc.replace(plan)
    spoilt.__dict__["content_hash"] = "0" * 64
    assert kinds(verify(spoilt, cell)) == {"hash"}


@pytest.mark.parametrize("name", ["robot", "robot_hash", "limits_hash"])
def test_made_for_something_else(plan: FlatteningPlan, cell: Cell, name: str) -> None:
    assert kinds(verify(dc.replace(plan, **{name: "0" * 64}), cell)) == {"hash"}


def test_faster_than_the_cell_allows(plan: FlatteningPlan, cell: Cell) -> None:
    assert kinds(verify(plan, cell.with_speed(0.5))) == {"speed"}


@pytest.mark.parametrize("index", [0, 1, 2])
def test_finger_below_the_table(plan: FlatteningPlan, cell: Cell, index: int) -> None:
    """The right arm leans forward by 0.01 rad, which lowers its tip by about 10 mm."""
    positions = plan.segments[index].trajectory.positions.copy()
    positions[:, 2] += 0.01
    verdict = verify(samples(plan, index, positions=positions), cell)
    assert {"finger_table", "continuity"} <= kinds(verdict)
    assert any("r1_gripper" in v.message for v in verdict.violations if v.kind == "finger_table")


def test_no_contact_window(plan: FlatteningPlan, cell: Cell) -> None:
    found = kinds(verify(segment(plan, 1, contact=(0.0, 0.0)), cell))
    assert found == {"finger_table"}


def test_contact_window_too_wide(plan: FlatteningPlan, cell: Cell) -> None:
    duration = plan.segments[0].trajectory.duration
    assert {"structure", "contact"} <= kinds(
        verify(segment(plan, 0, contact=(0.0, duration)), cell)
    )


def test_arm_that_takes_no_part_on_the_table(plan: FlatteningPlan, cell: Cell) -> None:
    found = kinds(verify(dc.replace(plan, arms=(plan.arms[0], None)), cell))
    assert {"finger_table", "gripper"} <= found


def test_tip_too_fast_while_holding(plan: FlatteningPlan, cell: Cell) -> None:
    check = verify(plan, cell).check("tip_speed")
    assert check.value is not None
    assert check.limit is not None
    verdict = verify(faster(plan, 1, 1.05 * check.limit / check.value), cell)
    assert "tip_speed" in kinds(verdict)
    assert verdict.check("tip_speed").value == pytest.approx(1.05 * check.limit, rel=0.01)


def test_sample_time_compressed(plan: FlatteningPlan, cell: Cell) -> None:
    """The same points, sent faster; velocities as before, so that they do not fit either."""
    t = plan.segments[0].trajectory
    found = kinds(verify(faster(plan, 0, 1.5), cell))
    assert {"acceleration", "jerk"} <= found
    assert "acceleration" in kinds(verify(samples(plan, 0, times=t.times * 0.9), cell))


def test_segments_overlap(plan: FlatteningPlan, cell: Cell) -> None:
    start = plan.segments[0].end - 0.1
    assert {"structure", "gripper"} <= kinds(verify(segment(plan, 1, start=start), cell))


@pytest.mark.parametrize("row", [0, -1])
def test_not_at_rest(plan: FlatteningPlan, cell: Cell, row: int) -> None:
    velocities = plan.segments[1].trajectory.velocities.copy()
    velocities[row, 4] = 1e-3
    assert "rest" in kinds(verify(samples(plan, 1, velocities=velocities), cell))


def test_gap_between_segments(plan: FlatteningPlan, cell: Cell) -> None:
    positions = plan.segments[1].trajectory.positions.copy()
    positions[:, 12] += 1e-4
    assert kinds(verify(samples(plan, 1, positions=positions), cell)) == {"continuity"}


def test_tilt_beyond_the_gripper(plan: FlatteningPlan, cell: Cell) -> None:
    scenario: Scenario = dc.replace(
        cell.scenario, gripper=GripperSettings(tilt_lower=0.1, tilt_upper=0.3)
    )
    other = load_cell(scenario)
    assert kinds(verify(accept(plan, other), other)) == {"tilt"}


def test_larger_padding(plan: FlatteningPlan, cell: Cell) -> None:
    smallest = verify(plan, cell).smallest
    assert smallest is not None
    wider = {smallest.kind.replace("-", "_"): smallest.distance + 1e-3}
    clearance = dc.replace(cell.scenario.clearance, **wider)
    other = load_cell(dc.replace(cell.scenario, clearance=clearance))
    verdict = verify(accept(plan, other), other)
    assert kinds(verdict) == {"clearance"}
    assert any(set(smallest.bodies) <= set(v.message.split()) for v in verdict.violations)
