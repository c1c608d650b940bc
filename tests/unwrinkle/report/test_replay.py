"""Replay page of a run: its tracks equal the record, and a browser plays them."""

import base64
import dataclasses as dc
import json
import re
import shutil
import subprocess
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pydrake.math import RigidTransform

from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell
from unwrinkle.report.replay import replay_page, write_replay
from unwrinkle.report.tracks import (
    LOOK_TIME,
    ROBOT_RATE,
    STEP,
    ClothTrack,
    clips_of,
    cloth_track,
    key_frames,
    posture_at,
    robot_track,
)
from unwrinkle.runs.folder import MotionRecord, RunFolder, RunSettings
from unwrinkle.simulation.rendering.meshes import grid_triangles
from unwrinkle.viewer.overlay import POLICY
from unwrinkle.viewer.scene import CellScene, start_meshcat

LARGEST_PAGE = 10_000_000
HOME = np.zeros(13)


@pytest.fixture(scope="module")
def run(synthetic_run: Any, tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    return synthetic_run.write(tmp_path_factory.mktemp("runs") / "whole")


@pytest.fixture(scope="module")
def page(run: RunFolder, cell: Cell) -> str:
    return replay_page(run, cell)


def _data(page: str) -> dict[str, Any]:
    return json.loads(re.findall(r'id="run-data">(.*?)</script>', page)[0])


def _unpacked(text: str, columns: int) -> NDArray[np.uint16]:
    """Unpack a track as the page's script does."""
    planes = np.frombuffer(zlib.decompress(base64.b64decode(text)), dtype=np.uint8)
    low, high = planes.reshape(2, -1).astype(np.uint16)
    return np.cumsum((low | (high << 8)).reshape(-1, columns), axis=0, dtype=np.uint16)


def _waving(frames: int = 40, nodes: int = 6, step: float = 0.1) -> MotionRecord:
    """Return a motion with rest in its first half; then arms and cloth move."""
    times = 5.0 + step * np.arange(frames)
    share = np.maximum(np.arange(frames) / frames - 0.5, 0.0)
    axes = share[:, None] * np.linspace(-0.4, 0.5, 13)
    cloth = np.random.default_rng(3).uniform(0.0, 0.3, (nodes * nodes, 3))
    moved = cloth + 0.1 * share[:, None, None] * [1.0, 0.0, 1.0]
    shape = np.zeros((frames, 13))
    return MotionRecord(
        times,
        axes,
        shape,
        axes,
        np.full((frames, 2), 0.02),
        frame_times=times,
        cloth_frames=moved.astype(np.float32),
    )


def _grid(nodes: int) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    u, v = np.meshgrid(np.linspace(0.0, 0.3, nodes), np.linspace(0.0, 0.3, nodes))
    rest = np.column_stack([u.ravel(), v.ravel()]).astype(np.float32)
    return grid_triangles(nodes, nodes).astype(np.int32), rest


# ---------------------------------------------------------------- tracks


def test_clips_follow_each_other_with_time_to_look() -> None:
    motion = _waving()
    first, second, third = clips_of([(0, motion), (1, None), (4, motion)])
    assert (first.begin, first.start) == (0.0, LOOK_TIME)
    assert first.end == pytest.approx(LOOK_TIME + 3.9)
    assert (second.begin, second.end) == (first.end, first.end + LOOK_TIME)
    assert third.index == 4
    assert [mark.name for mark in third.segments] == ["look"]
    assert third.segments[0].end == third.start


def test_posture_is_the_measured_one_and_stands_still_in_between() -> None:
    motion = _waving()
    clips = clips_of([(0, None), (1, motion), (2, None)])
    axes, openings = posture_at(clips, 0.0, HOME)
    np.testing.assert_allclose(axes, motion.measured[0])
    assert openings is not None
    axes, _ = posture_at(clips, clips[1].start + 3.05, HOME)
    np.testing.assert_allclose(axes, 0.5 * (motion.measured[30] + motion.measured[31]), atol=1e-12)
    for time in (clips[1].end, clips[2].end, 1e3):
        np.testing.assert_allclose(posture_at(clips, time, HOME)[0], motion.measured[-1])
    home, none = posture_at(clips_of([(0, None)]), 0.5, HOME + 0.1)
    np.testing.assert_array_equal(home, HOME + 0.1)
    assert none is None


def test_robot_track_is_where_the_bodies_are(cell: Cell) -> None:
    scene = CellScene(cell, start_meshcat(), proximity=False)
    clips = clips_of([(0, _waving())])
    track = robot_track(clips, scene, HOME)
    assert "r1/link_7" in track.paths
    assert not {"t2/desk", "floor/slab", "turntable/r750_base"} & set(track.paths)
    packed = track.packed()
    steps = _unpacked(packed["data"], 7 * len(track.paths)).view(np.int16)
    poses = steps.reshape(packed["frames"], -1, 7)
    k, b = 90, track.paths.index("r2/link_7")
    scene.move(*posture_at(clips, k / ROBOT_RATE, HOME))
    body = scene.plant.GetBodyByName("link_7", scene.plant.GetModelInstanceByName("r2"))
    context = scene.plant.CreateDefaultContext()
    scene.plant.SetPositions(context, scene.positions())
    X_WB: RigidTransform = scene.plant.EvalBodyPoseInWorld(context, body)
    np.testing.assert_allclose(
        poses[k, b, :3] * packed["step"], X_WB.translation(), atol=packed["step"]
    )
    w, x, y, z = X_WB.rotation().ToQuaternion().wxyz()
    alike = abs(np.dot(poses[k, b, 3:] / 32767.0, [x, y, z, w]))
    assert alike == pytest.approx(1.0, abs=1e-4)
    turns = np.sum(poses[1:, :, 3:].astype(float) * poses[:-1, :, 3:], axis=-1)
    assert turns.min() > 0.0  # no quaternion flips its sign between frames


def test_key_frames_are_few_and_none_while_it_rests() -> None:
    motion = _waving(frames=80, step=0.05)
    kept = key_frames(motion.frame_times, motion.cloth_frames)
    assert kept[0] == 0
    assert kept[-1] == 79
    assert not [k for k in kept if 0 < k < 39]
    assert 39 <= kept[1] <= 41  # the last one before it moves
    assert np.diff(motion.frame_times[kept[2:-1]]).min() > 0.09
    still = np.repeat(motion.cloth_frames[:1], 80, axis=0)
    assert key_frames(motion.frame_times, still) == [0]
    assert key_frames(np.zeros(0), np.zeros((0, 4, 3), dtype=np.float32)) == []


def test_cloth_track_is_the_cloth_to_a_twentieth_of_a_millimetre() -> None:
    motion = _waving()
    triangles, rest = _grid(6)
    clips = clips_of([(0, motion), (1, motion)])
    track = cloth_track(clips, triangles, rest)
    assert track is not None
    assert np.all(np.diff(track.times) >= 0.0)
    assert track.times[0] == 0.0
    packed = track.packed()
    frames = _unpacked(packed["data"], 3 * 36).reshape(-1, 36, 3) * STEP + packed["low"]
    assert len(frames) == len(packed["times"])
    np.testing.assert_allclose(frames[0], motion.cloth_frames[0], atol=STEP)
    k = int(np.searchsorted(packed["times"], clips[1].begin))
    np.testing.assert_allclose(frames[k - 1], motion.cloth_frames[-1], atol=0.01)
    np.testing.assert_allclose(frames[-1], motion.cloth_frames[-1], atol=STEP)
    faces = _unpacked(packed["triangles"], triangles.size)
    np.testing.assert_array_equal(faces.reshape(-1, 3), triangles)


def test_cloth_track_of_another_mesh_or_none_is_left_out() -> None:
    triangles, rest = _grid(7)
    assert cloth_track(clips_of([(0, _waving())]), triangles, rest) is None
    assert cloth_track(clips_of([(0, None)]), triangles, rest) is None


def test_fine_cloth_is_thinned_in_space() -> None:
    motion = _waving(nodes=9)
    triangles, rest = _grid(9)
    track = cloth_track(clips_of([(0, motion)]), triangles, rest, most_vertices=30)
    assert track is not None
    assert track.frames.shape[1] == 25
    even = np.arange(81).reshape(9, 9)[::2, ::2].ravel()
    np.testing.assert_array_equal(
        np.sort(track.frames[0], axis=0), np.sort(motion.cloth_frames[0][even], axis=0)
    )
    assert len(track.triangles) == 32
    assert track.triangles.max() == 24


def test_cloth_is_thinned_in_time_to_its_budget() -> None:
    rng = np.random.default_rng(0)
    frames = rng.uniform(0.0, 0.5, (33, 400, 3)).astype(np.float32)
    track = ClothTrack(np.arange(33.0), frames, np.zeros((1, 3), dtype=np.int32))
    packed = track.packed(most=30_000)
    assert len(packed["data"]) <= 30_000
    assert packed["times"][0] == 0.0
    assert packed["times"][-1] == 32.0
    assert 2 < len(packed["times"]) < 33


# ---------------------------------------------------------------- page


def test_page_is_self_contained(page: str) -> None:
    policy = re.search(r'http-equiv="Content-Security-Policy" content="([^"]*)"', page)
    assert policy is not None
    assert policy[1] == POLICY
    panel = page[page.index('<div id="side">') :]
    assert re.findall(r"https?://|wss?://|\shref=|url\(", panel) == []
    assert set(re.findall(r'\ssrc="(.{11})', panel)) == {"data:image/"}
    assert "@@" not in panel
    assert "<title>Flattening run whole</title>" in page


def test_page_has_the_time_line_and_the_facts(page: str, run: RunFolder) -> None:
    data = _data(page)
    clips = data["clips"]
    assert [clip["title"] for clip in clips] == ["action 1", "action 2", "look 3"]
    motion = run.look(0).motion()
    names = ["look", "approach", "pull", "release"]
    assert [part["name"] for part in clips[0]["parts"]] == names
    assert clips[1]["begin"] == pytest.approx(LOOK_TIME + motion.end - motion.begin)
    assert clips[0]["marksUntil"] == clips[0]["parts"][2]["begin"]
    assert data["duration"] == pytest.approx(clips[2]["parts"][0]["end"])
    assert data["cloth"]["vertices"] == 400
    assert {"overview", "garment", "above", "low"} == set(data["views"])
    assert len(re.findall(r'data-clip="\d"', page)) == 3
    assert len(re.findall(r'<div data-look="\d" hidden>', page)) == 3
    assert "94.0 → 96.0 %" in page
    assert "are simulated" in page


def test_viewer_still_has_what_the_page_calls(page: str) -> None:
    """The page drives Meshcat's scene, which is not a documented interface."""
    for piece in ("set_camera_target(", "set_dirty()", "find(A)", "set_property("):
        assert piece in page
    payloads = re.findall(r'fetch\("data:application/octet-binary;base64,([^"]*)"', page)
    sent = b"".join(base64.b64decode(text) for text in payloads)
    for path in _data(page)["robot"]["paths"]:
        assert f"illustration/{path}".encode() in sent
    assert b"run/look 0/grasp/right" in sent
    assert b"run/look 1/wrinkle 1" in sent
    assert b"proximity" not in sent


def test_replay_of_a_killed_run_and_of_damaged_files(
    synthetic_run: Any, cell: Cell, tmp_path: Path
) -> None:
    run = synthetic_run.write(tmp_path / "killed", status="running")
    for name in ("range_map.npz", "analysis.json", "left.png"):
        (run.look(1).path / name).write_bytes(b"half")
    page = write_replay(RunFolder.open(run.path), cell).read_text(encoding="utf-8")
    data = _data(page)
    assert [clip["title"] for clip in data["clips"]] == ["action 1", "action 2"]
    assert [part["name"] for part in data["clips"][1]["parts"]] == ["look"]
    assert "no end recorded" in page
    (run.path / "cloth.npz").unlink()
    (run.look(0).path / "motion.npz").write_bytes(b"half")
    data = _data(replay_page(run, cell))
    assert data["cloth"] is None
    assert data["robot"]["paths"] == []
    assert data["duration"] == pytest.approx(2.0 * LOOK_TIME)


def test_replay_of_a_run_without_looks_is_refused(cell: Cell, tmp_path: Path) -> None:
    settings = RunSettings("towel", "terry", "bunched", 7, "stereo", 0.5, "any", "foot", 10)
    run = RunFolder.create(tmp_path / "run", settings)
    with pytest.raises(InputError, match="ended before its first look"):
        write_replay(run, cell)
    assert not (run.path / "replay.html").exists()


@pytest.mark.slow
def test_five_actions_with_fine_cloth_stay_under_ten_megabytes(
    synthetic_run: Any, cell: Cell, tmp_path: Path
) -> None:
    """Every vertex of 80 x 80 moves independently all the time: the worst case."""
    run = synthetic_run.write(tmp_path / "long", nodes=80, status="running")
    motion, rng = run.look(0).motion(), np.random.default_rng(0)
    wild = motion.cloth_frames + rng.normal(0.0, 0.004, motion.cloth_frames.shape)
    run.look(0).save_motion(dc.replace(motion, cloth_frames=wild))
    for index in range(1, 5):
        shutil.copytree(run.look(0).path, run.look(index).path, dirs_exist_ok=True)
    path = write_replay(run, cell)
    assert path.stat().st_size < LARGEST_PAGE
    data = _data(path.read_text(encoding="utf-8"))
    assert len(data["clips"]) == 5
    assert data["cloth"]["vertices"] == 6400


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("chromium") is None, reason="no Chromium here")
def test_page_opens_in_a_browser_at_the_time_asked_for(page: str, tmp_path: Path) -> None:
    """The scripts run under the page's own policy.

    Tracks unpacked, panel and time line in place.
    """
    path = tmp_path / "replay.html"
    path.write_text(page, encoding="utf-8")
    command = ["chromium", "--headless=new", "--no-sandbox", "--disable-dev-shm-usage"]
    command += ["--ignore-gpu-blocklist", "--use-angle=swiftshader"]
    command += ["--enable-unsafe-swiftshader", "--virtual-time-budget=6000"]
    command += ["--enable-logging=stderr", "--dump-dom"]
    begin = _data(page)["clips"][1]["begin"]
    result = subprocess.run(
        [*command, f"--user-data-dir={tmp_path / 'profile'}", f"{path.as_uri()}#at={begin + 0.5}"],
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    dom = result.stdout
    assert '<span id="stage">action 2, look</span>' in dom, result.stderr[-2000:]
    assert 'data-ready="yes"' in dom
    assert re.search(r'data-clip="1" class="now"|class="now"[^>]*data-clip="1"', dom)
    assert re.search(r'<div data-look="1">', dom)
    assert dom.count('class="part"') == 9
    assert not re.search(r"CONSOLE.*(Error|Refused|violates)", result.stderr)
