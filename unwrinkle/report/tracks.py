"""Compact tracks of a run for a browser page.

On one clock, they hold the moving bodies' poses and key frames of the cloth.
"""

import base64
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.arrays import Array
from unwrinkle.runs.records import MotionRecord, SegmentMark
from unwrinkle.viewer.scene import CellScene

#: Samples of the robot per second; the page interpolates between them.
ROBOT_RATE = 20.0
#: Maximum key frames of the cloth per second while it moves; there are none while it rests.
CLOTH_RATE = 12.0
#: Displacement of a vertex since the last key frame below which the cloth counts as at rest, m.
CLOTH_RESTS = 3e-4
#: Resolution of positions, m.
STEP = 5e-5
#: Time for which each look is shown before its motion, and the last one at the end, s.
LOOK_TIME = 1.6
#: Maximum size of the cloth's packed track, bytes; key frames are dropped until it fits.
MOST_CLOTH_BYTES = 3_500_000
#: Scale of quaternions in 16 bits.
_UNIT = 32767.0


@dataclass(frozen=True, eq=False)
class Clip:
    """One look and the motion after it, on the replay's clock.

    Attributes:
        index: index of the look.
        begin: start of the look, s.
        motion: record of the motion; None if there is none.
    """

    index: int
    begin: float
    motion: MotionRecord | None

    @property
    def start(self) -> float:
        """Return the start of the motion, s."""
        return self.begin + LOOK_TIME

    @property
    def end(self) -> float:
        """Return the end of the motion, s."""
        return self.start + (0.0 if self.motion is None else self.motion.end - self.motion.begin)

    @property
    def segments(self) -> tuple[SegmentMark, ...]:
        """Return the motion's named parts on the replay's clock, the look first."""
        marks = [SegmentMark("look", self.begin, self.start)]
        if self.motion is not None:
            shift = self.start - self.motion.begin
            marks += [
                SegmentMark(mark.name, mark.begin + shift, mark.end + shift)
                for mark in self.motion.segments
            ]
        return tuple(marks)


def clips_of(motions: Sequence[tuple[int, MotionRecord | None]]) -> list[Clip]:
    """Return clips of looks with their indices and motions, one after the other."""
    clips: list[Clip] = []
    begin = 0.0
    for index, motion in motions:
        kept = motion if motion is not None and len(motion.times) > 1 else None
        clips.append(Clip(index, begin, kept))
        begin = clips[-1].end
    return clips


def posture_at(clips: Sequence[Clip], time: float, home: Array) -> tuple[Array, Array | None]:
    """Return axis positions (13,) rad and openings (2,) m at a time.

    The latter are None before any motion.
    """
    axes, openings = home, None
    for clip in clips:
        motion = clip.motion
        if motion is None:
            continue
        if time < clip.begin and openings is not None:
            break
        local = motion.begin + min(max(time - clip.start, 0.0), motion.end - motion.begin)
        axes = np.array([np.interp(local, motion.times, column) for column in motion.measured.T])
        openings = np.array([np.interp(local, motion.times, c) for c in motion.openings.T])
        if time < clip.end:
            break
    return axes, openings


@dataclass(frozen=True, eq=False)
class RobotTrack:
    """Poses of the moving bodies.

    Attributes:
        paths: paths of the bodies in the scene.
        poses: (F, B, 7) position in m and quaternion x, y, z, w, at `ROBOT_RATE`.
    """

    paths: tuple[str, ...]
    poses: Array

    def packed(self) -> dict[str, Any]:
        """Pack for the page: int16, differences between frames, deflated."""
        steps = np.concatenate(
            [self.poses[..., :3] / (2.0 * STEP), self.poses[..., 3:] * _UNIT], axis=-1
        )
        whole = np.rint(steps)
        if np.abs(whole).max(initial=0.0) > _UNIT:
            raise ValueError("a body is too far away for the resolution of the track")
        return {
            "paths": list(self.paths),
            "frames": len(self.poses),
            "rate": ROBOT_RATE,
            "step": 2.0 * STEP,
            "data": _packed(whole.reshape(len(whole), -1).astype(np.int16)),
        }


def robot_track(clips: Sequence[Clip], scene: CellScene, home: Array) -> RobotTrack:
    """Sample the robot along the clips; the scene is left in the first posture."""
    end = clips[-1].end if clips else 0.0
    times = np.arange(0.0, end + 1.0 / ROBOT_RATE, 1.0 / ROBOT_RATE)
    bodies = scene.bodies()
    poses = np.empty((len(times), len(bodies), 7))
    for k in range(len(times) - 1, -1, -1):
        axes, openings = posture_at(clips, float(times[k]), home)
        scene.move(axes, openings if openings is not None else scene.openings())
        poses[k] = scene.body_poses(bodies)
    # A quaternion and its negative are the same rotation: keep the one nearer to its predecessor.
    dots = np.sum(poses[1:, :, 3:] * poses[:-1, :, 3:], axis=-1)
    signs = np.concatenate([np.ones((1, len(bodies))), np.cumprod(np.where(dots < 0, -1, 1), 0)])
    poses[..., 3:] *= signs[..., None]
    moving = np.ptp(poses, axis=0).max(axis=-1) > 1e-6
    paths = tuple(path for path, moves in zip(bodies, moving, strict=True) if moves)
    return RobotTrack(paths, poses[:, moving])


