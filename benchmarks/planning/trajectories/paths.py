"""The public set of seven-pose paths: its file, its reader, and the seeded maker of it.

    python -m benchmarks.planning.trajectories.paths OUT.npz

writes the set anew from the targets of `_plan_tasks`. Each path is what one dual-arm plan has to
run through, without any timing: five pieces, each from rest to rest, with the grippers closing
after the approach and opening after the pull.
"""

import dataclasses as dc
import hashlib
import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import InputError
from unwrinkle.models.io.archive import load_archive, save_archive
from unwrinkle.models.limits import Limits
from unwrinkle.models.robot import Cell, load_cell
from unwrinkle.planning.robot.collision import CollisionModel
from unwrinkle.planning.robot.kinematics import Kinematics
from unwrinkle.planning.search.key_poses import PIECES, POSES
from unwrinkle.planning.search.motion_search import MotionSearch, SevenPoseMotion
from unwrinkle.planning.search.settings import PlannerSettings
from unwrinkle.planning.search.transit import TransitPlanner
from unwrinkle.planning.timing.joint_path import JointPath
from unwrinkle.testing.targets import Task, tasks

FORMAT, VERSION = "unwrinkle-seven-pose-paths", 1
#: The five pieces of a path, in order.
NAMES = ("transit in", "approach", "pull", "release", "transit out")
#: Which of them are straight joint lines.
LINES = (0, 4)
#: Which of them runs with the cloth in the grippers, under the cap of the tool centre points'
#: speed.
HOLDING = 2
#: The set that is shipped.
SHIPPED = Path(__file__).parent / "path_set" / "seven_pose_paths.npz"

_COUNT = 40
_STEP = 3  # every third of the 120 targets, which meets all directions and places
_LIMITS = ("lower", "upper", "velocity", "acceleration", "jerk")


@dataclass(frozen=True, eq=False)
class Piece:
    """A piece of a path, from rest to rest.

    Attributes:
        name: one of `NAMES`.
        q: (N, 13) configurations at equal steps of the path parameter, rad.
        p_WT: (N, 2, 3) tool centre points of the right and the left arm there, m.
    """

    name: str
    q: Array
    p_WT: Array

    @property
    def holding(self) -> bool:
        """Whether the grippers hold cloth, so that the tool centre points' speed is capped."""
        return self.name == NAMES[HOLDING]

    def path(self) -> JointPath:
        """The curve that is to be followed: the quintic spline through the configurations."""
        return JointPath.through(self.q, self.p_WT if self.holding else None)


@dataclass(frozen=True)
class SevenPosePath:
    """One path of the set.

    Attributes:
        name: such as `forward-00`.
        group: forward, lateral or wide.
        pieces: the five.
        poses: name of each of the seven poses, the piece it lies in, and its index there.
    """

    name: str
    group: str
    pieces: tuple[Piece, ...]
    poses: tuple[tuple[str, int, int], ...]


@dataclass(frozen=True, eq=False)
class PathSet:
    """The whole set.

    Attributes:
        header: as in the file.
        paths: in order.
        limits: of the axes (and the tool's speed while holding), as the header states them.
    """

    header: Mapping[str, Any]
    paths: tuple[SevenPosePath, ...]
    limits: Limits


def load_paths(file: str | Path = SHIPPED) -> PathSet:
    """Read the set and check its hash.

    Raises:
        InputError: missing, damaged, of another format, or changed since it was made.
    """
    header, arrays = load_archive(file)
    if (header.get("format"), header.get("version")) != (FORMAT, VERSION):
        raise InputError(
            f"{file}: is no set of seven-pose paths of version {VERSION}; make one with "
            "`python -m benchmarks.planning.trajectories.paths OUT.npz`"
        )
    if content_hash(header, arrays) != header.get("sha256"):
        raise InputError(
            f"{file}: the content does not match its hash {str(header.get('sha256'))[:12]}; "
            "copy or make it again"
        )
    paths = []
    for i, entry in enumerate(header["paths"]):
        pieces = []
        for k, name in enumerate(NAMES):
            rows = (arrays["path"] == i) & (arrays["piece"] == k)
            pieces.append(Piece(name, arrays["q"][rows], arrays["p_WT"][rows]))
        poses = tuple((name, int(piece), int(index)) for name, piece, index in entry["poses"])
        paths.append(SevenPosePath(entry["name"], entry["group"], tuple(pieces), poses))
    stated = header["limits"]
    limits = dc.replace(
        load_cell().limits,
        lower=np.array(stated["lower"]),
        upper=np.array(stated["upper"]),
        velocity=np.array(stated["velocity"]),
        acceleration=np.array(stated["acceleration"]),
        jerk=np.array(stated["jerk"]),
        tip_speed_holding=stated["tip_speed_holding"],
    )
    return PathSet(header, tuple(paths), limits)


