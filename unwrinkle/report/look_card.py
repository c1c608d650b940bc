"""Section of the report page on one look: its pictures, its wrinkles, the plan and the result."""

from dataclasses import dataclass
from functools import partial
from html import escape
from math import degrees
from typing import Any

from unwrinkle.perception.range_map import RangeMap
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.report.pictures import (
    BORDER,
    FOLD_LINE,
    Window,
    analysis_marks,
    camera_picture,
    relief,
    seen_from_above,
)
from unwrinkle.runs.folder import RUNNING
from unwrinkle.runs.look_folder import LookFolder, readable
from unwrinkle.runs.records import ActionRecord

#: Style and label of a run's status on the pages.
STATUS = {
    "flat": ("good", "flat"),
    "stopped": ("fair", "stopped"),
    "fault": ("bad", "fault"),
    "interrupted": ("fair", "interrupted"),
    RUNNING: ("fair", "no end recorded"),
}
_LISTED = 6


@dataclass(frozen=True)
class ReadLook:
    """Readable records of a look; None for a missing or damaged record."""

    folder: LookFolder
    range_map: RangeMap | None
    analysis: dict[str, Any] | None
    plan: FlatteningPlan | None
    verdict: dict[str, Any] | None
    action: ActionRecord | None

    @classmethod
    def of(cls, folder: LookFolder) -> "ReadLook":
        """Read the records that exist."""
        return cls(
            folder,
            readable(folder.range_map),
            readable(folder.analysis),
            readable(folder.plan),
            readable(folder.verdict),
            readable(folder.action),
        )

    @property
    def marked(self) -> dict[str, Any] | None:
        """Return the analysis with the target of the plan, if it is known."""
        if self.analysis is None or self.plan is None:
            return self.analysis
        index = None if self.action is None else self.action.wrinkle
        if index is None:
            index = self.analysis.get("target", {}).get("wrinkle")
        return {**self.analysis, "target": {**self.plan.target.to_json(), "wrinkle": index}}

    @property
    def acted(self) -> bool:
        """Return whether the look was followed by a motion, or by a plan for one."""
        return self.plan is not None or (self.action is not None and bool(self.action.arms))


def look_name(look: ReadLook) -> str:
    """Return the look's name on the page."""
    return f"action {look.folder.index + 1}" if look.acted else f"look {look.folder.index + 1}"


def look_card(look: ReadLook, after: ReadLook | None, window: Window | None, top: float) -> str:
    """Build the look's section of the page.

    Args:
        look: look to describe.
        after: next look, if there is one.
        window: rectangle of the pictures; None if no range map was made.
        top: height at the upper end of the colour scale, m.
    """
    pictures = [look_picture(look, window), _relief_before(look, window, top)]
    if look.acted:
        if after is None:
            pictures.append(_missing("no look after this action"))
        else:
            pictures.append(_relief_after(after, window, top))
    columns = [_wrinkles(look) + _outcome(look), _plan(look)]
    scale = f'<p class="small">height 0<span class="ramp"></span>{1e3 * top:.0f} mm'
    legend = (
        f'{scale}; <b style="color:#d50000">red</b> the wrinkle to be pulled, '
        '<b style="color:#00a152">green</b> the approach of the fingers, <b style="color:#ff6d00">orange</b> the pull '
        "(arrows not to scale); "
        f'<b style="color:{BORDER}">violet</b> borders of layers, <b style="color:{FOLD_LINE}">black</b> fold lines and the '
        "directions in which flaps open</p>"
    )
    outcome = ""
    if look.action is not None:
        kind = {"done": "good", "flat": "good"}.get(look.action.outcome, "fair")
        outcome = f'<span class="status {kind}">{escape(look.action.outcome)}</span>'
    elif look.acted:
        outcome = '<span class="status fair">not finished</span>'
    reason = escape(look.action.reason) if look.action is not None else ""
    title = look_name(look).capitalize()
    return (
        f'<section id="look{look.folder.index}"><h2>{title}{outcome}</h2><p>{reason}</p>'
        f'<div class="pictures">{"".join(pictures)}</div>{legend}'
        f'<div class="columns"><div>{columns[0]}</div><div>{columns[1]}</div></div></section>'
    )


def _missing(text: str) -> str:
    return f'<figure><div class="picture missing">{escape(text)}</div></figure>'


def look_picture(look: ReadLook, window: Window | None) -> str:
    """Return the left camera's image around the window with marks, as a figure.

    If it is missing, the figure is a text.
    """
    if window is None:
        return _missing("no range map was made")
    height = 0.7 if look.range_map is None else look.range_map.table_height
    picture = readable(partial(camera_picture, look.folder, window, height, look.marked))
    if picture is not None:
        return picture.html("image of the left camera")
    if look.range_map is not None:
        marks = "" if look.marked is None else analysis_marks(look.marked, window.project)
        above = seen_from_above(look.range_map, window, marks)
        if above is not None:
            return above.html("image of the camera")
    return _missing("no picture")


def _relief_before(look: ReadLook, window: Window | None, top: float) -> str:
    """Draw the measured height with the wrinkles and the target."""
    if look.range_map is None or window is None:
        return _missing("no range map was made")
    marks = "" if look.marked is None else analysis_marks(look.marked, window.project)
    return relief(look.range_map, window, top, marks).html("before: measured height")


