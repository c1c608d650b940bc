"""Render the run of a closed loop as a looped animation for the front page.

Run: python docs/loop_animation.py RUN docs/_static/loop.webp
"""

import sys
from pathlib import Path

import numpy as np
from PIL import Image

from unwrinkle.models.robot import load_cell
from unwrinkle.perception.camera import Camera
from unwrinkle.report.tracks import LOOK_TIME, clips_of, cloth_track, posture_at
from unwrinkle.runs.folder import RunFolder
from unwrinkle.runs.look_folder import readable
from unwrinkle.simulation.rendering.meshes import TexturedMesh
from unwrinkle.simulation.rendering.renderer import Renderer
from unwrinkle.simulation.rendering.textures import cloth

#: Length of the animation, s, and its frames per second.
LENGTH, RATE = 20.0, 8.0
#: Quality of the frames, 0 to 100.
QUALITY = 60
#: Grey levels of the animation for those of the renderer.
BRIGHTER = np.rint(255.0 * (np.arange(256) / 255.0) ** 0.6).astype(np.uint8)
CAMERA = Camera("front page", 560, 350, 520.0, 520.0, 279.5, 174.5)
EYE, POINT = np.array([1.35, -2.80, 2.30]), np.array([0.05, -0.60, 0.95])


def looking(eye: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Return the pose X_WC (4, 4) of a camera at a point of the world (3,), m, upright."""
    z = (point - eye) / np.linalg.norm(point - eye)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    X = np.eye(4)
    X[:3, 0], X[:3, 1], X[:3, 2], X[:3, 3] = x, np.cross(z, x), z, eye
    return X


def main(folder: str, path: str) -> None:
    """Write the animation of a run's folder."""
    run, cell = RunFolder.open(Path(folder)), load_cell()
    clips = clips_of([(look.index, readable(look.motion)) for look in run.looks()])
    mesh = readable(run.cloth)
    assert mesh is not None
    triangles, rest = mesh
    track = cloth_track(clips, triangles, rest)
    assert track is not None
    home = np.array(cell.robot.named_states["home"], dtype=float)
    size = rest.max(axis=0) - rest.min(axis=0)
    uv = (rest - rest.min(axis=0)) / size
    weave = cloth("plain", tuple(size), seed=3)

    def shape(time: float) -> TexturedMesh:
        k = int(np.clip(np.searchsorted(track.times, time, side="right") - 1, 0, None))
        after = min(k + 1, len(track.times) - 1)
        gap = track.times[after] - track.times[k]
        share = 0.0 if gap <= 0.0 else float(np.clip((time - track.times[k]) / gap, 0.0, 1.0))
        vertices = (1.0 - share) * track.frames[k] + share * track.frames[after]
        return TexturedMesh("cloth", vertices, track.triangles.astype(np.int64), uv, weave)

    renderer = Renderer(cell, [shape(0.0)], shadows=False)
    end = clips[-1].end + LOOK_TIME
    frames = []
    for time in np.linspace(0.0, end, int(LENGTH * RATE)):
        axes, _ = posture_at(clips, float(time), home)
        renderer.set_posture(axes)
        renderer.reshape("cloth", shape(float(time)))
        drawn = renderer.colour(CAMERA, looking(EYE, POINT), quality=2)
        frames.append(Image.fromarray(BRIGHTER[drawn]))
    frames[0].save(
        path,
        save_all=True,
        append_images=frames[1:],
        duration=int(1000 / RATE),
        loop=0,
        quality=QUALITY,
        method=6,
        minimize_size=False,
    )
    frames[len(frames) // 3].save(Path(path).with_suffix(".png"))
    print(f"{path}: {len(frames)} frames of {end:.1f} s of the run, {Path(path).stat().st_size} B")


if __name__ == "__main__":
    main(*sys.argv[1:])
