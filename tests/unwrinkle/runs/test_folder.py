"""Folder of a run: written files are readable, however the run ends."""

import dataclasses as dc
import errno
import json
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any, Self

import numpy as np
import pytest

from unwrinkle.models.errors import InputError
from unwrinkle.perception.camera import Camera
from unwrinkle.perception.depth.capture import Capture
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.stereo.head import Gaze
from unwrinkle.perception.stereo.head_file import load_head_angles
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.verification.verdict import Verdict
from unwrinkle.runs.folder import (
    STATUSES,
    ActionRecord,
    MotionRecord,
    RunFolder,
    RunSettings,
    SegmentMark,
    command_line,
)

SETTINGS = RunSettings(
    "towel", "terry", "bunched", 7, "stereo", 0.5, "any", "foot", 10, "Glasgow:\n", "unwrinkle x"
)


def _motion(samples: int = 5, frames: int = 3) -> MotionRecord:
    axes = np.linspace(0.0, 1.0, samples)[:, None] * np.ones(13)
    cloth = np.arange(frames * 12, dtype=np.float32).reshape(frames, 4, 3) / 100.0
    return MotionRecord(
        2.0 + 0.1 * np.arange(samples),
        axes,
        np.ones((samples, 13)),
        axes + 1e-4,
        np.full((samples, 2), 0.03),
        (SegmentMark("pull", 2.1, 2.3),),
        2.0 + 0.2 * np.arange(frames),
        cloth,
    )


def _range_map() -> RangeMap:
    height = np.zeros((4, 5), dtype=np.float32)
    height[1, 2] = 0.01
    on = np.ones((4, 5), dtype=bool)
    return RangeMap(height, on, on, 0.001, np.array([0.0, -1.1]), 0.7, "stereo")


@pytest.fixture
def run(tmp_path: Path) -> RunFolder:
    return RunFolder.create(tmp_path / "new" / "run", SETTINGS)


# ---------------------------------------------------------------- the run


def test_a_run_is_read_as_it_was_written(run: RunFolder) -> None:
    again = RunFolder.open(run.path)
    assert again.settings == SETTINGS
    assert (again.status, again.reason, again.figures) == ("running", "", {})
    assert again.scenario_file == run.path / "scenario.yaml"
    assert (run.path / "scenario.yaml").read_text() == "Glasgow:\n"
    assert {"python", "unwrinkle", "drake"} <= set(again.record["versions"])
    assert again.last_complete() is None
    assert again.events() == []
    again.finish("flat", "all is smooth", {"coverage": 0.99})
    ended = RunFolder.open(run.path)
    assert (ended.status, ended.reason) == ("flat", "all is smooth")
    assert ended.figures == {"coverage": 0.99}
    assert ended.record["finished"] >= ended.record["created"]
    ended.resume()
    assert RunFolder.open(run.path).status == "running"
    assert RunFolder.open(run.path).record["finished"] is None


def test_a_run_is_not_made_over_another_or_over_a_file(run: RunFolder, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds a run already"):
        RunFolder.create(run.path, SETTINGS)
    file = tmp_path / "file"
    file.write_text("x")
    with pytest.raises(InputError, match="is a file; name a folder"):
        RunFolder.create(file, SETTINGS)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "run.json is missing"),
        ("{", "cannot be read as JSON"),
        ("[]", "holds no JSON object"),
        ('{"format": "other"}', "is no run of version 1"),
        ('{"format": "unwrinkle.run", "version": 1, "status": "odd"}', "the status or the figures"),
        (
            '{"format": "unwrinkle.run", "version": 1, "status": "flat", "figures": {}, "settings": {}}',
            "garment, texture, .* missing",
        ),
        ('{"format": "unwrinkle.run", "version": 1, "status": "flat", "figures": {}}', "settings"),
    ],
)
def test_a_folder_that_is_no_run_is_refused(
    tmp_path: Path, content: str | None, message: str
) -> None:
    if content is not None:
        (tmp_path / "run.json").write_text(content)
    with pytest.raises(InputError, match=message) as caught:
        RunFolder.open(tmp_path)
    assert str(tmp_path) in str(caught.value)


def test_a_missing_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such folder"):
        RunFolder.open(tmp_path / "none")


