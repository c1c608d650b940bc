"""Fixtures of the tests of pages and pictures: a synthetic plan and a synthetic run."""

import dataclasses as dc
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from unwrinkle import cli
from unwrinkle.flattening.flattener import Choice, NoChoice, choose
from unwrinkle.flattening.observation import Observation
from unwrinkle.flattening.policy import PolicyState
from unwrinkle.hardware.controller_state import DriverStatus, JointFeedback
from unwrinkle.hardware.run_log.writer import RunLog
from unwrinkle.models.robot import Cell, load_cell
from unwrinkle.models.scenario import LoopSettings
from unwrinkle.perception.camera import Camera
from unwrinkle.perception.depth.range_mapping import range_map_from_capture
from unwrinkle.perception.sensor import noise_profile
from unwrinkle.perception.stereo.head import Gaze
from unwrinkle.perception.target import FlatteningTarget, HandTarget
from unwrinkle.perception.wrinkles.analysis import Analysis, analyse
from unwrinkle.planning.plan import (
    ArmChoice,
    FlatteningPlan,
    GarmentSurface,
    GripperEvent,
    PoseMark,
    Segment,
)
from unwrinkle.planning.search.key_poses import POSES
from unwrinkle.planning.search.planner import FlatteningPlanner
from unwrinkle.planning.trajectory import Trajectory
from unwrinkle.planning.verification.verdict import Verdict
from unwrinkle.planning.verification.verifier import verify
from unwrinkle.runs.folder import ActionRecord, MotionRecord, RunFolder, RunSettings, SegmentMark
from unwrinkle.simulation.rendering.meshes import grid_triangles
from unwrinkle.simulation.rendering.synthetic_towel import (
    Towel,
    capture_of,
    overhead_pose,
    wrinkled_towel,
)
from unwrinkle.testing.table import TABLE
from unwrinkle.viewer.playback import Playback

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
    """Return a plan of sine motions from home and back, with segments of 1 s * stretch."""
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


# ---------------------------------------------------------------- the log of an execution

#: Time 0 of the log's clock, s.
LOG_BEGIN = 100.0


@pytest.fixture
def log(plan: FlatteningPlan, cell: Cell, tmp_path: Path) -> Path:
    """Write the log of a run of the plan at 40 Hz, with rest before and after."""
    plan.save(tmp_path / "plan.npz")
    header = {
        "site": "loopback",
        "plan_file": str(tmp_path / "plan.npz"),
        "plan_hash": plan.content_hash,
        "axes": cell.robot.axes,
        "clock": LOG_BEGIN,
        "begun": "2026-01-02T03:04:05.000+00:00",
        "scenario": "",
        "speed": 1.0,
    }
    with RunLog.create(tmp_path / "run.jsonl", header) as writer:
        for segment in plan.segments:
            path = segment.trajectory
            for i in range(0, len(path.times), 10):
                now = LOG_BEGIN + 5.0 + segment.start + path.times[i]
                writer.commanded(now, 1, i, path.times[i], path.positions[i], path.velocities[i])
        times = np.arange(0.0, plan.segments[-1].end + 10.0, 0.025)
        for k, time in enumerate(times):
            local = np.clip(time - 5.0, 0.0, plan.segments[-1].end)
            segment = [s for s in plan.segments if s.start <= local][-1]
            q = segment.trajectory.interpolant()(
                min(local - segment.start, segment.trajectory.duration)
            )
            writer.measured(
                LOG_BEGIN + time, JointFeedback(q, np.zeros(13), LOG_BEGIN + time, time, k)
            )
        for event in plan.events:
            now = LOG_BEGIN + 5.0 + event.time
            writer.event(now, "gripper", "both", closed=list(event.closed))
        writer.status(LOG_BEGIN, DriverStatus("ready"))
        writer.status(LOG_BEGIN + 5.0, DriverStatus("running"))
        writer.event(LOG_BEGIN + 9.0, "result", "done", outcome="done")
    return tmp_path / "run.jsonl"


# ---------------------------------------------------------------- a run that was never made


@dataclass(frozen=True)
class SyntheticRun:
    """Synthetic run: towels that lose one ridge per action, with all records."""

    cell: Cell
    towels: tuple[Towel, ...]
    analyses: tuple[Analysis, ...]
    plans: tuple[FlatteningPlan, ...]
    verdicts: tuple[Verdict, ...]

    def write(self, path: Path, *, nodes: int = 20, status: str = "flat") -> RunFolder:
        """Write the run's folder; the status "running" leaves the last action incomplete."""
        settings = RunSettings(
            garment="towel",
            texture="terry",
            start="ridge",
            seed=7,
            sensor="stereo",
            scale=0.5,
            arms="any",
            mode="foot",
            actions=10,
            scenario="Glasgow:\n  speed: 1.0\n",
            command="unwrinkle flatten --seed 7",
        )
        run = RunFolder.create(path, settings)
        rest, triangles = flat_cloth(nodes)
        run.save_cloth(triangles, rest)
        begin = 0.0
        for index, analysis in enumerate(self.analyses):
            look = run.look(index)
            run.event(begin, "look", f"look {index}")
            picture = analysis.range_map.colour
            assert picture is not None
            eye = np.ascontiguousarray(np.flip(picture, axis=(0, 1)))
            look.save_pair(eye, eye, Gaze(0.1, -0.5, -0.1, -0.5))
            look.save_range_map(analysis.range_map)
            choice = chosen(analysis)
            if isinstance(choice, Choice):
                wrinkle = choice.decision.wrinkle.index
                look.save_analysis(Observation.of(analysis), target=choice.target, wrinkle=wrinkle)
            else:
                look.save_analysis(Observation.of(analysis), stop=choice.stop)
            if index == len(self.plans):
                break
            plan, verdict = self.plans[index], self.verdicts[index]
            look.save_plan(plan, verdict)
            if status == "running" and index == len(self.plans) - 1:
                return run
            pair = self.towels[index], self.towels[index + 1]
            motion = motion_along(plan, self.cell, pair, rest, begin)
            look.save_motion(motion)
            begin = motion.end + 3.0
            smallest = verdict.smallest
            look.save_action(
                ActionRecord(
                    index=index,
                    outcome="done",
                    wrinkle=wrinkle,
                    arms=("right", "left"),
                    pulls={"right": 0.012, "left": 0.012},
                    seconds={
                        "render": 6.1,
                        "stereo": 2.4,
                        "analysis": 0.7,
                        "planning": 0.5,
                        "verification": 0.9,
                        "motion": 7.7,
                    },
                    truth_before=_truth(pair[0]),
                    truth_after=_truth(pair[1]),
                    clearance=None if smallest is None else smallest.distance,
                    clearance_measured=None if smallest is None else smallest.distance - 0.0004,
                    following_error=0.0004,
                    grip_distance_error=0.0011,
                    memory={"tried": [index]},
                )
            )
        run.finish(status, "no wrinkle asks for a pull of 5 mm", {"seconds": 61.0})
        return run


