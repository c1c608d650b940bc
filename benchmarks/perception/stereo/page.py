"""The page and the plot of `bench stereo`."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TypeVar

from benchmarks.harness.report import load_report
from benchmarks.harness.tables import table
from benchmarks.perception.calibration import CalibrationResult
from benchmarks.perception.gaze.benchmark import GazeResult
from benchmarks.perception.stereo.results import (
    MatcherFigures,
    RealPairs,
    SceneFigures,
    SizeFigures,
    StereoResult,
)

_Result = TypeVar("_Result")
_RECORDED = Path("docs") / "results"  # of a checkout; elsewhere there is nothing recorded


def page(results: StereoResult) -> str:
    """Return the results as Markdown."""
    parts = [
        _headline(results),
        _scenes(results.scenes),
        _wrinkles(results.scenes),
        _methods(results.methods),
        _sizes(results.sizes),
        _real(results.real),
        _head(),
    ]
    return "\n\n".join(parts)


def plotted(results: StereoResult, path: Path) -> None:
    """Draw time and error over the images' size."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    sizes = sorted(results.sizes, key=lambda row: float(row.megapixels))
    pixels = [row.megapixels for row in sizes]
    figure, (left, right) = pyplot.subplots(1, 2, figsize=(9.0, 3.4), layout="constrained")
    left.loglog(pixels, [row.time for row in sizes], "o-", label="measured")
    linear = [sizes[0].time * count / pixels[0] for count in pixels]
    left.loglog(pixels, linear, "--", color="grey", label="linear in pixels")
    left.set(xlabel="megapixels", ylabel="pair to map (s)", title="time")
    left.legend()
    right.loglog(pixels, [1e3 * row.height_rms for row in sizes], "o-")
    right.set(xlabel="megapixels", ylabel="height error, RMS (mm)", title="error on terry cloth")
    for axes in (left, right):
        axes.set_xticks(pixels, [str(count) for count in pixels])
        axes.grid(True, which="both", alpha=0.3)
    figure.savefig(path, dpi=120)
    pyplot.close(figure)


def _headline(results: StereoResult) -> str:
    times = results.times
    rows = [
        ("raw 16 MP pair to map of the table, whole images, median", "1.0 s",
         f"{results.pair_to_map_time_median:.2f} s"),
        ("the same, only what can show the table", "-", f"{times.table_region_median:.2f} s"),
        ("the same with garment, colour, levelled table (`analyse`)", "-",
         f"{times.garment_map_median:.2f} s"),
        ("peak memory of a process that does both", "2.5 GB",
         f"{results.peak_memory / 1e9:.2f} GB"),
        ("disparity error on terry cloth in the cell, RMS", "0.15 px",
         f"{results.disparity_rms:.3f} px"),
        ("bias", "0.02 px", f"{results.disparity_bias:+.4f} px"),
        ("valid", "99 %", f"{100 * results.valid_fraction:.2f} %"),
        ("time of SGBM 3WAY at full resolution over ours", "12",
         f"{results.speedup_over_sgbm_full:.1f}"),
        ("its RMS over ours", "1.5", f"{results.rms_ratio_over_sgbm_full:.1f}"),
    ]  # fmt: skip
    return table(("what", "target", "measured"), rows)


def _scenes(scenes: dict[str, SceneFigures]) -> str:
    rows = []
    for scene in scenes.values():
        rows.append(
            (
                scene.name,
                f"{scene.rms:.3f}",
                f"{scene.median:.3f}",
                f"{scene.bias:+.4f}",
                f"{100 * scene.valid:.2f}",
                f"{1e3 * scene.height_per_pixel:.2f}",
                f"{1e3 * scene.height_rms:.3f}",
                f"{1e3 * scene.map.rms:.3f} ({1e3 * scene.map.bias:+.3f})",
                f"{1e3 * scene.spline.rms:.3f}",
            )
        )
    head = (
        "cloth, distance",
        "disparity RMS px",
        "median px",
        "bias px",
        "valid %",
        "mm of height per px",
        "height RMS mm",
        "height map RMS (bias) mm",
        "after the spline mm",
    )
    return (
        "Cloth with ridges 15 to 21 mm high, lens and sensor as in the cell (shot and read noise, "
        "blur, distortion, vignetting, unlike gain). Every valid pixel of the cloth counts but "
        "those within 6 mm of its rim (10 mm on the map); nothing else is left out.\n\n"
        + table(head, rows)
    )


def _wrinkles(scenes: dict[str, SceneFigures]) -> str:
    rows = []
    for scene in scenes.values():
        for row in scene.wrinkles:
            rows.append(
                (
                    scene.name,
                    f"{1e3 * row.width:.1f}",
                    "not found" if row.width_error is None else f"{1e3 * row.width_error:+.2f}",
                    f"{1e3 * row.height:.2f}",
                    "-" if row.height_error is None else f"{1e3 * row.height_error:+.2f}",
                )
            )
    head = ("cloth, distance", "true width mm", "error", "true chord height mm", "error")
    return "Wrinkles found on these maps (target: within 0.5 mm).\n\n" + table(head, rows)


