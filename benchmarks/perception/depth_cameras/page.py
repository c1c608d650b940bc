"""The page and the figure of `bench depth_cameras`."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.harness.tables import line, rule
from benchmarks.perception.depth_cameras.noise import LAGS
from benchmarks.perception.depth_cameras.results import (
    DepthCamerasResult,
    MapFigures,
    MedianNoise,
    NoiseLaws,
    View,
)
from benchmarks.perception.depth_cameras.scenes import restored

_TITLES = {"xtion": "structured light (Xtion)", "tof": "time of flight"}
_COLOURS = {"xtion": "tab:blue", "tof": "tab:orange"}


def page(results: DepthCamerasResult) -> str:
    """Return the results as Markdown."""
    return "\n\n".join(
        [
            "![Both cameras](depth_cameras.png)",
            _noise(results),
            _laws(results.laws),
            _edges(results),
            _wrinkles(results),
        ]
    )


def _noise(results: DepthCamerasResult) -> str:
    real, simulated = results.real, results.simulated
    lines = ["## The simulated Xtion against real ones", ""]
    if real.step is not None and real.step_rest is not None:
        lines += [
            (
                f"Step of inverse depth: real maps {1e3 * real.step:.3f} mm at 1 m "
                f"({real.levels} levels between 0.9 and 1.2 m explained within "
                f"{1e3 * real.step_rest:.2f} mm, the driver's rounding), simulated "
                f"{1e3 * results.simulated_step:.3f} mm."
            ),
            "",
        ]
    else:
        lines += ["The real maps were not at hand.", ""]
    lines += [
        (
            "Table RMS is what perception measures (bow and bands taken out). The columns in steps are "
            "of inverse depth: all that is not plane, what is alike in a column, and the rest, with its "
            "correlation along rows at 1, 4, 8, 16, 32 pixels. Holes: of the image (7 blind columns are "
            "1.1 %; the maps of CTU are registered to colour and lack a margin; the simulated ones show the "
            "floor and the table's shadow on it), and on the garment."
        ),
        "",
        (
            line(
                "map",
                "table at, m",
                "table RMS, mm",
                "off the plane, steps",
                "columns",
                "rest",
                "correlation",
                "holes, %",
                "on garment, %",
            )
        ),
        rule(9),
    ]
    rows: list[tuple[str, MedianNoise]] = [(row.name, row) for row in [*real.maps, *simulated]]
    groups = (("median of the real maps", real.maps), ("median of the simulated", simulated))
    rows += [(f"**{name}**", _median(group)) for name, group in groups if group]
    for name, row in rows:
        alike = ", ".join(f"{row.along_rows[LAGS.index(lag)]:.2f}" for lag in (1, 4, 8, 16, 32))
        lines.append(
            line(
                f"{name}",
                f"{row.distance:.3f}",
                f"{1e3 * row.table_rms:.2f}",
                f"{row.plane_rms:.2f}",
                f"{row.column_rms:.2f}",
                f"{row.rest_rms:.2f}",
                f"{alike}",
                f"{100 * row.holes:.1f}",
                f"{100 * row.garment_holes:.2f}",
            )
        )
    return "\n".join(lines)


def _median(rows: Sequence[MapFigures]) -> MedianNoise:
    def middle(values: Sequence[float]) -> float:
        return float(np.median(values))

    return MedianNoise(
        distance=middle([row.distance for row in rows]),
        table_rms=middle([row.table_rms for row in rows]),
        plane_rms=middle([row.plane_rms for row in rows]),
        column_rms=middle([row.column_rms for row in rows]),
        rest_rms=middle([row.rest_rms for row in rows]),
        along_rows=tuple(np.median([row.along_rows for row in rows], axis=0).tolist()),
        holes=middle([row.holes for row in rows]),
        garment_holes=middle([row.garment_holes for row in rows]),
    )


def _laws(rows: Sequence[NoiseLaws]) -> str:
    lines = [
        "## Noise over distance",
        "",
        (
            "Standard deviation of a reading from look to look, a wall square on, mm, beside the laws "
            "for structured light of Khoshelham and Elberink (2012) and Nguyen et al. (2012); - where "
            "the camera has no reading. The specimen's fixed bias is not in it."
        ),
        "",
        line("distance, m", "Xtion", "Khoshelham", "Nguyen", "time of flight"),
        rule(5),
    ]
    for row in rows:
        values = [
            row.xtion_sigma,
            row.khoshelham_sigma,
            row.nguyen_sigma,
            row.tof_sigma,
        ]
        cells = " | ".join("-" if value is None else f"{1e3 * value:.2f}" for value in values)
        lines.append(line(f"{row.distance:.1f}", f"{cells}"))
    return "\n".join(lines)


def _edges(results: DepthCamerasResult) -> str:
    lines = [
        "## Edges, shadows and steep faces",
        "",
        (
            "A leaf 0.25 m over the table, and a towel with folds of up to 73 degrees. Flying: share of "
            "the readings within 4 pixels of the leaf's edge that lie over 20 mm from leaf and table. "
            "Shadow: pixels without a reading to the left and right of the leaf; by law the projector's "
            "shadow is f b (1/near - 1/far) wide, to the left."
        ),
        "",
        line(
            "camera",
            "over the table, m",
            "readings, %",
            "flying, %",
            "shadow left, right, px",
            "law, px",
        ),
        rule(6),
    ]
    for key, view in results.leaf.items():
        edge = view.edge
        left, right = edge.shadow
        shadow = f"{left}, {right}" if view.holes < 1.0 else "-"
        lines.append(
            line(
                f"{_TITLES[key.removesuffix('_close')]}",
                f"{view.height:.2f}",
                f"{100 * (1.0 - view.holes):.1f}",
                f"{100 * edge.flying:.1f}",
                f"{shadow}",
                f"{edge.shadow_law:.1f}",
            )
        )
    holes = "; ".join(
        f"{_TITLES[key]} {100 * view.garment_holes:.1f} %" for key, view in results.garment.items()
    )
    lines += ["", f"Without a reading on the folded towel: {holes}."]
    return "\n".join(lines)


def _wrinkles(results: DepthCamerasResult) -> str:
    lines = [
        "## The largest wrinkle from the camera's place in the cell",
        "",
        (
            "From (0, -1.10, 1.80) straight down, 1.10 m over the table. Found: the largest wrinkle "
            "lies within 10 mm beside the largest ridge and within 10 degrees of it."
        ),
        "",
        (
            line(
                "camera",
                "seed",
                "found",
                "beside, mm",
                "turn, deg",
                "length, mm",
                "width, mm",
                "chord height, mm",
                "look, s",
            )
        ),
        rule(9),
    ]
    for row in results.wrinkles:
        if row.length is not None:
            truth = row.truth
            figures = (
                f"{1e3 * (row.beside or 0.0):.1f} | {row.turn or 0.0:.1f} "
                f"| {1e3 * row.length:.0f} ({1e3 * truth.length:.0f}) "
                f"| {1e3 * (row.width or 0.0):.1f} ({1e3 * truth.width:.1f}) "
                f"| {1e3 * (row.chord_height or 0.0):.1f} ({1e3 * truth.chord_height:.1f})"
            )
        else:
            figures = " | ".join("-" * 5)
        lines.append(
            line(
                f"{_TITLES[row.camera]}",
                f"{row.seed}",
                f"{('yes' if row.found else 'no')}",
                f"{figures}",
                f"{row.time:.2f}",
            )
        )
    shares = "; ".join(f"{_TITLES[k]} {100 * v:.0f} %" for k, v in results.largest_found.items())
    lines += ["", f"Truth in brackets. Found: {shares}."]
    return "\n".join(lines)


def plotted(results: DepthCamerasResult, path: Path) -> None:
    """Draw both scenes as both cameras see them, sections through them, and the noise."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(3, 4, figsize=(15.0, 11.0), layout="constrained")
    for row, (name, top) in enumerate((("leaf", 0.28), ("garment", 0.07))):
        views: dict[str, View] = {**getattr(results, name)}
        _image(figure, axes[row, 0], views["xtion"].truth, top, f"{name}: truth")
        for column, key in enumerate(("xtion", "tof"), start=1):
            view = views[key]
            title = f"{_TITLES[key]}, from {view.height:.2f} m"
            _image(figure, axes[row, column], view.reading, top, title)
        _section(axes[row, 3], views, f"{name}: middle row (bars: no reading)")
    close = results.leaf["tof_close"]
    title = f"ToF, from {close.height:.2f} m (Xtion: none)"
    _image(figure, axes[2, 0], close.reading, 0.28, title)
    _sigmas(axes[2, 1], results.laws)
    _correlation(axes[2, 2], results)
    _columns(axes[2, 3], results)
    figure.savefig(path, dpi=90)
    pyplot.close(figure)


