"""The plan as a value: file round trip, hash, and every way a file can be wrong."""

import dataclasses as dc
import json
import zipfile

import numpy as np
import pytest

from unwrinkle.models.errors import InputError
from unwrinkle.models.io.archive import load_archive, save_archive
from unwrinkle.planning.plan import FlatteningPlan, GarmentSurface
from unwrinkle.planning.trajectory import Trajectory


@pytest.fixture(scope="module")
def plan(planner, make_target) -> FlatteningPlan:
    garment = GarmentSurface(
        p_WV=np.array([[0, -1.1, 0.7], [0.1, -1.1, 0.7], [0, -1.0, 0.7]], dtype=np.float32),
        triangles=np.array([[0, 1, 2]], dtype=np.int32),
        colours=np.full((3, 3), 200, dtype=np.uint8),
        ridge=np.zeros((2, 3), dtype=np.float32),
        outline=np.zeros((3, 3), dtype=np.float32),
    )
    plan = planner.plan(make_target(phi=0.5), garment=garment).plan
    assert plan is not None
    return plan


def test_file_round_trip_is_exact(plan, tmp_path):
    path = tmp_path / "plan.npz"
    plan.save(path)
    again = FlatteningPlan.load(path)
    assert again.content_hash == plan.content_hash
    assert again.arms == plan.arms and again.events == plan.events
    for a, b in zip(again.segments, plan.segments, strict=True):
        assert np.array_equal(a.trajectory.positions, b.trajectory.positions)
        assert (a.name, a.start, a.closed, a.poses, a.contact) == (
            b.name,
            b.start,
            b.closed,
            b.poses,
            b.contact,
        )
    assert np.array_equal(again.garment.p_WV, plan.garment.p_WV)


def test_plan_has_seven_poses_on_one_clock(plan):
    marks = [(segment.start + m.time, m.name) for segment in plan.segments for m in segment.poses]
    assert [name for _, name in marks] == [
        "plan",
        "touch-table",
        "grasp",
        "pull",
        "put-on-table",
        "free-garment",
        "leave-table",
    ]
    assert [t for t, _ in marks] == sorted(t for t, _ in marks)
    assert [event.closed for event in plan.events] == [(True, True), (False, False)]
    for before, event, after in zip(plan.segments, plan.events, plan.segments[1:], strict=False):
        assert event.time == pytest.approx(before.end, abs=1e-12)
        assert after.start == pytest.approx(event.time + event.dwell, abs=1e-12)


def test_hash_covers_every_field(plan):
    changes = {
        "robot": "other",
        "robot_hash": "0",
        "limits_hash": "0",
        "speed": 0.5,
        "turntable": 1.0,
        "note": "x",
        "garment": None,
        "events": plan.events[:1],
        "segments": plan.segments[:2],
        "arms": (None, plan.arms[1]),
        "target": dc.replace(plan.target, geodesic_distance=0.7),
    }
    assert set(changes) == {field.name for field in dc.fields(plan)}
    for name, value in changes.items():
        assert dc.replace(plan, **{name: value}).content_hash != plan.content_hash, name


def test_plan_of_another_robot_or_limits_is_refused(plan, cell):
    plan.check_made_for(cell)
    with pytest.raises(InputError, match="robot 'other'"):
        dc.replace(plan, robot="other").check_made_for(cell)
    with pytest.raises(InputError, match="another model of the cell"):
        dc.replace(plan, robot_hash="0" * 64).check_made_for(cell)
    with pytest.raises(InputError, match="other limits"):
        dc.replace(plan, limits_hash="0" * 64).check_made_for(cell)


def test_changed_array_is_refused(plan, tmp_path):
    path = tmp_path / "plan.npz"
    plan.save(path)
    header, arrays = load_archive(path)
    positions = arrays["segment1.positions"].copy()
    positions[3, 4] += 1e-9
    save_archive(path, header, {**arrays, "segment1.positions": positions})
    with pytest.raises(InputError, match="does not match its hash"):
        FlatteningPlan.load(path)


@pytest.mark.parametrize("fraction", [0.1, 0.3, 0.5, 0.7, 0.9])
def test_flipped_byte_is_refused(plan, tmp_path, fraction):
    path = tmp_path / "plan.npz"
    plan.save(path)
    with zipfile.ZipFile(path) as archive:
        member = archive.getinfo("segment0.positions.npy")
    data = bytearray(path.read_bytes())
    data[member.header_offset + 100 + int(fraction * (member.compress_size - 100))] ^= 0x10
    path.write_bytes(bytes(data))
    with pytest.raises(InputError, match=r"plan again|damaged|record it again|copy"):
        FlatteningPlan.load(path)


def test_other_files_are_refused(plan, tmp_path):
    path = tmp_path / "plan.npz"
    with pytest.raises(InputError, match="no such file"):
        FlatteningPlan.load(path)
    path.write_text("not a plan")
    with pytest.raises(InputError, match=r"plan\.npz"):
        FlatteningPlan.load(path)
    save_archive(path, {"format": "something"}, {"a": np.zeros(1)})
    with pytest.raises(InputError, match="not a flattening plan"):
        FlatteningPlan.load(path)
    plan.save(path)
    header, arrays = load_archive(path)
    save_archive(path, {**header, "version": 99}, arrays)
    with pytest.raises(InputError, match="version 99"):
        FlatteningPlan.load(path)
    save_archive(path, {k: v for k, v in header.items() if k != "target"}, arrays)
    with pytest.raises(InputError, match="damaged"):
        FlatteningPlan.load(path)
    nan = arrays["segment0.velocities"].copy()
    nan[5, 5] = np.nan
    save_archive(path, header, {**arrays, "segment0.velocities": nan})
    with pytest.raises(InputError, match=r"velocities\[5, 5\] is not a finite number"):
        FlatteningPlan.load(path)
    data = (tmp_path / "plan.npz").read_bytes()
    path.write_bytes(data[: len(data) // 2])
    with pytest.raises(InputError, match=r"plan\.npz"):
        FlatteningPlan.load(path)


def test_header_is_readable_without_this_program(plan, tmp_path):
    path = tmp_path / "plan.npz"
    plan.save(path)
    with np.load(path) as archive:
        header = json.loads(str(archive["header"]))
    assert header["content_hash"] == plan.content_hash
    assert header["robot"] == "clopema"


def test_trajectory_refuses_what_no_controller_may_get():
    t, q = np.array([0.0, 0.1, 0.2]), np.zeros((3, 13))
    Trajectory(t, q, q)
    with pytest.raises(InputError, match="shape"):
        Trajectory(t, q[:, :12], q)
    with pytest.raises(InputError, match="increase"):
        Trajectory(np.array([0.0, 0.2, 0.1]), q, q)
    with pytest.raises(InputError, match="start at 0"):
        Trajectory(t + 0.1, q, q)
    with pytest.raises(InputError, match="finite"):
        Trajectory(t, np.full((3, 13), np.inf), q)
    frozen = Trajectory(t, q, q)
    with pytest.raises(ValueError, match="read-only"):
        frozen.positions[0, 0] = 1.0