def _methods(methods: Sequence[MatcherFigures]) -> str:
    ours = methods[0]
    rows = [
        (
            row.name,
            f"{row.time:.2f}",
            f"{row.time / ours.time:.1f}",
            f"{row.rms:.3f}",
            f"{row.rms / ours.rms:.1f}",
            f"{row.median:.3f}",
            f"{100 * row.valid:.1f}",
            f"{100 * row.gross:.3f}",
        )
        for row in methods
    ]
    head = (
        "method", "time s", "over ours", "RMS px", "over ours", "median px", "valid %",
        "beyond 3 mm %",
    )  # fmt: skip
    return (
        "Matching alone, on one rectified pair of the whole images (terry cloth in the cell).\n\n"
        + table(head, rows)
    )


def _sizes(sizes: Sequence[SizeFigures]) -> str:
    rows = [
        (
            f"{row.megapixels}",
            f"{row.time:.2f}",
            f"{row.rms:.3f}",
            f"{1e3 * row.height_rms:.3f}",
            f"{100 * row.valid:.2f}",
        )
        for row in sizes
    ]
    head = ("megapixels", "pair to map s", "disparity RMS px", "height RMS mm", "valid %")
    return (
        "The same pair as area averages, whole images.\n\n"
        + table(head, rows)
        + "\n\n![time and error by size](stereo.png)"
    )


def _real(real: RealPairs | None) -> str:
    if not real:
        return "The real pairs were not at hand (set UNWRINKLE_DATA)."
    motorcycle, boards = real.motorcycle, real.chessboards
    rows = [
        (
            row.name,
            f"{row.median:.3f}",
            f"{100 * row.bad:.1f}",
            f"{100 * row.valid:.1f}",
        )
        for row in motorcycle
    ]
    head = ("Middlebury Motorcycle", "median px", "over 1 px %", "of the known pixels %")
    board_rows = [
        ("stereo RMS", "0.15 px", f"{boards.rms_px:.3f} px"),
        ("row error after rectification, RMS", "0.2 px", f"{boards.row_error_px:.3f} px"),
        (
            "focal length against the owner's",
            "0.5 %",
            f"{100 * boards.focal_difference_max:.2f} %",
        ),
        ("pairs", "-", f"{boards.pairs}"),
    ]
    return (
        "Real pairs. Motorcycle (targets: 0.170 px, 7.9 %): SGBM HH4 with its left-right check "
        "answers where both eyes see; our own check leaves out depth edges.\n\n"
        + table(head, rows)
        + "\n\n"
        + table(("real chessboards", "target", "measured"), board_rows)
    )


def _head() -> str:
    """What the benchmarks of the head's calibration and gaze last recorded."""
    rows = []
    calibration = _recorded("calibration", CalibrationResult)
    gaze = _recorded("gaze", GazeResult)
    if calibration:
        for row in calibration.rendered:
            turn = max(eye.turn for eye in row.eyes)
            shift = max(eye.shift for eye in row.eyes)
            rows.append(
                (
                    (
                        "camera on its unit, calibrated from nothing in the rendered cell; units repeat "
                        f"to {row.repeatability:g} steps"
                    ),
                    "5 mdeg, 0.2 mm",
                    f"{1e3 * math.degrees(turn):.1f} mdeg, {1e3 * shift:.2f} mm",
                )
            )
        if calibration.range_maps:
            rows.append(
                (
                    "error of range maps at 5 new gazes over that with the true head, worst",
                    "1.3",
                    f"{calibration.range_map_ratio_max or 0.0:.2f}",
                )
            )
    if gaze:
        rows.append(
            (
                f"gaze from {gaze.starts} random starts: within 20 mdeg; looks; worst error",
                "all; 3; 20 mdeg",
                (
                    f"{gaze.starts_converged}; {gaze.looks_max}; "
                    f"{1e3 * math.degrees(gaze.error_max):.1f} mdeg"
                ),
            )
        )
        rows.append(
            (
                "computing per look, median (worst)",
                "0.25 s",
                f"{gaze.time_per_look_median:.3f} s ({gaze.time_per_look_max:.3f} s)",
            )
        )
    text = (
        "The head itself has benchmarks of its own, `unwrinkle bench calibration` and `unwrinkle "
        "bench gaze`; see [calibration](calibration.md) and [gaze](gaze.md)."
    )
    if not rows:
        return text
    return text + " As last recorded there:\n\n" + table(("what", "target", "measured"), rows)


def _recorded(name: str, kind: type[_Result]) -> _Result | None:
    """Load what another benchmark recorded; None where there is nothing."""
    path = _RECORDED / f"{name}.json"
    if not path.is_file():
        return None
    results: _Result = load_report(path, kind).results
    return results
