"""Draw the pictures of an analysis.

All pictures have the robot's view of its table, with the robot at the lower edge: the world's y
axis points down and its x axis to the left. Seen from above, nothing is mirrored.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from unwrinkle.flattening.flattener import Choice, NoChoice
from unwrinkle.models.io.files import atomic_path
from unwrinkle.perception.folds.garment_state import FoldAnalysis
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.wrinkles.analysis import Analysis
from unwrinkle.perception.wrinkles.surface import CLASS_NAMES
from unwrinkle.perception.wrinkles.wrinkledness import Wrinkledness

#: Koenderink's scale: green cup over cyan and blue rut, white saddle, yellow ridge, to red cap.
CLASS_COLOURS = (
    "#9a9a9a",
    "#00b400",
    "#00d7a0",
    "#00c8ff",
    "#8cb4ff",
    "#ffffff",
    "#fff0a0",
    "#ffd200",
    "#ff8c00",
    "#e60000",
)
_HANDS = ("#d81b60", "#1e88e5")
#: Number of wrinkles that are labelled.
_SHOWN = 6

Painter = Callable[[Axes, Figure], None]


def save_pictures(
    folder: str | Path,
    analysis: Analysis,
    chosen: Choice | NoChoice,
    *,
    folds: FoldAnalysis | None = None,
    title: str = "",
    singles: bool = True,
) -> list[Path]:
    """Write `panel.png` and, with `singles`, one file per picture into the folder.

    Args:
        folder: that exists.
        analysis: of the garment's wrinkles.
        chosen: what is to be pulled, or why nothing is.
        folds: borders and flaps to draw on the heights.
        title: of the panel.
        singles: write each picture as a file of its own, too.

    Returns:
        The paths of the pictures.
    """
    folder, painters = Path(folder), _painters(analysis, chosen, folds)
    range_map = analysis.range_map
    written: list[Path] = []
    for name, (caption, painter) in painters.items() if singles else ():
        figure, ((axes,),) = _figure(1, 1, range_map)
        painter(axes, figure)
        axes.set_title(caption, fontsize=10, y=1.01)
        written.append(_write(figure, folder / f"{name}.png", 130))
    figure, grid = _figure(2, 3, range_map)
    for axes, (caption, painter) in zip(grid.ravel(), painters.values(), strict=False):
        painter(axes, figure)
        axes.set_title(caption, fontsize=10, y=1.01)
    for axes in grid.ravel()[len(painters) :]:
        axes.set_axis_off()
    figure.suptitle(title or "unwrinkle analyse")
    written.append(_write(figure, folder / "panel.png", 100))
    return written


def _figure(rows: int, columns: int, range_map: RangeMap) -> tuple[Figure, NDArray[Any]]:
    """Return a figure and its axes (rows, columns), sized to the map; margins in inches are fixed.

    An automatic layout would draw everything once more to measure it.
    """
    x_min, x_max, y_min, y_max = range_map.extent
    width = 4.6
    height = width * min(max((y_max - y_min) / (x_max - x_min), 0.4), 2.0)
    left, right, between = 0.65, 1.6, 1.5  # right of the axes stand colour bars and legends
    bottom, top, above = 0.55, 0.75, 0.95
    size = (
        left + columns * width + (columns - 1) * between + right,
        bottom + rows * height + (rows - 1) * above + top,
    )
    figure = Figure(figsize=size)
    grid = figure.subplots(rows, columns, squeeze=False)
    figure.subplots_adjust(
        left=left / size[0],
        right=1.0 - right / size[0],
        bottom=bottom / size[1],
        top=1.0 - top / size[1],
        wspace=between / width,
        hspace=above / height,
    )
    return figure, grid


def _write(figure: Figure, path: Path, dpi: int) -> Path:
    figure.set_dpi(dpi)
    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()  # once; `savefig` draws twice
    image = cv2.cvtColor(np.asarray(canvas.buffer_rgba()), cv2.COLOR_RGBA2BGR)
    _, png = cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 3])
    with atomic_path(path) as temporary:
        temporary.write_bytes(png.tobytes())
    return path


def _painters(
    analysis: Analysis, chosen: Choice | NoChoice, folds: FoldAnalysis | None
) -> dict[str, tuple[str, Painter]]:
    range_map = analysis.range_map
    count = len(analysis.wrinkles)
    painters: dict[str, tuple[str, Painter]] = {}
    if range_map.colour is not None:
        painters["colour"] = ("colour and garment", lambda a, f: _colour(a, range_map))
    painters["height"] = (
        "height above the table" if folds is None else f"height; garment {folds.state}",
        lambda a, f: _height(a, f, range_map, folds),
    )
    painters["classes"] = ("shape index", lambda a, f: _classes(a, analysis))
    painters["ridges"] = (
        f"ridges, contours, triplets: {count} wrinkle{'' if count == 1 else 's'}",
        lambda a, f: _ridges(a, analysis),
    )
    painters["wrinkledness"] = (
        "wrinkledness and its grasp point",
        lambda a, f: _wrinkledness(a, f, range_map, analysis.wrinkledness),
    )
    painters["target"] = (_target_caption(chosen), lambda a, f: _target(a, analysis, chosen))
    return painters


def _target_caption(chosen: Choice | NoChoice) -> str:
    if isinstance(chosen, Choice):
        first, second = (1e3 * hand.pull_distance for hand in chosen.target.hands)
        return f"flattening: pull {first:.0f} mm and {second:.0f} mm"
    return "no target is needed" if chosen.stop.flat else "no target"


def _extent(range_map: RangeMap) -> tuple[float, float, float, float]:
    x_min, x_max, y_min, y_max = range_map.extent
    return (x_min, x_max, y_max, y_min)


def _frame(axes: Axes, range_map: RangeMap) -> None:
    x_min, x_max, y_min, y_max = range_map.extent
    axes.set_xlim(x_max, x_min)
    axes.set_ylim(y_max, y_min)
    axes.set_aspect("equal")
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
    axes.tick_params(labelsize=8)
    axes.locator_params(nbins=5)  # each tick takes over a millisecond to draw
    width = x_max - x_min
    bar = max(size for size in (0.01, 0.02, 0.05, 0.1, 0.2) if size < 0.3 * width or size == 0.01)
    left, low = x_max - 0.04 * width, y_max - 0.04 * (y_max - y_min)
    for thickness, colour in ((5.0, "black"), (2.5, "white")):
        axes.plot([left, left - bar], [low, low], color=colour, lw=thickness, solid_capstyle="butt")
    axes.text(
        left - 0.5 * bar,
        low - 0.015 * (y_max - y_min),
        f"{bar * 100:.0f} cm",
        ha="center",
        va="bottom",
        fontsize=8,
        bbox={"facecolor": "white", "alpha": 0.7, "pad": 1.0, "lw": 0.0},
    )


def _outline(axes: Axes, range_map: RangeMap, colour: str = "black") -> None:
    ny, nx = range_map.shape
    x = range_map.origin[0] + range_map.resolution * np.arange(nx)
    y = range_map.origin[1] + range_map.resolution * np.arange(ny)
    axes.contour(x, y, range_map.garment.astype(float), levels=[0.5], colors=colour, linewidths=0.8)


def _colour(axes: Axes, range_map: RangeMap) -> None:
    assert range_map.colour is not None
    axes.imshow(range_map.colour, extent=_extent(range_map))
    _outline(axes, range_map, "lime")
    _frame(axes, range_map)


def _bar(axes: Axes, figure: Figure, image: Any, label: str) -> None:
    place = axes.inset_axes((1.03, 0.1, 0.04, 0.8))
    figure.colorbar(image, cax=place, label=label).ax.tick_params(labelsize=8)


def _height(axes: Axes, figure: Figure, range_map: RangeMap, folds: FoldAnalysis | None) -> None:
    shown = np.ma.masked_where(~range_map.valid, 1e3 * range_map.height)
    on = range_map.garment & range_map.valid
    top = float(np.percentile(1e3 * range_map.height[on], 99.7)) if on.any() else 10.0
    image = axes.imshow(
        shown, extent=_extent(range_map), cmap="turbo", vmin=min(-0.1 * top, 0.0), vmax=top
    )
    axes.set_facecolor("0.2")
    _bar(axes, figure, image, "mm")
    _outline(axes, range_map)
    _frame(axes, range_map)
    if folds is not None:
        _folds(axes, range_map, folds)


def _folds(axes: Axes, range_map: RangeMap, folds: FoldAnalysis) -> None:
    """Draw borders of layers, and flaps with their fold lines and the directions they open in."""
    x_min, x_max, y_min, y_max = range_map.extent
    reach = 0.1 * max(x_max - x_min, y_max - y_min)
    for line in folds.borders:
        axes.plot(line[:, 0], line[:, 1], color="#d500f9", lw=1.6)
    for flap in folds.flaps:
        axes.plot(*flap.line.T, color="white", lw=3.5)
        axes.plot(*flap.line.T, color="black", lw=1.8)
        middle = flap.line.mean(axis=0)
        _arrow(axes, middle - 0.3 * reach * flap.opening, middle + reach * flap.opening, "black")
        axes.plot(*flap.hold, "o", color="white", mec="black", ms=7)


def _classes(axes: Axes, analysis: Analysis) -> None:
    range_map = analysis.range_map
    shown = np.ma.masked_where(~range_map.garment, analysis.classes)
    colours = ListedColormap(CLASS_COLOURS)
    norm = BoundaryNorm(np.arange(-0.5, 10.0), colours.N)
    axes.imshow(shown, extent=_extent(range_map), cmap=colours, norm=norm, interpolation="nearest")
    axes.set_facecolor("0.2")
    patches = [
        Patch(facecolor=colour, edgecolor="0.3", label=name)
        for name, colour in zip(CLASS_NAMES, CLASS_COLOURS, strict=True)
    ]
    axes.legend(handles=patches, fontsize=7, loc="center left", bbox_to_anchor=(1.01, 0.5))
    _frame(axes, range_map)


def _grey(axes: Axes, range_map: RangeMap) -> None:
    """Draw the relief as a grey background for lines: the height lit from the upper left."""
    slope_y = np.gradient(range_map.height, range_map.resolution, axis=0)
    slope_x = np.gradient(range_map.height, range_map.resolution, axis=1)
    on = range_map.garment
    spread = max(0.15, 2.0 * float(np.std(slope_x[on]))) if on.any() else 0.15
    light = np.asarray(np.clip(0.62 + 0.25 * (slope_y - slope_x) / spread, 0.15, 1.0))
    light[~range_map.garment] = 0.9
    axes.imshow(light, extent=_extent(range_map), cmap="gray", vmin=0.0, vmax=1.0)


def _ridges(axes: Axes, analysis: Analysis) -> None:
    range_map = analysis.range_map
    _grey(axes, range_map)
    for index, wrinkle in enumerate(analysis.wrinkles):
        first = index == 0
        left, right = wrinkle.contours
        across = np.stack([left[:, :2], right[:, :2]], axis=1)
        axes.add_collection(LineCollection(list(across), colors="#7cb342", lw=0.35, alpha=0.7))
        for contour in (left, right):
            axes.plot(contour[:, 0], contour[:, 1], ".", color="#1e88e5", ms=1.5)
        axes.plot(
            wrinkle.curve[:, 0],
            wrinkle.curve[:, 1],
            color="#e53935" if first else "#fb8c00",
            lw=2.2 if first else 1.2,
        )
        if index < _SHOWN:
            axes.text(
                float(wrinkle.centre[0]),
                float(wrinkle.centre[1]),
                str(index + 1),
                fontsize=8,
                ha="center",
                va="center",
                bbox={"boxstyle": "circle", "facecolor": "white", "alpha": 0.85, "pad": 0.15},
            )
    _outline(axes, range_map)
    _frame(axes, range_map)


def _wrinkledness(
    axes: Axes, figure: Figure, range_map: RangeMap, wrinkledness: Wrinkledness
) -> None:
    ny, nx = wrinkledness.entropy.shape
    half, (x, y) = 0.5 * wrinkledness.resolution, wrinkledness.origin
    right, low = x + (nx - 0.5) * wrinkledness.resolution, y + (ny - 0.5) * wrinkledness.resolution
    shown = np.ma.masked_equal(wrinkledness.entropy, 0.0)
    image = axes.imshow(shown, extent=(x - half, right, low, y - half), cmap="inferno", vmin=0.0)
    axes.set_facecolor("0.75")
    _bar(axes, figure, image, "entropy (nat)")
    if wrinkledness.point is not None:
        axes.plot(*wrinkledness.point, "+", color="cyan", ms=16, mew=2.5)
        axes.plot(*wrinkledness.point, "o", color="cyan", ms=12, mfc="none", mew=1.5)
    _outline(axes, range_map)
    _frame(axes, range_map)


def _target(axes: Axes, analysis: Analysis, chosen: Choice | NoChoice) -> None:
    range_map = analysis.range_map
    if range_map.colour is not None:
        axes.imshow(range_map.colour, extent=_extent(range_map))
    else:
        _grey(axes, range_map)
    _outline(axes, range_map, "white" if range_map.colour is not None else "black")
    if isinstance(chosen, NoChoice):
        axes.text(
            0.5,
            0.5,
            _wrapped(chosen.stop.reason),
            transform=axes.transAxes,
            ha="center",
            va="center",
            fontsize=9,
            bbox={"facecolor": "white", "alpha": 0.85},
        )
        _frame(axes, range_map)
        return
    target = chosen.target
    curve = analysis.wrinkles[chosen.decision.wrinkle.index].curve
    axes.plot(curve[:, 0], curve[:, 1], color="#ffeb3b", lw=2.5)
    x_min, x_max, y_min, y_max = range_map.extent
    reach = 0.12 * max(x_max - x_min, y_max - y_min)
    for hand, colour in zip(target.hands, _HANDS, strict=True):
        grasp = hand.p_WG[:2]
        _arrow(axes, grasp - reach * hand.grasp_direction, grasp, colour, dashed=True)
        # The pull is only a few millimetres: it is drawn with a minimum length, and the caption
        # gives the value.
        length = max(hand.pull_distance, 0.6 * reach)
        _arrow(axes, grasp, grasp + length * hand.pull_direction, colour, dashed=False)
        axes.plot(*grasp, "o", color=colour, mec="white", ms=8)
    handles = [
        Patch(facecolor=colour, label=f"hand {i}: {1e3 * hand.pull_distance:.1f} mm")
        for i, (hand, colour) in enumerate(zip(target.hands, _HANDS, strict=True))
    ]
    axes.legend(
        handles=handles,
        fontsize=8,
        loc="center left",
        bbox_to_anchor=(1.01, 0.5),
        title="dashed: approach\nsolid: pull",
        title_fontsize=8,
    )
    margin = 1.3 * reach
    points = np.array([hand.p_WG[:2] for hand in target.hands])
    _frame(axes, range_map)
    low, high = points.min(axis=0) - margin, points.max(axis=0) + margin
    axes.set_xlim(max(x_max, high[0]), min(x_min, low[0]))
    axes.set_ylim(max(y_max, high[1]), min(y_min, low[1]))


def _arrow(axes: Axes, start: Any, end: Any, colour: str, *, dashed: bool = False) -> None:
    axes.annotate(
        "",
        xy=tuple(end),
        xytext=tuple(start),
        arrowprops={
            "arrowstyle": "->" if dashed else "-|>",
            "color": colour,
            "lw": 2.0 if dashed else 3.0,
            "ls": "--" if dashed else "-",
            "shrinkA": 0.0,
            "shrinkB": 0.0,
        },
    )


def _wrapped(text: str, width: int = 60) -> str:
    lines, line = [], ""
    for word in text.split():
        if len(line) + len(word) > width:
            lines.append(line)
            line = ""
        line = f"{line} {word}".strip()
    return "\n".join([*lines, line])
