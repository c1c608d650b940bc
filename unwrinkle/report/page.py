"""Build the report of a run: one self-contained page from whatever its folder holds."""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from markupsafe import Markup

from unwrinkle.models.io.files import write_text
from unwrinkle.report.charts import Series, line_chart, stage_chart
from unwrinkle.report.look_card import STATUS, ReadLook, look_card, look_name
from unwrinkle.report.pictures import (
    RAMP,
    Window,
    top_height,
)
from unwrinkle.runs.folder import RUNNING, RunFolder
from unwrinkle.runs.look_folder import readable
from unwrinkle.viewer.pages import filled_page

PAGE = "report.html"
#: Maximum number of listed events.
_EVENTS = 400
#: What was real and what simulated, by the station's form.
_REAL = {
    "sim": (
        "The cloth, the robot, its cameras and their noise are simulated; perception, planning, "
        "verification and the decisions are the same as in a real cell. Coverage and true height "
        "are the simulated cloth's own values, which the loop does not use."
    ),
    "loopback": (
        "The cloth, the robot's bodies, its cameras and their noise are simulated; between them "
        "and the loop are the real drivers, connected to a virtual controller over TCP and to "
        "virtual pan-tilt units over serial lines. Coverage and true height are the simulated "
        "cloth's own values, which the loop does not use."
    ),
    "hardware": (
        "This run used a site's devices. The garment's true height and coverage are unknown; "
        "heights are measured by the sensor. The commands and the feedback of the controller are "
        "in the run's controller-*.jsonl."
    ),
}


def write_report(run: RunFolder) -> Path:
    """Write `report.html` into the run's folder; return its path.

    Raises:
        InputError: the file cannot be written.
    """
    path = run.path / PAGE
    write_text(path, report_page(run))
    return path


def report_page(run: RunFolder) -> str:
    """Return the page as text; missing records are left out or reported as missing."""
    looks = [ReadLook.of(folder) for folder in run.looks()]
    maps = [look.range_map for look in looks if look.range_map is not None]
    window = readable(partial(Window.around, maps))
    top = top_height(maps)
    after = [*looks[1:], None]
    rows, columns = (3, 4) if window is None else window.shape
    kind, word = STATUS[run.status]
    reason = run.reason
    if run.status == RUNNING:
        reason = (
            "The run is still going on, or was killed; this is the present content of its folder."
        )
    return filled_page(
        "unwrinkle.report",
        "page.html",
        name=run.path.resolve().name,
        kind=kind,
        word=word,
        reason=reason,
        settings=run.settings,
        what=_what(run),
        real=_REAL.get(run.settings.station, ""),
        tiles=_tiles(run, looks),
        looks=looks,
        charts=_charts(looks),
        stages=_stages(looks),
        cards=[
            Markup(look_card(look, following, window, top))
            for look, following in zip(looks, after, strict=False)
        ],
        facts=_run_facts(run),
        events=run.events(),
        most_events=_EVENTS,
        ramp=RAMP,
        rows=rows,
        columns=columns,
    )


def _tiles(run: RunFolder, looks: Sequence[ReadLook]) -> list[tuple[str, str]]:
    """Return the figures at the head of the page, each with its name."""
    coverage = [_truth(look, "coverage") for look in looks]
    heights = [_truth(look, "height") for look in looks]
    return [
        (
            f"{sum(look.acted for look in looks)}",
            f"actions, of {run.settings.actions} at most",
        ),
        _change(coverage, looks, "coverage", 100.0, " %", "coverage"),
        _change(heights, looks, "height", 1e3, " mm", "largest true height"),
        (_duration(_seconds(run, looks)), "total time"),
        (f"{run.settings.seed}", "seed"),
    ]


def _what(run: RunFolder) -> str:
    settings = run.settings
    real = settings.station == "hardware"
    garment = f"{settings.garment} ({settings.texture}), initially {settings.start}; "
    return (
        f"{'' if real else garment}sensor {settings.sensor} at scale {settings.scale:g}; arms "
        f"{settings.arms}; pull mode {settings.mode}"
    )