def _image(figure: Any, axis: Any, picture: str, top: float, title: str) -> None:
    from matplotlib import colormaps

    colours = colormaps["viridis"].with_extremes(bad="red", under="lightgrey")
    height = 1e3 * restored(picture)
    drawn = axis.imshow(height, vmin=-20.0, vmax=1e3 * top, cmap=colours, interpolation="nearest")
    axis.set_title(title, fontsize=10)
    axis.set_xticks([])
    axis.set_yticks([])
    figure.colorbar(drawn, ax=axis, shrink=0.8, label="over the table, mm; red: no reading")


def _section(axis: Any, views: dict[str, View], title: str) -> None:
    for key in ("xtion", "tof"):
        section = views[key].section
        ray, truth, reading = (
            _floats(values) for values in (section.ray, section.truth, section.reading)
        )
        x = 1e3 * ray * (views[key].height - truth)
        seen = 1e3 * ray * (views[key].height - reading)
        truth, reading = 1e3 * truth, 1e3 * reading
        if key == "xtion":
            axis.plot(x, truth, color="black", linewidth=0.8, label="truth")
        axis.plot(seen, reading, ".", markersize=3.0, color=_COLOURS[key], label=_TITLES[key])
        holes = np.isnan(reading)
        base = -0.12 * np.nanmax(truth) * (1.0 if key == "xtion" else 1.5)
        axis.plot(x[holes], np.full(holes.sum(), base), "|", color=_COLOURS[key], markersize=8.0)
    axis.set_xlim(-200.0, 200.0)
    axis.set_ylim(bottom=min(-10.0, 1.5 * base), top=1.4 * np.nanmax(truth))
    axis.set_title(title, fontsize=10)
    axis.set_xlabel("mm")
    axis.set_ylabel("over the table, mm")
    axis.legend(fontsize=7, loc="upper left")


