"""Build the replay of a run: one self-contained page with the motion of the robot and the cloth."""

import logging
from collections.abc import Sequence
from html import escape
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from unwrinkle.models.errors import InputError
from unwrinkle.models.io.files import write_text
from unwrinkle.models.robot import Cell
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.report.look_card import STATUS, ReadLook, look_name, look_picture
from unwrinkle.report.pictures import RAMP, Window, top_height
from unwrinkle.report.tracks import (
    LOOK_TIME,
    Clip,
    ClothTrack,
    clips_of,
    cloth_track,
    posture_at,
    robot_track,
)
from unwrinkle.runs.folder import RUNNING, RunFolder
from unwrinkle.runs.look_folder import readable
from unwrinkle.viewer.overlay import closed_page
from unwrinkle.viewer.pages import filled_page
from unwrinkle.viewer.plan_shapes import COLOURS, ridge_shapes, target_shapes
from unwrinkle.viewer.scene import ILLUSTRATION, OVERVIEW, CellScene, rgba, start_meshcat

PAGE = "replay.html"
#: Colour of each named part of a motion on the time line; other parts have the last colour.
PARTS = {
    "look": "#b4bdc9",
    "approach": "#31688e",
    "close": "#e0a100",
    "open": "#e0a100",
    "pull": COLOURS.pull,
    "release": "#35b779",
    "retreat": "#c62828",
}
_OTHER_PART = "#8e5bb5"
_CLOTH = "#5f87ab"

_log = logging.getLogger(__name__)

_SIMULATED = (
    "Robot, cloth and pictures are simulated. The robot shows its measured motion, the cloth its "
    "computed motion."
)
_REAL = "The robot shows the motion measured on the site's devices; the garment is not shown."


def write_replay(run: RunFolder, cell: Cell) -> Path:
    """Write `replay.html` into the run's folder; return its path.

    Raises:
        InputError: the run has no look, or the file cannot be written.
    """
    path = run.path / PAGE
    page = replay_page(run, cell)
    write_text(path, page)
    _log.info("%s: %.2f MB", path, 1e-6 * len(page))
    return path


def replay_page(run: RunFolder, cell: Cell) -> str:
    """Build the page from whatever can be read.

    Args:
        run: folder of the run.
        cell: cell of the run.

    Returns:
        HTML that needs no other file and makes no request.

    Raises:
        InputError: the run has no look.
    """
    looks = [ReadLook.of(folder) for folder in run.looks()]
    if not looks:
        raise InputError(f"{run.path}: the run ended before its first look; nothing to replay")
    clips = clips_of([(look.folder.index, readable(look.folder.motion)) for look in looks])
    meshcat = start_meshcat()
    scene = CellScene(cell, meshcat, proximity=False)
    home = np.array(cell.robot.named_states["home"], dtype=float)
    robot = robot_track(clips, scene, home)
    axes, openings = posture_at(clips, 0.0, home)
    scene.move(axes, scene.openings() if openings is None else openings)
    for look in looks:
        draw_marks(meshcat, look)
    cloth = _cloth(run, clips)
    maps = [look.range_map for look in looks if look.range_map is not None]
    data = {
        "duration": clips[-1].end + (0.0 if clips[-1].motion is None else LOOK_TIME),
        "clips": [_clip(clip, look) for clip, look in zip(clips, looks, strict=True)],
        "robot": robot.packed(),
        "cloth": None if cloth is None else cloth.packed(),
        "colour": _colour(maps),
        "ramp": RAMP,
        "top": top_height(maps),
        "table": cell.table.height,
        "views": _views(cell),
    }
    return _page(meshcat.StaticHtml(), run, looks, clips, data)


def _page(
    page: str,
    run: RunFolder,
    looks: Sequence[ReadLook],
    clips: Sequence[Clip],
    data: dict[str, Any],
) -> str:
    kind, word = STATUS[run.status]
    heading = f"Flattening run {run.path.resolve().name}"
    reason = run.reason
    if run.status == RUNNING:
        reason = (
            "The run is still going on, or was killed; this is the present content of its folder."
        )
    maps = [look.range_map for look in looks if look.range_map is not None]
    window = readable(lambda: Window.around(maps))
    names = dict.fromkeys(mark.name for clip in clips for mark in clip.segments)
    panel = filled_page(
        "unwrinkle.report",
        "replay.html",
        heading=heading,
        kind=kind,
        status=word,
        reason=reason,
        names=[look_name(look) for look in looks],
        looks=[
            (look_name(look), Markup(_facts(look) + look_picture(look, window))) for look in looks
        ],
        views=list(data["views"]),
        layers=Markup(_layers()),
        real=Markup(_REAL if run.settings.station == "hardware" else _SIMULATED),
        key=[(name, _part_colour(name)) for name in names],
        data=data,
    )
    before, body, after = closed_page(page, heading).rpartition("</body>")
    return f"{before}{panel}\n{body}{after}"


