"""A run log for Foxglove and rerun: decoded with other libraries, against the log itself."""

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from unwrinkle.exports.foxglove_log import export_foxglove
from unwrinkle.exports.rerun_log import export_rerun
from unwrinkle.hardware.run_log.reader import read_run_log
from unwrinkle.hardware.run_log.writer import RunLog
from unwrinkle.logs.replay import measured_track
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.verification.verifier import cell_model

Main = Callable[..., int]


@pytest.fixture
def decoded(log: Path, cell: Cell, plan: FlatteningPlan) -> dict[str, list]:
    """Export the log, and decode the messages by topic with the schemas in the file."""
    pytest.importorskip("foxglove")
    reader = pytest.importorskip("mcap_protobuf.reader")
    path = log.with_suffix(".mcap")
    export_foxglove(read_run_log(log), path, cell, plan)
    found: dict[str, list] = {}
    topics = ["/measured", "/commanded", "/tf", "/scene", "/log"]
    for message in reader.read_protobuf_messages(path, topics=topics):
        found.setdefault(message.topic, []).append(message)
    return found


def test_joint_states(decoded: dict[str, list], log: Path, cell: Cell) -> None:
    records = read_run_log(log)
    for topic, part in (("/measured", records.measured), ("/commanded", records.commanded)):
        messages = [message.proto_msg for message in decoded[topic]]
        assert len(messages) == len(part.times)
        assert [joint.name for joint in messages[0].joints] == cell.robot.axes
        angles = [[joint.position for joint in message.joints] for message in messages]
        np.testing.assert_array_equal(angles, part.positions)
    # 5 s after the begin, whose time of day the header states.
    first = decoded["/commanded"][0]
    assert first.log_time_ns == 1767323045_000_000_000 + 5_000_000_000
    assert first.proto_msg.timestamp.seconds == 1767323050


def test_frames_put_the_tools_where_the_verification_has_them(
    decoded: dict[str, list], log: Path, cell: Cell
) -> None:
    track = measured_track(read_run_log(log), cell)
    messages = decoded["/tf"]
    assert len(messages) == len(track.times)
    k = len(track.times) // 2
    bodies = {t.child_frame_id: t for t in messages[k].proto_msg.transforms}
    assert all(t.parent_frame_id == "world" for t in bodies.values())
    posture = np.concatenate([track.positions[k], track.openings[k]])[None]
    _, X_WT = cell_model(cell).frames(posture)
    plant = cell.diagram.plant()
    for arm, X in zip(cell.robot.arms, X_WT[0], strict=True):
        palm = bodies[f"{arm.gripper}::{cell.robot.palm}"]
        model = plant.GetModelInstanceByName(arm.gripper)
        frame = plant.GetFrameByName("tcp", model)
        X_PT = frame.GetFixedPoseInBodyFrame().GetAsMatrix4()
        X_WP = X @ np.linalg.inv(X_PT)
        p = palm.translation
        np.testing.assert_allclose([p.x, p.y, p.z], X_WP[:3, 3], atol=1e-9)
    anchored = {t.child_frame_id for t in messages[0].proto_msg.transforms} - set(bodies)
    assert "t2::desk" in anchored


def test_scene_has_the_bodies_and_the_garment(
    decoded: dict[str, list], plan: FlatteningPlan
) -> None:
    entities = {e.id: e for m in decoded["/scene"] for e in m.proto_msg.entities}
    assert len(entities["t2::desk"].cubes) == 5
    size = entities["t2::desk"].cubes[0].size
    assert (size.x, size.y, size.z) == pytest.approx((0.8, 0.8, 0.15))
    assert entities["r1::link_3"].frame_id == "r1::link_3"
    assert plan.garment is not None
    counts = [len(mesh.points) for mesh in entities["plan"].triangles]
    assert len(plan.garment.p_WV) in counts


def test_events_are_log_messages(decoded: dict[str, list], log: Path) -> None:
    messages = [message.proto_msg.message for message in decoded["/log"]]
    events = read_run_log(log).events
    assert len(messages) == len(events)
    assert all(event.kind in text for event, text in zip(events, messages, strict=True))


def test_messages_are_in_order(log: Path, cell: Cell) -> None:
    pytest.importorskip("foxglove")
    from mcap.reader import make_reader

    path = log.with_suffix(".mcap")
    count = export_foxglove(read_run_log(log), path, cell)
    with path.open("rb") as stream:
        times = [message.log_time for _, _, message in make_reader(stream).iter_messages()]
    assert len(times) == count
    assert times == sorted(times)


def test_rerun_recording(log: Path, cell: Cell, plan: FlatteningPlan) -> None:
    pytest.importorskip("rerun")
    path = log.with_suffix(".rrd")
    export_rerun(read_run_log(log), path, cell, plan)
    assert path.read_bytes()[:3] == b"RRF"
    assert path.stat().st_size > 50_000


@pytest.mark.parametrize(
    ("module", "suffix"),
    [("mcap.writer", ".mcap"), ("foxglove.messages", ".mcap"), ("rerun", ".rrd")],
)
def test_without_the_package(
    log: Path, main: Main, monkeypatch: pytest.MonkeyPatch, module: str, suffix: str
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    target = log.with_suffix(suffix)
    assert main("export", "log", log, "--out", target) == 2
    assert not target.exists()


def test_a_log_without_motion(cell: Cell, tmp_path: Path) -> None:
    pytest.importorskip("foxglove")
    RunLog.create(tmp_path / "a.jsonl", {}).close()
    records = read_run_log(tmp_path / "a.jsonl")
    assert export_foxglove(records, tmp_path / "a.mcap", cell) == 0


def test_refusals(log: Path, main: Main, tmp_path: Path) -> None:
    assert main("export", "log", log, "--out", tmp_path / "run.bag") == 2
    assert main("export", "log", tmp_path / "missing.jsonl", "--out", tmp_path / "a.mcap") == 2
    with pytest.raises(InputError):
        read_run_log(tmp_path)
