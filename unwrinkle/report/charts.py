"""Draw the charts of the report page as SVG.

They show values over the looks, and the stages' times per action.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape

from unwrinkle.runs.records import STAGES

#: Colour of each stage's bar.
STAGE_COLOURS = {
    "render": "#9aa7b5",
    "stereo": "#2f80b9",
    "analysis": "#1aa38c",
    "planning": "#e0a100",
    "verification": "#8e5bb5",
    "motion": "#d1663f",
}
_OTHER = "#5a6675"
# Size and margins of a chart, pixels.
_WIDTH = 460
_HEIGHT = 210
_LEFT = 44
_RIGHT = 84
_TOP = 12
_BOTTOM = 30
# Height of a bar and of the gap between bars, pixels.
_BAR = 20
_GAP = 12


@dataclass(frozen=True)
class Series:
    """Value at each look; None if unknown."""

    name: str
    colour: str
    values: Sequence[float | None]


def line_chart(
    series: Sequence[Series],
    *,
    unit: str,
    least: float = 0.0,
    most: float | None = None,
    limit: tuple[float, str] | None = None,
) -> str:
    """Draw lines over the looks 0, 1, ..., each labelled at its end.

    Args:
        series: lines with equal numbers of values.
        unit: unit of the values.
        least, most: ends of the axis; `most` follows from the values if left out.
        limit: level to mark, and its label.
    """
    count = max(len(line.values) for line in series)
    known = [v for line in series for v in line.values if v is not None]
    top = most if most is not None else max([*known, limit[0] if limit else 0.0, 1e-9]) * 1.12
    plot_w, plot_h = _WIDTH - _LEFT - _RIGHT, _HEIGHT - _TOP - _BOTTOM

    def place(k: float, value: float) -> tuple[float, float]:
        x = _LEFT + plot_w * (k / max(count - 1, 1))
        return x, _TOP + plot_h * (1.0 - (value - least) / (top - least))

    parts = []
    for value in _ticks(least, top):
        _, y = place(0, value)
        parts.append(
            f'<line class="grid" x1="{_LEFT}" x2="{_LEFT + plot_w}" y1="{y:.1f}" y2="{y:.1f}"/>'
            f'<text class="axis" x="{_LEFT - 7}" y="{y + 4:.1f}" text-anchor="end">{value:g}</text>'
        )
    for k in range(count):
        x, _ = place(k, least)
        name = "start" if k == 0 else f"{k}"
        if count <= 12 or k % 5 == 0:
            parts.append(
                f'<text class="axis" x="{x:.1f}" y="{_HEIGHT - 11}" text-anchor="middle">{name}</text>'
            )
    if limit is not None and least <= limit[0] <= top:
        _, y = place(0, limit[0])
        parts.append(
            f'<line x1="{_LEFT}" x2="{_LEFT + plot_w}" y1="{y:.1f}" y2="{y:.1f}" stroke="#1b8a3c" '
            f'stroke-dasharray="5 4"/><text class="axis" x="{_LEFT + plot_w + 8}" y="{y + 4:.1f}" '
            f'fill="#14692d">{escape(limit[1])}</text>'
        )
    ends: list[tuple[float, float, Series]] = []
    for line in series:
        points = [(k, *place(k, v), v) for k, v in enumerate(line.values) if v is not None]
        if not points:
            continue
        way = " ".join(f"{x:.1f},{y:.1f}" for _, x, y, _ in points)
        parts.append(
            f'<polyline points="{way}" fill="none" stroke="{line.colour}" stroke-width="2.5"/>'
        )
        for k, x, y, v in points:
            parts.append(
                f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4.5" fill="{line.colour}" stroke="#fff" '
                f'stroke-width="1.5"><title>{escape(line.name)}, after {k} actions: {v:.1f} {unit}'
                "</title></circle>"
            )
        ends.append((points[-1][2], points[-1][1], line))
    taken = [place(0, limit[0])[1]] if limit is not None else []
    for y, x, line in sorted(ends, key=lambda end: end[0]):
        where = y
        while any(abs(where - other) < 14.0 for other in taken):
            where -= 2.0
        taken.append(where)
        parts.append(
            f'<text class="label" x="{x + 9:.1f}" y="{where + 4:.1f}" fill="{line.colour}">'
            f"{escape(line.name)}</text>"
        )
    return _svg(_WIDTH, _HEIGHT, parts)


def stage_chart(actions: Sequence[tuple[str, Mapping[str, float]]]) -> str:
    """Draw the stages' times as bars, one row per action, with a legend.

    Args:
        actions: name and times (s) of each action.
    """
    stages = [*STAGES, *sorted({s for _, seconds in actions for s in seconds} - set(STAGES))]
    stages = [s for s in stages if any(seconds.get(s, 0.0) > 0.0 for _, seconds in actions)]
    totals = [sum(seconds.values()) for _, seconds in actions]
    most = max([*totals, 1e-9])
    width, left = 940, 84
    scale = (width - left - 70) / most
    parts = []
    for row, ((name, seconds), total) in enumerate(zip(actions, totals, strict=True)):
        y, x = 4 + row * (_BAR + _GAP), float(left)
        parts.append(
            f'<text class="axis" x="{left - 10}" y="{y + 15}" text-anchor="end">{escape(name)}</text>'
        )
        for stage in stages:
            length = scale * seconds.get(stage, 0.0)
            if length <= 0.0:
                continue
            colour = STAGE_COLOURS.get(stage, _OTHER)
            parts.append(
                f'<rect x="{x:.1f}" y="{y}" width="{max(length - 1.5, 0.8):.1f}" height="{_BAR}" rx="2" '
                f'fill="{colour}"><title>{escape(stage)}: {seconds[stage]:.1f} s</title></rect>'
            )
            x += length
        parts.append(f'<text class="axis" x="{x + 7:.1f}" y="{y + 15}">{total:.1f} s</text>')
    legend = "".join(
        f'<span><i style="background:{STAGE_COLOURS.get(s, _OTHER)}"></i>{escape(s)} '
        f"{sum(seconds.get(s, 0.0) for _, seconds in actions):.1f} s</span>"
        for s in stages
    )
    chart = _svg(width, 4 + len(actions) * (_BAR + _GAP), parts)
    return f'{chart}<p class="legend">{legend}</p>'


def _svg(width: int, height: int, parts: list[str]) -> str:
    return f'<svg class="chart" viewBox="0 0 {width} {height}">{"".join(parts)}</svg>'


def _ticks(least: float, most: float) -> list[float]:
    """Return about four round values from least to most."""
    span = most - least
    step = 10.0 ** len(str(int(span))) / 100.0 if span >= 1.0 else 0.1
    for factor in (1, 2, 5, 10, 20, 50, 100):
        if span / (step * factor) <= 4.5:
            step *= factor
            break
    first = -(-least // step)
    return [step * (first + k) for k in range(int((most - first * step) // step) + 1)]