@dataclass(frozen=True, eq=False)
class ClothTrack:
    """Key frames of the cloth.

    Attributes:
        times: (K,) times of the replay's clock, s.
        frames: (K, n, 3) vertices, world frame, m.
        triangles: (m, 3) indices of vertices.
    """

    times: Array
    frames: NDArray[np.float32]
    triangles: NDArray[np.int32]

    def packed(self, most: int = MOST_CLOTH_BYTES) -> dict[str, Any]:
        """Pack for the page: int16 multiples of `STEP`, differences between frames, deflated.

        Key frames are dropped until the text has at most `most` bytes.
        """
        low = self.frames.reshape(-1, 3).min(axis=0).astype(float)
        kept = np.arange(len(self.frames))
        while True:
            whole = np.rint((self.frames[kept] - low) / STEP)
            # A cloth of more than 3 m has diverged; its far end wraps around and is not shown
            # correctly.
            data = _packed(
                (whole.reshape(len(kept), -1).astype(np.int64) & 0xFFFF).astype(np.uint16)
            )
            if len(data) <= most or len(kept) <= 2:
                break
            kept = np.unique(np.append(kept[::2], kept[-1]))
        return {
            "times": np.round(self.times[kept], 3).tolist(),
            "low": low.tolist(),
            "step": STEP,
            "vertices": int(self.frames.shape[1]),
            "data": data,
            "triangles": _packed(self.triangles.astype(np.uint16).reshape(1, -1)),
        }


def cloth_track(
    clips: Sequence[Clip],
    triangles: NDArray[np.int32],
    rest: NDArray[np.float32],
    *,
    most_vertices: int = 8000,
) -> ClothTrack | None:
    """Select key frames of the cloth; a fine mesh is reduced to every second row and column.

    Args:
        clips: clips of the run.
        triangles: (m, 3) indices of the vertices.
        rest: (n, 2) vertices in the flat cloth, m; on a square grid.
        most_vertices: maximum number of vertices that is not reduced.

    Returns:
        None if no clip has cloth of that mesh.
    """
    times: list[float] = []
    frames: list[NDArray[np.float32]] = []
    for clip in clips:
        motion = clip.motion
        if motion is None or motion.cloth_frames.shape[1] != len(rest) or not len(rest):
            continue
        kept = key_frames(motion.frame_times, motion.cloth_frames)
        if not kept:
            continue
        shift = clip.start - motion.begin
        # The cloth at the look is shown until it moves.
        times.append(clip.begin)
        frames.append(motion.cloth_frames[kept[0]])
        for k in kept:
            times.append(max(float(motion.frame_times[k]) + shift, times[-1]))
            frames.append(motion.cloth_frames[k])
    if not frames:
        return None
    track = ClothTrack(np.array(times), np.stack(frames), triangles)
    while track.frames.shape[1] > most_vertices:
        track, rest = _halved(track, rest)
    return track


def key_frames(times: Array, frames: NDArray[np.float32]) -> list[int]:
    """Return the indices of the key frames.

    Their rate is limited while the cloth moves; the last frame before a motion is kept as well.
    """
    if len(frames) == 0:
        return []
    kept = [0]
    for k in range(1, len(frames)):
        if times[k] - times[kept[-1]] < 1.0 / CLOTH_RATE - 1e-6 and k < len(frames) - 1:
            continue
        moved = float(np.abs(frames[k] - frames[kept[-1]]).max(initial=0.0))
        if moved > CLOTH_RESTS:
            if k - 1 > kept[-1] and times[k] - times[kept[-1]] > 2.5 / CLOTH_RATE:
                kept.append(k - 1)
            kept.append(k)
    return kept


def _halved(track: ClothTrack, rest: NDArray[np.float32]) -> tuple[ClothTrack, NDArray[np.float32]]:
    """Keep every second row and column of the cloth's grid."""
    low = rest.min(axis=0)
    spacing = min(np.diff(np.unique(np.round(rest[:, k], 6))).min() for k in range(2))
    cells = np.rint((rest - low) / spacing).astype(int)
    number = np.full(cells.max(axis=0) + 3, -1)
    number[cells[:, 0], cells[:, 1]] = np.arange(len(rest))
    coarse = number[::2, ::2]
    used = coarse[coarse >= 0]
    new = np.full(len(rest), -1)
    new[used] = np.arange(len(used))
    a, b, c, d = coarse[:-1, :-1], coarse[1:, :-1], coarse[1:, 1:], coarse[:-1, 1:]
    faces = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)]).reshape(-1, 3)
    faces = faces[(faces >= 0).all(axis=1)]
    return (
        ClothTrack(track.times, track.frames[:, used], new[faces].astype(np.int32)),
        rest[used],
    )


def _packed(rows: NDArray[Any]) -> str:
    """Pack 16-bit rows: differences, low bytes before high bytes, deflated, base64."""
    bits = rows.view(np.uint16).copy()
    bits[1:] -= rows.view(np.uint16)[:-1]
    planes = bits.astype("<u2").view(np.uint8).reshape(-1, 2).T
    return base64.b64encode(zlib.compress(np.ascontiguousarray(planes).tobytes(), 6)).decode(
        "ascii"
    )
