"""How well the garment's mask agrees with outlines that people drew (CTU spread garments).

The outlines are drawn in the colour image, which is not registered to depth. So each is laid over
the mask by the similarity (scale, turn, shift) that fits best, and the intersection over union is
what remains: it judges the mask's shape, not its place.

Data: L. Wagner, D. Krejcova, V. Smutny, "CTU Color and Depth Image Dataset of Spread Garments",
CTU-CMP-2013-25; a folder of it is found by the variable UNWRINKLE_DATA or beside the repository.
"""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.optimize import minimize

from benchmarks.harness.data import data_folder
from benchmarks.harness.report import Progress
from benchmarks.harness.tables import line, rule
from unwrinkle.models.errors import InputError
from unwrinkle.perception.depth.capture import Capture
from unwrinkle.perception.depth.range_mapping import load_capture, segment_capture
from unwrinkle.perception.sensor import noise_profile

_FOLDER = "clopema_ctu_spread_garments"


@dataclass(frozen=True)
class MaskFigures:
    """One sample: intersections over union with and without colour, and the table's RMS, m."""

    name: str
    type: str
    shape: str
    iou_colour: float
    method_colour: str
    table_rms: float
    iou_depth: float
    method_depth: str


@dataclass(frozen=True)
class MasksResult:
    """All samples, and median and least intersection over union with colour."""

    samples: tuple[MaskFigures, ...]
    iou_median: float
    iou_min: float


def run(*, quick: bool, seed: int, progress: Progress) -> MasksResult:
    """Measure the mask of every sample, with its colour and by depth alone."""
    folder = data_folder(_FOLDER)
    samples: list[MaskFigures] = []
    paths = sorted(folder.glob("cloD*.png"))
    if not paths:
        raise InputError(f"{folder}: holds no cloD*.png; is it the CTU data set?")
    for done, path in enumerate(paths):
        progress(done, len(paths), path.stem)
        note = yaml.safe_load(
            (folder / path.name.replace("cloD", "cloA")).with_suffix(".yaml").read_text()
        )
        capture = load_capture(path, "xtion-pro-live")
        outlines = silhouette(note["poly_c"], note["node_names"])
        _, colour = segment_capture(capture, noise_profile("xtion"), seed=seed)
        alone = _without_colour(capture)
        table, depth = segment_capture(alone, noise_profile("xtion"), seed=seed)
        samples.append(
            MaskFigures(
                name=path.stem,
                type=note["type"],
                shape=note["shape"],
                iou_colour=best_overlap(colour.garment, outlines),
                method_colour=colour.method,
                table_rms=table.rms,
                iou_depth=best_overlap(depth.garment, outlines),
                method_depth=depth.method,
            )
        )
    progress(len(paths), len(paths), "done")
    values = [sample.iou_colour for sample in samples]
    return MasksResult(tuple(samples), float(np.median(values)), min(values))


def table(results: MasksResult) -> str:
    """Return one row per sample."""
    lines = [
        "Intersection over union of the garment's mask and the annotated outline, after the best",
        "similarity alignment (colour and depth are not registered). The outlines are polygons of",
        "7 to 14 points with straight sides.",
        "",
        line("sample", "garment", "IoU, colour and depth", "IoU, depth alone", "table RMS (mm)"),
        rule(5),
    ]
    lines += [
        line(
            f"{s.name}",
            f"{s.type}, {s.shape}",
            f"{s.iou_colour:.3f}",
            f"{s.iou_depth:.3f}",
            f"{1e3 * s.table_rms:.2f}",
        )
        for s in results.samples
    ]
    return "\n".join([*lines, ""])


def silhouette(points: list[list[float]], names: list[list[str]]) -> list[NDArray[np.float64]]:
    """Return polygons whose union is the garment's silhouette.

    A folded garment's outline runs along the folded flap's edge and meets each fold twice, under
    the same name: what lies between the two is the flap, on its other side.
    """
    polygon = np.asarray(points, dtype=float)
    keys = [" ".join(name) for name in names]
    polygons = [polygon]
    for first, key in enumerate(keys):
        if key in keys[first + 1 :]:
            polygons.append(polygon[first : keys.index(key, first + 1) + 1])
    return polygons


def best_overlap(mask: NDArray[np.bool_], outlines: list[NDArray[np.float64]]) -> float:
    """Largest intersection over union of a mask and the union of polygons under any similarity.

    Args:
        mask: (h, w) bool.
        outlines: polygons (n, 2), x, y in any image's pixels.
    """
    area = float(np.count_nonzero(mask))
    rows, columns = np.nonzero(mask)
    aim = np.array([columns.mean(), rows.mean()])
    # Area and centre of the union, from a drawing of it about as large as the mask.
    corner = np.min([outline.min(axis=0) for outline in outlines], axis=0)
    extent = np.max([outline.max(axis=0) for outline in outlines], axis=0) - corner
    coarse = max(mask.shape) / float(extent.max())
    drawn = np.zeros((max(mask.shape) + 2,) * 2, np.uint8)
    _fill(drawn, [(outline - corner) * coarse for outline in outlines])
    drawn_rows, drawn_columns = np.nonzero(drawn)
    middle = corner + np.array([drawn_columns.mean(), drawn_rows.mean()]) / coarse
    zoom = np.sqrt(area / drawn_rows.size) * coarse
    filled = np.zeros(mask.shape, np.uint8)

    def cost(x: NDArray[np.float64]) -> float:
        c, s = np.cos(x[1]) * x[0] * zoom, np.sin(x[1]) * x[0] * zoom
        turn = np.array([[c, s], [-s, c]])
        filled[:] = 0
        _fill(filled, [(outline - middle) @ turn + x[2:] for outline in outlines])
        both = np.count_nonzero(filled.astype(bool) & mask)
        either = np.count_nonzero(filled) + area - both
        return -both / max(either, 1.0)

    best = 0.0
    for angle in np.radians((-6.0, 0.0, 6.0)):
        origin = np.array([1.0, angle, *aim])
        simplex = origin + np.vstack([np.zeros(4), np.diag([0.05, 0.05, 8.0, 8.0])])
        options: Any = {"initial_simplex": simplex, "xatol": 1e-3, "fatol": 1e-5, "maxiter": 400}
        found = minimize(cost, origin, method="Nelder-Mead", options=options)
        best = max(best, -float(found.fun))
    return best


def _fill(image: NDArray[np.uint8], polygons: list[NDArray[np.float64]]) -> None:
    for polygon in polygons:
        cv2.fillPoly(image, [np.rint(polygon * 16.0).astype(np.int32)], 1, shift=4)


def _without_colour(capture: Capture) -> Capture:
    return Capture(capture.depth, capture.camera, X_WC=capture.X_WC, name=capture.name)
