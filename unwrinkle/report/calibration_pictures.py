"""Draw the residuals of a calibration: how well each view fits, and where it does not."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from unwrinkle.models.io.files import atomic_path
from unwrinkle.perception.camera import Camera

_COLOURS = ("#1f6fb2", "#c8553d")
#: Maximum number of labelled views.
_MOST_NAMES = 45
#: Length of the arrow of a large residual, share of the image's width.
_ARROW = 0.06

Pixels = NDArray[np.floating[Any]]


def save_residuals(
    path: Path,
    cameras: Sequence[Camera],
    names: Sequence[str],
    eyes: Sequence[int],
    corners: Sequence[Pixels],
    residuals: Sequence[Pixels],
    *,
    title: str = "",
) -> None:
    """Write a PNG: the RMS of each view at the top, the residuals as arrows over each image below.

    Args:
        path: file to write.
        cameras: one or two cameras; their images are drawn side by side.
        names: names of the views; the two views of a pair or look have the same name.
        eyes: index of the camera of each view.
        corners, residuals: (n, 2) pixels of each view; a residual is measured minus predicted.
        title: title of the figure.

    Raises:
        InputError: the file cannot be written.
    """
    figure = Figure(figsize=(6.0 * max(2, len(cameras)), 9.0), layout="constrained")
    figure.suptitle(title)
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(2, len(cameras), height_ratios=(1.0, 1.5))
    _bars(figure.add_subplot(grid[0, :]), cameras, names, eyes, residuals)
    lengths = np.concatenate([np.linalg.norm(residual, axis=1) for residual in residuals])
    large = max(float(np.percentile(lengths, 95.0)), 1e-6)
    for eye, camera in enumerate(cameras):
        mine = [k for k, other in enumerate(eyes) if other == eye]
        _arrows(
            figure.add_subplot(grid[1, eye]),
            camera,
            np.concatenate([corners[k] for k in mine]),
            np.concatenate([residuals[k] for k in mine]),
            large,
        )
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=100)


def _bars(
    axes: Axes,
    cameras: Sequence[Camera],
    names: Sequence[str],
    eyes: Sequence[int],
    residuals: Sequence[Pixels],
) -> None:
    places = {name: place for place, name in enumerate(dict.fromkeys(names))}
    rms = np.array([np.sqrt(np.mean(np.sum(r**2, axis=1))) for r in residuals])
    width = 0.8 / len(cameras)
    for eye, camera in enumerate(cameras):
        mine = [k for k, other in enumerate(eyes) if other == eye]
        x = np.array([places[names[k]] for k in mine]) + (eye - 0.5 * (len(cameras) - 1)) * width
        axes.bar(x, rms[mine], width, color=_COLOURS[eye], label=f"{camera.name}, by view")
    middle = float(np.median(rms))
    axes.axhline(middle, color="0.3", linewidth=1.0, label=f"median {middle:.3f} px")
    step = int(np.ceil(len(places) / _MOST_NAMES))
    shown = list(places)[::step]
    axes.set_xticks([places[name] for name in shown], shown, rotation=90, fontsize=8)
    axes.set_xlim(-0.6, len(places) - 0.4)
    axes.set_ylim(0.0, 1.25 * float(rms.max()))
    axes.set_ylabel("RMS reprojection error (px)")
    axes.legend(loc="upper right", ncols=3, fontsize=8)


def _arrows(axes: Axes, camera: Camera, corners: Pixels, residuals: Pixels, large: float) -> None:
    scale = _ARROW * camera.width / large
    # Image rows increase downwards, and so do the arrows' second components.
    axes.quiver(
        corners[:, 0],
        corners[:, 1],
        residuals[:, 0],
        residuals[:, 1],
        np.linalg.norm(residuals, axis=1),
        angles="xy",
        scale_units="xy",
        scale=1.0 / scale,
        cmap="viridis_r",
        clim=(0.0, large),
        width=0.0018,
    )
    x = 0.03 * camera.width
    y = 0.06 * camera.height
    axes.plot([x, x + large * scale], [y, y], color="black", linewidth=2.0)
    axes.text(x, 1.3 * y, f"{large:.2g} px", va="top", fontsize=9)
    axes.plot(camera.cx, camera.cy, "+", color="black", markersize=10)
    rms = float(np.sqrt(np.mean(np.sum(residuals**2, axis=1))))
    axes.set_title(f"{camera.name}: {len(corners)} corners, RMS {rms:.3f} px; + principal point")
    axes.set_xlim(-0.5, camera.width - 0.5)
    axes.set_ylim(camera.height - 0.5, -0.5)
    axes.set_aspect("equal")
    axes.set_xlabel("u (px)")
    axes.set_ylabel("v (px)")
