"""What the benchmarks' figures share.

Bars with intervals beside the published figure, and cloth before and after.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from unwrinkle.models.io.archive import load_archive

OURS, PUBLISHED = "#2a6f97", "#9aa5ab"
#: Heights of cloth are drawn from 0 to this, mm.
_HIGH = 30.0


def bars(
    axes: Axes,
    names: Sequence[str],
    means: Sequence[float],
    intervals: Sequence[tuple[float, float]],
    published: Sequence[tuple[float, float] | None] | None = None,
    *,
    label: str,
) -> None:
    """Draw a bar per name with its interval, and beside it the published mean with its standard
    deviation.

    Args:
        axes: to draw on.
        names: of the bars.
        means: of our figures.
        intervals: lower and upper ends.
        published: mean and standard deviation (0 where none was published); None where nothing was.
        label: of the axis, with the unit.
    """
    places = np.arange(len(names), dtype=float)
    width = 0.38 if published else 0.6
    low, high = np.array(intervals, dtype=float).T
    middle = np.asarray(means, dtype=float)
    error = np.maximum(np.stack([middle - low, high - middle]), 0.0)
    shift = 0.5 * width if published else 0.0
    axes.bar(places - shift, middle, width, color=OURS, label="here (95 % interval of the mean)")
    axes.errorbar(places - shift, middle, error, fmt="none", ecolor="black", capsize=4)
    known = [(k, *value) for k, value in enumerate(published or ()) if value is not None]
    if known:
        at, mean, std = np.array(known).T
        axes.bar(at + shift, mean, width, color=PUBLISHED, label="published (standard deviation)")
        spread = std > 0.0
        axes.errorbar(
            (at + shift)[spread], mean[spread], std[spread], fmt="none", ecolor="black", capsize=4
        )
    axes.set_xticks(places, names)
    axes.set_ylabel(label)
    axes.legend(frameon=False)
    axes.spines[["top", "right"]].set_visible(False)


def draw_cloth(axes: Axes, path: Path, number: int) -> None:
    """Draw how a run's cloth lay, seen from above, lighter where it is higher.

    Args:
        axes: to draw on.
        path: `vertices.npz` of a row.
        number: of actions before; negative counts from the end.
    """
    header, arrays = load_archive(path)
    count = sum(name.startswith("v") for name in arrays)
    vertices = arrays[f"v{number % count}"]
    faces = vertices[arrays["triangles"]]
    height = 1e3 * (faces[:, :, 2].mean(axis=1) - float(header["flat_height"]))
    upwards = np.argsort(height)
    shown = PolyCollection(
        list(faces[upwards, :, :2]), array=height[upwards], cmap="cividis", edgecolor="face"
    )
    shown.set_clim(0.0, _HIGH)
    shown.set_linewidth(0.2)
    shown.set_rasterized(True)
    axes.add_collection(shown)
    axes.set_xlim(-0.36, 0.36)
    axes.set_ylim(-1.46, -0.78)
    axes.set_aspect("equal")
    axes.set_xticks([])
    axes.set_yticks([])


def save(figure: Figure, path: Path) -> None:
    """Write a figure."""
    figure.savefig(path, dpi=110)