def flat_cloth(nodes: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices (n, 2) of a flat square towel, m, and its triangles."""
    u, v = np.meshgrid(np.linspace(-0.24, 0.24, nodes), np.linspace(-0.24, 0.24, nodes))
    return np.column_stack([u.ravel(), v.ravel()]), grid_triangles(nodes, nodes)


def _truth(towel: Towel) -> dict[str, float]:
    height = max((ridge.height for ridge in towel.ridges), default=0.0)
    return {"coverage": 1.0 - 0.02 * len(towel.ridges), "height": height, "overstretch": 0.01}


def motion_along(
    plan: FlatteningPlan,
    cell: Cell,
    towels: tuple[Towel, Towel],
    rest: NDArray[np.float64],
    begin: float,
) -> MotionRecord:
    """Return a motion that follows a plan; the first towel becomes the second during the pull."""
    playback = Playback(plan, cell)
    times = np.arange(0.0, playback.duration, 0.025)
    positions = np.array([playback.positions(t) for t in times])
    pull = plan.segments[1]
    frames = np.arange(0.0, playback.duration, 0.1)
    x, y = (rest + towels[0].centre).T
    heights = [towel.table_height + np.maximum(towel.height(x, y), 0.002) for towel in towels]
    share = np.clip((frames - pull.start) / (pull.end - pull.start), 0.0, 1.0)
    width = 1.0 - 0.03 * (1.0 - share[:, None])
    cloth = np.stack(
        [
            towels[0].centre[0] + width * rest[:, 0],
            np.broadcast_to(y, (len(frames), len(y))),
            heights[0] + share[:, None] * (heights[1] - heights[0]),
        ],
        axis=-1,
    )
    return MotionRecord(
        times=begin + times,
        measured=positions,
        velocities=np.zeros_like(positions),
        reference=positions,
        openings=np.array([playback.openings(t) for t in times]),
        segments=tuple(
            SegmentMark(segment.name, begin + segment.start, begin + segment.end)
            for segment in plan.segments
        ),
        frame_times=begin + frames,
        cloth_frames=cloth.astype(np.float32),
    )


def chosen(analysis: Analysis) -> Choice | NoChoice:
    """Return the closed loop's choice by the shipped rules."""
    return choose(Observation.of(analysis), PolicyState(), LoopSettings())


def _seen(towel: Towel) -> Analysis:
    camera = Camera("overhead", 640, 480, 700.0, 700.0, 319.5, 239.5)
    capture = capture_of(towel, camera, overhead_pose(0.0, -1.1, 1.6))
    return analyse(
        range_map_from_capture(
            capture, profile=noise_profile("stereo"), centre=towel.centre, table_height=0.70
        ),
        table=TABLE,
    )


@pytest.fixture(scope="session")
def synthetic_run(cell: Cell) -> SyntheticRun:
    """Two actions and a last look at a towel with one small ridge."""
    towel = wrinkled_towel(7)
    towels = tuple(dc.replace(towel, ridges=towel.ridges[k:], thickness=0.004) for k in range(3))
    analyses = tuple(map(_seen, towels))
    planner = FlatteningPlanner(cell)
    plans = []
    for analysis in analyses[:2]:
        choice = chosen(analysis)
        assert isinstance(choice, Choice)
        garment = Observation.of(analysis).garment(choice.decision.wrinkle.index)
        plan = planner.plan(choice.target, garment=garment).plan
        assert plan is not None
        plans.append(plan)
    verdicts = tuple(verify(plan, cell) for plan in plans)
    return SyntheticRun(cell, towels, analyses, tuple(plans), verdicts)


@pytest.fixture
def main(monkeypatch: pytest.MonkeyPatch) -> Callable[..., int]:
    """Return a function that runs the command line and returns the exit code."""

    def run(*arguments: str | Path) -> int:
        monkeypatch.setattr(sys, "argv", ["unwrinkle", *map(str, arguments)])
        with pytest.raises(SystemExit) as stop:
            cli.main()
        assert isinstance(stop.value.code, int)
        return stop.value.code

    return run