def _clip(clip: Clip, look: ReadLook) -> dict[str, Any]:
    segments = clip.segments
    return {
        "index": clip.index,
        "title": look_name(look),
        "begin": clip.begin,
        "marksUntil": marks_until(clip),
        "parts": [
            {
                "name": mark.name,
                "begin": mark.begin,
                "end": mark.end,
                "colour": _part_colour(mark.name),
            }
            for mark in segments
            if isfinite(mark.begin) and mark.end > mark.begin
        ],
    }


def marks_until(clip: Clip) -> float:
    """Return the end of a look's marks, s on the replay's clock: the pull changes the cloth."""
    pulls = [mark.begin for mark in clip.segments if mark.name == "pull"]
    return pulls[0] if pulls else clip.start + 0.4 * (clip.end - clip.start)


def _part_colour(name: str) -> str:
    return PARTS.get(name.split(" ")[0], _OTHER_PART)


def draw_marks(meshcat: Any, look: ReadLook) -> str:
    """Draw the wrinkles and the arrows of the plan, hidden; return their path in the scene."""
    root = f"run/look {look.folder.index}"
    data = look.marked or {}
    curves = [
        np.array(wrinkle.get("curve", []), dtype=float).reshape(-1, 3)
        for wrinkle in data.get("wrinkles", [])
    ]
    shapes = list(ridge_shapes(curves, data.get("target", {}).get("wrinkle")))
    if look.plan is not None:
        shapes += target_shapes(look.plan)
    for path, (vertices, faces), colour in shapes:
        meshcat.SetTriangleMesh(f"{root}/{path}", vertices.T, faces.T, rgba(colour))
    meshcat.SetProperty(root, "visible", False)
    return root


def _cloth(run: RunFolder, clips: Sequence[Clip]) -> ClothTrack | None:
    mesh = readable(run.cloth)
    if mesh is None:
        return None
    return cloth_track(clips, *mesh)


def _colour(maps: Sequence[RangeMap]) -> str:
    """Return the garment's mean colour, #rrggbb."""
    for range_map in maps:
        if range_map.colour is not None and range_map.garment.any():
            mean = np.rint(range_map.colour[range_map.garment].mean(axis=0)).astype(int)
            return "#" + "".join(f"{value:02x}" for value in mean)
    return _CLOTH


def _facts(look: ReadLook) -> str:
    rows: list[tuple[str, str]] = []
    if look.action is not None:
        rows.append(("outcome", look.action.outcome))
    if look.analysis is not None:
        rows.append(("wrinkles seen", str(len(look.analysis.get("wrinkles", [])))))
        rows.append(("largest pull", f"{1e3 * look.analysis['halting_measure']:.1f} mm"))
    if look.verdict is not None and look.verdict.get("smallest_clearance"):
        distance = look.verdict["smallest_clearance"]["distance"]
        rows.append(("smallest clearance", f"{1e3 * distance:.0f} mm"))
    if look.action is not None:
        before, after = look.action.truth_before or {}, look.action.truth_after or {}
        for key, name, factor, unit in (
            ("coverage", "coverage", 100.0, "%"),
            ("height", "true height", 1e3, "mm"),
        ):
            if key in before and key in after:
                text = f"{factor * before[key]:.1f} → {factor * after[key]:.1f} {unit}"
                rows.append((name, text))
    listed = "".join(f"<tr><td>{escape(a)}</td><td>{escape(b)}</td></tr>" for a, b in rows)
    reason = "" if look.action is None else f"<p>{escape(look.action.reason)}</p>"
    return f"<table>{listed}</table>{reason}"


def _layers() -> str:
    rows = [
        f'<label><input type="checkbox" data-layer="{path}" checked>{marks}{text}</label>'
        for path, text, marks in (
            ("cloth", "cloth", f'<i style="background:{_CLOTH}"></i>'),
            (
                "run",
                "wrinkles, approaches, pulls (longer than true)",
                "".join(
                    f'<i style="background:{colour}"></i>'
                    for colour in (COLOURS.ridge, COLOURS.grasp, COLOURS.pull)
                ),
            ),
            (ILLUSTRATION, "robot and cell", '<i style="background:#2a5ca8"></i>'),
        )
    ]
    bar = f'<i style="background:linear-gradient(90deg, {", ".join(RAMP)});width:40px"></i>'
    rows.append(f'<label><input type="checkbox" id="tint">{bar}cloth coloured by height</label>')
    return "".join(rows)


def _views(cell: Cell) -> dict[str, list[list[float]]]:
    """Return the camera and target of each view, world frame, m."""
    x, y = cell.scenario.garment_centre
    z = cell.table.height
    return {
        "overview": [list(point) for point in OVERVIEW],
        "garment": [[x + 0.25, y - 1.0, z + 0.62], [x, y, z]],
        "above": [[x, y - 0.02, z + 1.4], [x, y, z]],
        "low": [[x - 0.75, y - 0.75, z + 0.2], [x, y, z + 0.02]],
    }