def content_hash(header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> str:
    """SHA-256 (hex) over the header but for its own entry `sha256`, and over every array."""
    text = json.dumps({k: v for k, v in header.items() if k != "sha256"}, sort_keys=True)
    digest = hashlib.sha256(text.encode())
    for name in sorted(arrays):
        value = np.ascontiguousarray(arrays[name])
        digest.update(f"{name}{value.dtype.str}{value.shape}".encode())
        digest.update(value.tobytes())
    return digest.hexdigest()


class PathMaker:
    """Makes paths from the planning benchmark's targets."""

    def __init__(self, cell: Cell) -> None:
        """Build the planner's search and its models."""
        self._settings = PlannerSettings()
        self._kinematics = Kinematics(cell)
        contact = CollisionModel(cell, contact=True)
        self._search = MotionSearch(cell, self._settings, self._kinematics, contact)
        self._transits = TransitPlanner(
            cell,
            CollisionModel(cell, contact=False),
            self._settings.transit_budget,
            self._settings.seed,
        )
        self._home = np.array(cell.robot.named_states["home"], dtype=float)

    def pieces(self, task: Task) -> tuple[tuple[Piece, ...], SevenPoseMotion] | None:
        """The five pieces for a target and the search's motion.

        None unless two arms can serve it by straight transits.
        """
        motion, _ = self._search.dual(task.target)
        if motion is None:
            return None
        ways = [
            self._transits.plan(self._home, motion.paths[0][0]),
            self._transits.plan(motion.paths[-1][-1], self._home),
        ]
        if any(way is None or way.kind != "line" for way in ways):
            return None
        there, back = (self._line(*way.points) for way in ways if way is not None)
        points = (there, *motion.paths, back)
        pieces = tuple(
            Piece(name, q, self._kinematics.tcp_positions(q))
            for name, q in zip(NAMES, points, strict=True)
        )
        return pieces, motion

    def _line(self, start: Array, goal: Array) -> Array:
        """Points of a joint line, about the planner's path step apart where the tools move most."""
        line = start + np.linspace(0.0, 1.0, 201)[:, None] * (goal - start)
        tips = self._kinematics.tcp_positions(line)
        length = np.linalg.norm(np.diff(tips, axis=0), axis=2).sum(axis=0).max()
        count = max(8, int(np.ceil(length / self._settings.path_step)) + 1)
        return np.asarray(start + np.linspace(0.0, 1.0, count)[:, None] * (goal - start))


def make_paths(file: str | Path, *, seed: int = 0, count: int = _COUNT) -> None:
    """Write a set of `count` paths, every third of the planning benchmark's targets of that seed.

    A target that two arms cannot serve by straight transits gives way to the next one.
    """
    cell = load_cell()
    maker = PathMaker(cell)
    todo = tasks(seed)
    entries, columns = [], []
    for i in range(count):
        at = (i * _STEP) % len(todo)
        made = None
        while made is None:
            index, made = at, maker.pieces(todo[at])
            at = (at + 1) % len(todo)
        pieces, motion = made
        task = todo[index]
        poses = []
        for k, (_, first, last) in enumerate(PIECES):
            marks = (0, motion.corner_index[k], len(motion.paths[k]) - 1)
            named = zip(POSES[first : last + 1], marks, strict=True)
            poses += [(name, k + 1, int(m)) for name, m in named][1 if k else 0 :]
        entries.append(
            {
                "name": f"{task.group}-{index:03d}",
                "group": task.group,
                "target": task.target.to_json(),
                "poses": poses,
            }
        )
        columns += [(i, k, piece) for k, piece in enumerate(pieces)]
    lengths = [len(piece.q) for _, _, piece in columns]
    arrays: dict[str, NDArray[Any]] = {
        "q": np.concatenate([piece.q for _, _, piece in columns]),
        "p_WT": np.concatenate([piece.p_WT for _, _, piece in columns]),
        "path": np.repeat([i for i, _, _ in columns], lengths).astype(np.int16),
        "piece": np.repeat([k for _, k, _ in columns], lengths).astype(np.int8),
    }
    limits = cell.limits
    header: dict[str, Any] = {
        "format": FORMAT,
        "version": VERSION,
        "licence": "BSD-3-Clause",
        "robot": cell.robot.name,
        "seed": seed,
        "axes": list(cell.robot.axes),
        "units": "rad, m, s",
        "pieces": list(NAMES),
        "straight": list(LINES),
        "holding": HOLDING,
        "stops": "at rest at both ends of every piece; grippers close after piece 1, open after piece 2",
        "path_step": PlannerSettings().path_step,
        "limits": {
            **{name: getattr(limits, name).tolist() for name in _LIMITS},
            "tip_speed_holding": limits.tip_speed_holding,
        },
        "paths": entries,
    }
    header = json.loads(json.dumps(header))  # as it will be read, for the hash
    save_archive(file, {**header, "sha256": content_hash(header, arrays)}, arrays)


if __name__ == "__main__":
    make_paths(sys.argv[1])
