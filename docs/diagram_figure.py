"""Draw the flattening diagram from its connections.

Run: python docs/diagram_figure.py docs/diagram.svg
"""

import sys
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from unwrinkle.models.io.files import atomic_path
from unwrinkle.systems.diagram import (
    ANALYSIS,
    IMAGE_WIRES,
    PERCEPTION,
    PLANNER,
    STATION,
    SUPERVISOR,
    VERIFICATION,
    WIRES,
    Link,
)


@dataclass(frozen=True)
class _Box:
    """Place and look of one system in the figure; lengths in units of the figure."""

    left: float
    bottom: float
    width: float
    height: float
    colour: str
    note: str

    @property
    def right(self) -> float:
        return self.left + self.width

    @property
    def top(self) -> float:
        return self.bottom + self.height


_LAZY = "evaluated on demand, once per input"
_BOXES = {
    PERCEPTION: _Box(0.0, 6.0, 2.2, 1.1, "#cfe3f7", "stereo, or depth camera"),
    ANALYSIS: _Box(3.6, 6.0, 2.2, 1.1, "#cfe3f7", "wrinkles, largest first"),
    PLANNER: _Box(7.2, 6.0, 2.2, 1.1, "#d8efd3", "seven poses, 13 axes"),
    VERIFICATION: _Box(10.8, 6.0, 2.2, 1.1, "#d8efd3", "independent"),
    SUPERVISOR: _Box(
        1.2, 3.1, 11.8, 1.1, "#fbe3c0", "look, perceive, decide, plan, confirm, move, grip"
    ),
    STATION: _Box(0.0, -0.4, 13.0, 1.1, "#e4e0ee", "sim, loopback or hardware: the same ports"),
}
#: Margin at each end of a box that no arrow touches, units of the figure.
_EDGE = 0.35


def draw_diagram(links: Sequence[Link], path: str | Path) -> None:
    """Draw systems and connections to a file.

    Args:
        links: connections of the diagram that `build_flattening_diagram` builds; see
            `diagram.links`.
        path: file to write; text in an SVG stays text.

    Raises:
        InputError: the file cannot be written.
    """
    import matplotlib
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13.0, 8.0))
    axes = figure.add_axes((0.01, 0.01, 0.98, 0.98))
    axes.set_xlim(-0.3, 13.3)
    axes.set_ylim(-0.6, 7.6)
    axes.set_aspect("equal")
    axes.axis("off")
    for name, box in _BOXES.items():
        _draw_box(axes, name, box)
    axes.text(6.5, 7.4, _LAZY, ha="center", style="italic", color="#555555", fontsize=10)
    between: dict[frozenset[str], list[Link]] = defaultdict(list)
    for link in links:
        between[frozenset((link.source, link.target))].append(link)
    for pair, group in between.items():
        _draw_links(axes, pair, group)
    style = matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": "unwrinkle"})
    with atomic_path(path) as temporary, style:
        # Without a date the file is reproducible.
        kept = {"Date": None} if temporary.suffix == ".svg" else {}
        figure.savefig(temporary, dpi=110, metadata=kept)


def _draw_box(axes: Any, name: str, box: _Box) -> None:
    from matplotlib.patches import FancyBboxPatch

    axes.add_patch(
        FancyBboxPatch(
            (box.left, box.bottom),
            box.width,
            box.height,
            boxstyle="round,pad=0,rounding_size=0.12",
            facecolor=box.colour,
            edgecolor="#444444",
        )
    )
    x = box.left + 0.5 * box.width
    axes.text(x, box.bottom + 0.62, name, ha="center", fontsize=13, weight="bold")
    axes.text(x, box.bottom + 0.25, box.note, ha="center", fontsize=8.5, color="#333333")


def _draw_links(axes: Any, pair: frozenset[str], group: list[Link]) -> None:
    """Draw the connections of two systems side by side, spread over the edge that both share."""
    first, second = (_BOXES[name] for name in sorted(pair, key=lambda name: _BOXES[name].bottom))
    if first.bottom == second.bottom:
        for link in group:
            source, target = _BOXES[link.source], _BOXES[link.target]
            y = source.bottom + 0.5 * source.height
            _arrow(axes, (source.right, y), (target.left, y))
            x = 0.5 * (source.right + target.left)
            axes.text(x, y + 0.12, link.output, ha="center", fontsize=9)
        return
    left = max(first.left, second.left)
    right = min(first.right, second.right)
    if SUPERVISOR not in pair and STATION in pair:  # past the supervisor, on its left
        right = _BOXES[SUPERVISOR].left
        left = first.left
    room = right - left - 2.0 * _EDGE if right - left > 2.0 * _EDGE + 0.4 else right - left
    begin = 0.5 * (left + right - room)
    for index, link in enumerate(group):
        x = begin + room * (index + 0.5) / len(group)
        source, target = _BOXES[link.source], _BOXES[link.target]
        if source.bottom > target.bottom:
            ends = (x, source.bottom), (x, target.top)
        else:
            ends = (x, source.top), (x, target.bottom)
        _arrow(axes, *ends)
        y = 0.5 * (first.top + second.bottom)
        axes.text(x - 0.06, y, link.output, rotation=90, ha="right", va="center", fontsize=8.5)


def _arrow(axes: Any, begin: tuple[float, float], end: tuple[float, float]) -> None:
    arrow = {"arrowstyle": "-|>", "color": "#444444", "lw": 1.1, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", xy=end, xytext=begin, arrowprops=arrow)


if __name__ == "__main__":
    draw_diagram([Link(*wire) for wire in (*WIRES, *IMAGE_WIRES["stereo"])], sys.argv[1])