def _sigmas(axis: Any, laws: Sequence[NoiseLaws]) -> None:
    distance = [row.distance for row in laws]
    for key in ("xtion", "tof"):
        values = 1e3 * _floats([getattr(row, f"{key}_sigma") for row in laws])
        axis.loglog(distance, values, "o-", color=_COLOURS[key], label=_TITLES[key])
    for key, style in (("khoshelham", "--"), ("nguyen", ":")):
        values = 1e3 * _floats([getattr(row, f"{key}_sigma") for row in laws])
        axis.loglog(distance, values, style, color="grey", label=f"{key.title()} 2012")
    axis.set_xticks(distance, [f"{value:g}" for value in distance], minor=False)
    axis.set_xticks([], minor=True)
    axis.set_title("noise from look to look", fontsize=10)
    axis.set_xlabel("distance, m")
    axis.set_ylabel("standard deviation, mm")
    axis.legend(fontsize=8)


def _correlation(axis: Any, results: DepthCamerasResult) -> None:
    for row in results.real.maps:
        axis.plot(LAGS, row.along_rows, color="grey", linewidth=0.6)
    axis.plot([], [], color="grey", label="real maps")
    for row in results.simulated:
        axis.plot(LAGS, row.along_rows, "o-", color=_COLOURS["xtion"], markersize=3.0)
    axis.plot([], [], "o-", color=_COLOURS["xtion"], label="simulated Xtion")
    axis.set_xscale("log", base=2)
    axis.set_title("correlation of the noise along rows", fontsize=10)
    axis.set_xlabel("pixels")
    axis.legend(fontsize=8)


def _columns(axis: Any, results: DepthCamerasResult) -> None:
    chosen = (*results.real.maps[:3], *results.simulated[:1])
    for level, row in enumerate(chosen):
        real = row in results.real.maps
        colour = "grey" if real else _COLOURS["xtion"]
        columns = _floats(row.columns) - 3.0 * level
        axis.plot(columns, color=colour, linewidth=0.8, label=None if real else "simulated Xtion")
    axis.plot([], [], color="grey", label="real maps")
    axis.set_title("vertical bands: means of columns", fontsize=10)
    axis.set_xlabel("column")
    axis.set_ylabel("steps of inverse depth")
    axis.legend(fontsize=8)


def _floats(values: Sequence[float | None]) -> NDArray[np.float64]:
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)