@pytest.mark.parametrize(
    ("status", "figures", "message"),
    [("odd", {}, "known are running, flat"), ("flat", {"x": np.nan}, r"run\.json")],
)
def test_finish_refuses_what_cannot_be_written(
    run: RunFolder, status: str, figures: dict[str, float], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        run.finish(status, figures=figures)
    assert RunFolder.open(run.path).status == "running"
    assert len(STATUSES) == 5


def test_command_line_names_the_program_without_its_path(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.argv", ["/somewhere/bin/unwrinkle", "flatten", "--out", "a b"])
    assert command_line() == "unwrinkle flatten --out 'a b'"


# ---------------------------------------------------------------- events


def test_events_are_on_the_disk_at_once_and_go_on_after_a_cut(run: RunFolder) -> None:
    run.event(0.0, "look", "first", {"gaze": [0.1]})
    run.event(1.5, "plan", "second")
    path = run.path / "events.jsonl"
    assert len(path.read_text().splitlines()) == 2
    with path.open("a") as stream:
        stream.write('{"number": 2, "time"')  # killed while it wrote
    again = RunFolder.open(run.path)
    assert [event.text for event in again.events()] == ["first", "second"]
    again.event(2.0, "move", "third")
    events = RunFolder.open(run.path).events()
    assert [(event.number, event.time, event.state) for event in events] == [
        (0, 0.0, "look"),
        (1, 1.5, "plan"),
        (2, 2.0, "move"),
    ]
    assert events[0].data == {"gaze": [0.1]}


def test_event_refuses_what_has_no_form_in_json(run: RunFolder) -> None:
    for data in ({"x": np.nan}, {"x": object()}):
        with pytest.raises(InputError, match="event 'bad'"):
            run.event(0.0, "look", "bad", data)
    assert run.events() == []


# ---------------------------------------------------------------- looks


def test_a_look_is_read_as_it_was_written(
    run: RunFolder, plan: FlatteningPlan, rng_picture: np.ndarray
) -> None:
    look = run.look(0)
    assert not look.exists
    gaze = Gaze(0.1, -0.2, -0.1, -0.2, 0.05)
    look.save_pair(rng_picture, rng_picture[::-1], gaze)
    look.save_range_map(_range_map())
    verdict = Verdict(plan.content_hash, "r", "l", (), (), (), 0.1, 3)
    look.save_plan(plan, verdict)
    look.save_motion(_motion())
    assert not look.is_complete
    record = ActionRecord(
        0, "done", "well", 2, ("right",), {"right": 0.01}, {"render": 2.0, "motion": 3.0},
        {"coverage": 0.9}, {"coverage": 0.95}, 0.02, 0.019, 4e-4, 1e-3, {"tried": [1, [2]]},
    )  # fmt: skip
    look.save_action(record)
    read = RunFolder.open(run.path).look(0)
    np.testing.assert_array_equal(read.left_picture(), rng_picture)
    np.testing.assert_array_equal(read.right_picture(), rng_picture[::-1])
    assert load_head_angles(read.path / "head.yaml")[0].gaze == gaze
    np.testing.assert_array_equal(read.range_map().height, _range_map().height)
    assert read.plan().content_hash == plan.content_hash
    assert read.verdict()["passed"] is True
    assert read.action() == record
    assert read.action().total == 5.0
    motion = read.motion()
    for name in ("times", "measured", "velocities", "reference", "openings", "cloth_frames"):
        np.testing.assert_array_equal(getattr(motion, name), getattr(_motion(), name))
    assert motion.segments == _motion().segments
    assert (motion.begin, motion.end) == (2.0, 2.4)
    assert run.last_complete() == 0


@pytest.fixture
def rng_picture() -> np.ndarray:
    return np.random.default_rng(1).integers(0, 255, (20, 30, 3), dtype=np.uint8)


def test_a_depth_look_is_read_as_it_was_written(run: RunFolder) -> None:
    camera = Camera("small", 32, 24, 30.0, 30.0, 15.5, 11.5)
    depth = np.full((24, 32), 1.2345, dtype=np.float32)
    run.look(0).save_depth(Capture(depth, camera))
    np.testing.assert_allclose(run.look(0).depth().depth, depth, atol=1e-4)


def test_last_complete_ends_at_the_first_gap(run: RunFolder) -> None:
    for index in (0, 1, 3):
        run.look(index).save_action(ActionRecord(index, "done"))
    run.look(4).save_range_map(_range_map())
    assert [look.index for look in run.looks()] == [0, 1, 3, 4]
    assert run.last_complete() == 1
    (run.look(1).path / "action.json").write_text("{")
    assert run.last_complete() == 0


def test_missing_and_damaged_files_of_a_look_are_named(run: RunFolder) -> None:
    look = run.look(0)
    reads: dict[str, Callable[[], Any]] = {
        "left.png": look.left_picture,
        "range_map.npz": look.range_map,
        "analysis.json": look.analysis,
        "plan.npz": look.plan,
        "verdict.json": look.verdict,
        "motion.npz": look.motion,
        "action.json": look.action,
        "depth.npz": look.depth,
    }
    for name, read in reads.items():
        with pytest.raises(InputError, match=name):
            read()
        look.path.mkdir(exist_ok=True)
        (look.path / name).write_bytes(b"{}")
    for name in set(reads) - {"verdict.json"}:
        with pytest.raises(InputError, match=name):
            reads[name]()
    with pytest.raises(InputError, match="looks are numbered from 0"):
        run.look(-1)


def test_action_and_motion_refuse_nonsense(run: RunFolder, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is look 1, but the record is of look 0"):
        run.look(1).save_action(ActionRecord(0, "done"))
    with pytest.raises(InputError, match="memory cannot be written as JSON"):
        run.look(0).save_action(ActionRecord(0, "done", memory=object()))
    with pytest.raises(InputError, match=r"seconds\.render is nan"):
        ActionRecord(0, "done", seconds={"render": np.nan})
    with pytest.raises(InputError, match="clearance is inf"):
        ActionRecord(0, "done", clearance=np.inf)
    with pytest.raises(InputError, match="index, outcome missing"):
        ActionRecord.from_json({})
    good = _motion()
    with pytest.raises(InputError, match="openings has shape"):
        dc.replace(good, openings=np.zeros((3, 2)))
    with pytest.raises(InputError, match="frame_times decrease"):
        dc.replace(good, frame_times=[1.0, 0.5, 2.0])
    bad = np.array(good.measured)
    bad[2, 3] = np.nan
    with pytest.raises(InputError, match=r"measured\[2, 3\] is not a finite number"):
        dc.replace(good, measured=bad)
    plan_like = tmp_path / "x.npz"
    np.savez(plan_like, a=np.zeros(2))
    with pytest.raises(InputError, match="is no motion record"):
        MotionRecord.load(plan_like)


def test_cloth_mesh_is_kept_and_checked(run: RunFolder) -> None:
    with pytest.raises(InputError, match=r"cloth\.npz"):
        run.cloth()
    with pytest.raises(InputError, match="do not match"):
        run.save_cloth(np.array([[0, 1, 3]]), np.zeros((3, 2)))
    run.save_cloth(np.array([[0, 1, 2]]), np.eye(3)[:, :2])
    triangles, rest = run.cloth()
    assert triangles.tolist() == [[0, 1, 2]]
    assert rest.shape == (3, 2)


# ---------------------------------------------------------------- a full disk


class _State:
    def save(self, path: Path) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")


def test_a_full_disk_names_the_file_and_leaves_the_run_readable(
    run: RunFolder, plan: FlatteningPlan, monkeypatch: pytest.MonkeyPatch
) -> None:
    run.event(0.0, "look", "first")
    run.look(0).save_action(ActionRecord(0, "done"))
    real = Path.open

    class Full:
        """Stream that writes half of the data, like a disk that becomes full."""

        def __init__(self, stream: IO[Any]) -> None:
            self._stream = stream

        def __enter__(self) -> Self:
            return self

        def __exit__(self, *_: object) -> None:
            self._stream.close()

        def __getattr__(self, name: str) -> Any:
            return getattr(self._stream, name)

        def write(self, data: Any) -> int:
            self._stream.write(data[: len(data) // 2])
            raise OSError(errno.ENOSPC, "No space left on device")

    def full(path: Path, mode: str = "r", *args: Any, **kwargs: Any) -> Any:
        stream = real(path, mode, *args, **kwargs)
        return Full(stream) if "w" in mode or "a" in mode else stream

    picture = np.zeros((4, 4, 3), dtype=np.uint8)
    look = run.look(1)
    writes: dict[str, Callable[[], Any]] = {
        "left.png": lambda: look.save_pair(picture, picture, Gaze()),
        "range_map.npz": lambda: look.save_range_map(_range_map()),
        "plan.npz": lambda: look.save_plan(plan),
        "motion.npz": lambda: look.save_motion(_motion()),
        "before.npz": lambda: look.save_before(_State()),
        "after.npz": lambda: look.save_after(_State()),
        "action.json": lambda: look.save_action(ActionRecord(1, "done")),
        "events.jsonl": lambda: run.event(1.0, "plan", "second"),
        "run.json": lambda: run.finish("flat"),
    }
    monkeypatch.setattr(Path, "open", full)
    for name, write in writes.items():
        with pytest.raises(InputError, match=f"{name}.*No space left"):
            write()
    monkeypatch.undo()
    assert sorted(path.name for path in look.path.iterdir()) == []
    again = RunFolder.open(run.path)
    assert again.status == "running"
    assert again.last_complete() == 0
    again.event(2.0, "stop", "third")
    assert [event.text for event in again.events()] == ["first", "third"]
    lines = (run.path / "events.jsonl").read_text().splitlines()
    assert json.loads(lines[-1])["number"] == 1