def _change(
    before: Sequence[float | None],
    looks: Sequence[ReadLook],
    key: str,
    factor: float,
    unit: str,
    name: str,
) -> tuple[str, str]:
    values = [v for v in _over_looks(before, looks, key) if v is not None]
    if not values:
        return "–", f"{name} (not known)"
    return f"{factor * values[0]:.1f} → {factor * values[-1]:.1f}{unit}", name


def _truth(look: ReadLook, key: str) -> float | None:
    truth = None if look.action is None else look.action.truth_before
    return None if truth is None else truth.get(key)


def _over_looks(
    before: Sequence[float | None], looks: Sequence[ReadLook], key: str
) -> list[float | None]:
    """Return a true value at each look, and after the last action if no look followed it."""
    values = list(before)
    for k, look in enumerate(looks):
        truth = None if look.action is None else look.action.truth_after
        if truth is None or not look.acted:
            continue
        if k + 1 == len(values):
            values.append(truth.get(key))
        elif values[k + 1] is None:
            values[k + 1] = truth.get(key)
    return values


def _seconds(run: RunFolder, looks: Sequence[ReadLook]) -> float:
    known = run.figures.get("seconds")
    if isinstance(known, int | float):
        return float(known)
    return sum(look.action.total for look in looks if look.action is not None)


def _duration(seconds: float) -> str:
    whole = round(seconds)
    return f"{whole // 60} min {whole % 60} s" if whole >= 60 else f"{seconds:.0f} s"


def _charts(looks: Sequence[ReadLook]) -> list[tuple[str, Markup]]:
    """Return the charts over the looks, each with its title; none without a look."""
    if not looks:
        return []
    heights = _over_looks([_truth(look, "height") for look in looks], looks, "height")
    coverage = _over_looks([_truth(look, "coverage") for look in looks], looks, "coverage")
    seen: list[float | None] = [
        None
        if look.analysis is None
        else 1e3 * max((w["peak_height"] for w in look.analysis.get("wrinkles", [])), default=0.0)
        for look in looks
    ]
    series = [Series("as seen", "#d1663f", seen)]
    if any(value is not None for value in heights):
        series.append(Series("true", "#2f80b9", [_times(1e3, v) for v in heights]))
    chart = line_chart(series, unit="mm", limit=(5.0, "5 mm"))
    charts = [("largest height, mm, after each action", Markup(chart))]
    shares = [v for v in coverage if v is not None]
    if shares:
        least = min(80.0, 10.0 * int(10.0 * min(shares)))
        chart = line_chart(
            [Series("covered", "#1aa38c", [_times(100.0, v) for v in coverage])],
            unit="%",
            least=least,
            most=101.5,
            limit=(98.0, "98 %"),
        )
        charts.append(("coverage of the flat area, %, after each action", Markup(chart)))
    return charts


def _stages(looks: Sequence[ReadLook]) -> Markup:
    """Return the chart of the stages' times; empty where none are known."""
    times = [
        (look_name(look), look.action.seconds)
        for look in looks
        if look.action is not None and look.action.seconds
    ]
    return Markup(stage_chart(times) if times else "")


def _times(factor: float, value: float | None) -> float | None:
    return None if value is None else factor * value


def _run_facts(run: RunFolder) -> list[tuple[str, Any]]:
    """Return the run's times, versions, machine and figures, each with its name."""
    record = run.record
    facts: list[tuple[str, Any]] = [
        ("begun", record.get("created")),
        ("ended", record.get("finished")),
    ]
    facts += list(_flat(record.get("versions"))) + list(_flat(record.get("machine")))
    return facts + list(_flat(run.figures))


def _flat(values: Any) -> list[tuple[str, Any]]:
    return list(values.items()) if isinstance(values, Mapping) else []