def _relief_after(look: ReadLook, window: Window | None, top: float) -> str:
    """Draw the measured height without marks."""
    if look.range_map is None or window is None:
        return _missing("no range map was made")
    return relief(look.range_map, window, top).html("after: the next look")


def _wrinkles(look: ReadLook) -> str:
    if look.analysis is None:
        return "<h3>wrinkles</h3><p>No analysis was made.</p>"
    found = look.analysis.get("wrinkles", [])
    if not found:
        return f"{_state(look)}<h3>wrinkles</h3><p>None.</p>"
    mode = look.analysis.get("mode", "foot")
    marked = (look.marked or {}).get("target", {}).get("wrinkle")
    rows = []
    for index, w in enumerate(found[:_LISTED]):
        read = ("paper", "foot") if mode == "between" else (mode,)
        pull = sum(w[f"pull_distance_{name}"] for name in read) / len(read)
        lengths = (w["length"], w["width"], w["peak_height"], pull)
        cells = "".join(f"<td>{1e3 * value:.1f}</td>" for value in lengths)
        pulled = ' class="pulled"' if index == marked and look.acted else ""
        rows.append(
            f"<tr{pulled}><td>{index + 1}</td>{cells}<td>{degrees(w['angle']):.0f}°</td>"
            f"<td>{w['volume_score']:.2f}</td><td>{escape(w.get('kind', ''))}</td></tr>"
        )
    heads = "".join(
        f"<th>{name}</th>"
        for name in ("", "length mm", "width mm", "peak mm", "pull mm", "angle", "score", "what")
    )
    more = len(found) - _LISTED
    rest = f'<p class="small">and {more} smaller</p>' if more > 0 else ""
    halting = (
        f'<p class="small">wrinkles are pulled from {1e3 * look.analysis["halting_pull"]:.0f} mm of pull on; '
        f"largest {1e3 * look.analysis['halting_measure']:.1f} mm</p>"
    )
    return f"{_state(look)}<h3>{len(found)} wrinkles, largest first</h3><table><tr>{heads}</tr>{''.join(rows)}</table>{rest}{halting}"


def _state(look: ReadLook) -> str:
    """Say what state the garment is in, and why."""
    garment = (look.analysis or {}).get("garment")
    if not garment:
        return ""
    reasons = escape("; ".join(garment["reasons"]))
    return f'<h3>garment: {escape(garment["state"])}</h3><p class="small">{reasons}</p>'


def _plan(look: ReadLook) -> str:
    rows: list[tuple[str, str]] = []
    plan, action, verdict = look.plan, look.action, look.verdict
    if plan is not None:
        pulls = [
            f"{name} {1e3 * arm.share * plan.target.hands[arm.side].pull_distance:.1f} mm"
            for name, arm in zip(("right", "left"), plan.arms, strict=True)
            if arm is not None
        ]
        rows.append(("pull", ", ".join(pulls)))
        rows.append(("turn-table", f"{degrees(plan.turntable):.0f}°"))
        rows.append(("motion", f"{plan.motion_time:.2f} s"))
        rows.append(("plan", plan.content_hash[:12]))
    if verdict is not None:
        word = "verified" if verdict.get("passed") else "NOT verified"
        rows.append(("verdict", f"{word}, {len(verdict.get('checks', []))} checks"))
        near = verdict.get("smallest_clearance")
        if near is not None:
            rows.append(("smallest clearance", f"{1e3 * near['distance']:.1f} mm"))
            rows.append(("between", " and ".join(near["bodies"])))
    if action is not None:
        rows += _measured(action)
    return _listed("plan, verdict and execution", rows, "Nothing was planned.")


def _listed(title: str, rows: list[tuple[str, str]], empty: str) -> str:
    if not rows:
        return f"<h3>{title}</h3><p>{empty}</p>"
    listed = "".join(
        f'<tr><td>{escape(name)}</td><td class="text">{escape(text)}</td></tr>'
        for name, text in rows
    )
    return f"<h3>{title}</h3><table>{listed}</table>"


def _measured(action: ActionRecord) -> list[tuple[str, str]]:
    rows: list[tuple[str, str]] = []
    if action.clearance_measured is not None:
        rows.append(("clearance in execution", f"{1e3 * action.clearance_measured:.1f} mm"))
    rows += [("violation", text) for text in action.violations]
    if action.following_error is not None:
        rows.append(("following error", f"{1e3 * action.following_error:.2f} mrad"))
    if action.grip_distance_error is not None:
        rows.append(
            ("error of the grippers’ distance", f"{1e3 * action.grip_distance_error:.1f} mm")
        )
    return rows


def _outcome(look: ReadLook) -> str:
    """List the true values of the simulated cloth, and the wall-clock time."""
    action = look.action
    if action is None or not look.acted:
        return ""
    rows: list[tuple[str, str]] = []
    before, after = action.truth_before, action.truth_after
    for key, name, factor, unit in (
        ("coverage", "coverage", 100.0, "%"),
        ("height", "largest true height", 1e3, "mm"),
    ):
        if before is not None and key in before:
            text = f"{factor * before[key]:.1f} {unit}"
            if after is not None and key in after:
                text = f"{factor * before[key]:.1f} → {factor * after[key]:.1f} {unit}"
            rows.append((name, text))
    if action.seconds:
        rows.append(("wall clock", f"{action.total:.1f} s"))
    return _listed("result", rows, "Not known.")
