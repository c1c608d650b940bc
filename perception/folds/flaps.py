"""Flaps: parts of a garment that are folded over and lie on it.

By the known outline: what is missing of it, mirrored over the line that closes the gap, is the
flap, if the cloth on that line stands up as a fold does.

By borders alone, for any garment: a random walker (L. Grady, IEEE TPAMI 2006) with seeds beside the
borders finds the cells between their upper sides; the fold line is the straight part of the
garment's outline beside them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.linalg import spsolve

from unwrinkle.models.arrays import Mask
from unwrinkle.models.garment import KnownGarment
from unwrinkle.perception.folds.borders import Borders
from unwrinkle.perception.folds.garment_outline import Placement, closed_outline, place_outline
from unwrinkle.perception.folds.height_image import HeightImage, Points
from unwrinkle.perception.folds.settings import FoldSettings

#: A missing part: opening that removes slivers, least radius of its largest disc, metres; least
#: area, m^2.
_OPENING_M = 0.004
_LEAST_DEPTH_M = 0.007
_LEAST_MISSING_M2 = 8e-4

#: The outline that closes a gap: distance from the gap, and from the known outline, metres.
_CLOSING_M = 0.006
_INNER_M = 0.008

#: The rim of a fold is the highest cloth at these distances inside its line, metres.
_RIM_M = (0.004, 0.020)

#: A fold's bulge of radius H / 2 takes up this multiple of H / 2 of the flap: pi / 2 of its half
#: circle less what it covers.
_BULGE = 1.14

#: A flap is accepted with a straight line (median deviation), of a length, metres, and a share of
#: the mirrored part on the garment.
_MOST_BENT_M = 0.003
_LEAST_LINE_M = 0.060
_LEAST_INSIDE = 0.85

#: Least hidden area over a flap's area, and the share of the flat area that the surface of a
#: wrinkled garment lacks, because steep flanks are read too flat.
_HIDDEN_SHARE = 0.3
_UNDER_READ = 0.015

#: What accepted fold lines add to a placement's share of the outline, up to a length, metres.
_EXPLAINED = 0.25
_EXPLAINED_M = 0.5

#: Random walker: side of its cells, metres, distances of the seeds from a border, metres, weights
#: of the weakest and the strongest border, links on even cloth besides slope and over borders, pull
#: towards the lower layer, opening of the result, metres.
_WALKER_CELL_M = 0.004
_SEEDS_M = (0.006, 0.016)
_SEED_WEIGHTS = (0.3, 2.0)
_LINK, _BORDER_LINK = 1e-3, 1e-4
_LOWER_PULL = 4e-6
_WALKER_OPENING_M = 0.008

#: Fold line of a flap found by borders: distance of the outline from the flap, deviation from the
#: line, least length, metres; candidates that are drawn.
_BESIDE_M = 0.020
_LINE_M = 0.005
_LEAST_FOLD_M = 0.05
_DRAWS = 300


@dataclass(frozen=True, eq=False)
class Flap:
    """A part of a garment that lies folded over on it. World frame, metres.

    Attributes:
        region: (ny, nx) cells that it covers.
        area: of the flap, m^2.
        line: (2, 2) ends of the fold line.
        opening: (2,) unit, direction in which it opens: from the garment over the line.
        hold: (2,) where to take hold of it: its point that is farthest from the line.
        by: "outline" or "borders", what it was found by.
        confidence: 0 to 1, see `find_flaps`.
    """

    region: Mask
    area: float
    line: Points
    opening: Points
    hold: Points
    by: str
    confidence: float

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        for array in (self.region, self.line, self.opening, self.hold):
            array.setflags(write=False)

    def to_json(self) -> dict[str, Any]:
        """Return plain numbers and lists."""
        return {
            "area": self.area,
            "line": self.line.tolist(),
            "opening": self.opening.tolist(),
            "hold": self.hold.tolist(),
            "by": self.by,
            "confidence": self.confidence,
        }


def flaps_by_outline(
    image: HeightImage, settings: FoldSettings, known: KnownGarment, hidden: float
) -> list[Flap]:
    """Find the flaps of a garment of known outline.

    Args:
        image: the garment's heights.
        settings: for the sensor.
        known: the garment, with its outline.
        hidden: area of the cloth that is hidden below other cloth, m^2.
    """
    outline = image.world(closed_outline(image.garment))
    z = image.smoothed(settings.level_smoothing)
    base = float(np.percentile(z[image.garment], 20.0))
    least_rim = max(settings.least_rim, 0.5 * known.thickness if settings.fine else 0.0)
    best: tuple[float, list[Flap]] = (-math.inf, [])
    surely_hidden = hidden - _UNDER_READ * known.flat_area
    for placement in place_outline(outline, known.corners):
        flaps = _missing_parts(image, settings, placement, z, base, least_rim, surely_hidden)
        explained = min(sum(_length(flap.line) for flap in flaps), _EXPLAINED_M) / _EXPLAINED_M
        score = placement.share + _EXPLAINED * explained
        if score > best[0]:
            best = (score, flaps)
    return best[1]


def _length(line: Points) -> float:
    return float(np.hypot(*(line[1] - line[0])))


def _missing_parts(
    image: HeightImage,
    settings: FoldSettings,
    placement: Placement,
    z: NDArray[np.float32],
    base: float,
    least_rim: float,
    hidden: float,
) -> list[Flap]:
    """Return the flaps that explain what a placement lacks."""
    pad = round(0.3 / image.resolution)
    garment = np.pad(image.garment, pad)
    corners = image.cells(placement.corners) + pad
    known = np.zeros(garment.shape, dtype=np.uint8)
    cv2.fillPoly(known, [np.rint(corners).astype(np.int32)], 1)
    missing = ((known > 0) & ~garment).astype(np.uint8)
    missing = cv2.morphologyEx(missing, cv2.MORPH_OPEN, _disc(_OPENING_M, image.resolution))
    count, labels = cv2.connectedComponents(missing, connectivity=4)
    inner = cv2.distanceTransform(known, cv2.DIST_L2, 5) * image.resolution > _INNER_M
    edge = garment & ~ndimage.binary_erosion(garment) & inner
    flaps = []
    for number in range(1, count):
        part = labels == number
        flap = _mirrored(
            image, settings, part, edge, garment, pad, z, base, least_rim, hidden, placement.share
        )
        if flap is not None:
            flaps.append(flap)
    return flaps


def _mirrored(
    image: HeightImage,
    settings: FoldSettings,
    part: Mask,
    edge: Mask,
    garment: Mask,
    pad: int,
    z: NDArray[np.float32],
    base: float,
    least_rim: float,
    hidden: float,
    share: float,
) -> Flap | None:
    """Return the flap that a missing part makes, mirrored over the line that closes it, or None."""
    cell = image.resolution
    area = float(np.count_nonzero(part)) * cell**2
    depth = cv2.distanceTransform(part.astype(np.uint8), cv2.DIST_L2, 5).max() * cell
    if area < _LEAST_MISSING_M2 or depth < _LEAST_DEPTH_M:
        return None
    near = cv2.dilate(part.astype(np.uint8), _disc(_CLOSING_M, cell)) > 0
    points = np.argwhere(edge & near)[:, ::-1].astype(float)
    if len(points) < 10:
        return None
    centre, along = _robust_line(points)
    normal = np.array([-along[1], along[0]])
    cells = np.argwhere(part)[:, ::-1].astype(float)
    if float(np.mean((cells - centre) @ normal)) < 0.0:
        normal = -normal
    bent = float(np.median(np.abs((points - centre) @ normal))) * cell
    t = (points - centre) @ along
    length = float(np.ptp(t)) * cell
    if bent > _MOST_BENT_M or length < _LEAST_LINE_M:
        return None
    rim = _rim(image, z, centre - pad, along, normal, t, base)
    if rim < least_rim:
        return None
    beyond = (cells - centre) @ normal
    taken_up = _BULGE * 0.5 * rim / cell
    over = beyond > 0.0
    back = np.maximum(2.0 * beyond[over] - taken_up, 0.0)
    mirrored = np.rint(cells[over] - back[:, None] * normal).astype(int)
    ny, nx = garment.shape
    region: NDArray[np.uint8] = np.zeros((ny, nx), dtype=np.uint8)
    columns, rows = mirrored.T
    within = (columns >= 0) & (rows >= 0) & (columns < nx) & (rows < ny)
    region[rows[within], columns[within]] = 1
    closed = cv2.morphologyEx(region, cv2.MORPH_CLOSE, _disc(_OPENING_M, cell)) > 0
    inside = float((closed & garment).sum()) / max(1, int(closed.sum()))
    if inside < _LEAST_INSIDE or not over.any():
        return None
    shown = closed[pad:-pad, pad:-pad] & image.garment
    flap_area = float(np.count_nonzero(shown)) * cell**2
    if flap_area < settings.least_flap_area or hidden < _HIDDEN_SHARE * flap_area:
        return None
    ends = np.stack([centre + t.min() * along, centre + t.max() * along]) - pad
    far = int(np.argmax(beyond[over]))
    hold = cells[over][far] - back[far] * normal - pad
    confidence = float(np.clip(share, 0.0, 1.0) * min(1.0, inside) * min(1.0, rim / least_rim / 2))
    return Flap(
        shown,
        flap_area,
        image.world(ends),
        normal,
        image.world(hold),
        "outline",
        confidence,
    )


def _robust_line(points: Points) -> tuple[Points, Points]:
    """Return a point (2,) on the line through most of the points, and its direction (2,)."""
    used = points
    for _ in range(5):
        centre = used.mean(axis=0)
        along = np.linalg.svd(used - centre, full_matrices=False)[2][0]
        off = np.abs((points - centre) @ np.array([-along[1], along[0]]))
        kept = points[off < max(2.5 * float(np.median(off)), 1.5)]
        if len(kept) < 4:
            break
        used = kept
    return centre, along


def _rim(
    image: HeightImage,
    z: NDArray[np.float32],
    centre: Points,
    along: Points,
    normal: Points,
    t: Points,
    base: float,
) -> float:
    """Return the median height of the rim along a fold line over the lowest cloth, metres."""
    margin = 8.0 if np.ptp(t) * image.resolution > 0.05 else 0.0
    places = np.linspace(t.min() + margin, t.max() - margin, 60)
    depths = np.arange(_RIM_M[0], _RIM_M[1] + 1e-9, 0.002) / image.resolution
    points = centre + places[:, None, None] * along - depths[:, None] * normal
    rows, columns = points[..., 1], points[..., 0]
    heights = ndimage.map_coordinates(z, [rows, columns], order=1, mode="nearest")
    return float(np.median(heights.max(axis=1))) - base


def flaps_by_borders(
    image: HeightImage, settings: FoldSettings, borders: Borders, seed: int = 0
) -> list[Flap]:
    """Find the flaps of any garment, between the upper sides of its borders.

    A flap without a straight part of the garment's outline beside it has no fold line, and is left
    out.
    """
    if len(borders.points) < 5:
        return []
    upper = _upper_layer(image, settings, borders)
    count, labels = cv2.connectedComponents(upper.astype(np.uint8), connectivity=4)
    outline = closed_outline(image.garment)
    rng = np.random.default_rng(seed)
    flaps = []
    for number in range(1, count):
        region = labels == number
        area = float(np.count_nonzero(region)) * image.resolution**2
        if area < settings.least_flap_area:
            continue
        away = cv2.distanceTransform((~region).astype(np.uint8), cv2.DIST_L2, 5)
        columns, rows = outline.astype(int).T
        beside = outline[away[rows, columns] * image.resolution < _BESIDE_M]
        line = _longest_line(beside, image.resolution, rng)
        if line is None:
            continue
        centre, along, t = line
        normal = np.array([-along[1], along[0]])
        cells = np.argwhere(region)[:, ::-1].astype(float)
        if float((centre - cells.mean(axis=0)) @ normal) < 0.0:
            normal = -normal
        hold = cells[np.argmin((cells - centre) @ normal)]
        length = float(np.ptp(t)) * image.resolution
        flaps.append(
            Flap(
                region,
                area,
                image.world(np.stack([centre + t.min() * along, centre + t.max() * along])),
                normal,
                image.world(hold),
                "borders",
                float(min(1.0, length / math.sqrt(area)) * 0.6),
            )
        )
    return flaps


def _upper_layer(image: HeightImage, settings: FoldSettings, borders: Borders) -> Mask:
    """Return the cells that lie on an upper layer: a soft random walker from the borders' sides."""
    shape, cell = image.garment.shape, image.resolution
    upper, lower = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    weight = np.clip(borders.step / settings.walker_step, *_SEED_WEIGHTS)
    for distance in np.arange(_SEEDS_M[0], _SEEDS_M[1] + 1e-9, cell) / cell:
        for seeds, sign in ((upper, 1.0), (lower, -1.0)):
            places = np.rint(borders.points + sign * distance * borders.upwards).astype(int)
            columns, rows = places.T
            ok = (rows >= 0) & (rows < shape[0]) & (columns >= 0) & (columns < shape[1])
            np.add.at(seeds, (rows[ok], columns[ok]), weight[ok])
    on_border = np.zeros(shape, dtype=np.uint8)
    columns, rows = borders.points.astype(int).T
    on_border[rows, columns] = 1
    on_border = cv2.dilate(on_border, np.ones((3, 3), np.uint8))
    zy, zx = np.gradient(image.smoothed(settings.smoothing), cell)
    slope = np.where(image.garment, np.hypot(zx, zy), 0.0).astype(np.float32)
    block = max(1, round(_WALKER_CELL_M / cell))
    ny, nx = shape[0] // block * block, shape[1] // block * block

    def blocks(values: NDArray[Any]) -> NDArray[Any]:
        return values[:ny, :nx].reshape(ny // block, block, nx // block, block)

    inside = blocks(image.garment).mean(axis=(1, 3)) > 0.4
    upper, lower = (blocks(seeds).mean(axis=(1, 3)) for seeds in (upper, lower))
    slope, barred = blocks(slope).max(axis=(1, 3)), blocks(on_border).max(axis=(1, 3)) > 0
    chance = _walk(inside, upper, lower, slope / settings.walker_slope, barred)
    large = np.zeros(shape, dtype=np.uint8)
    large[:ny, :nx] = np.repeat(np.repeat(chance > 0.5, block, axis=0), block, axis=1)
    large &= image.garment
    return cv2.morphologyEx(large, cv2.MORPH_OPEN, _disc(_WALKER_OPENING_M, cell)) > 0


def _walk(
    inside: Mask,
    upper: NDArray[np.float32],
    lower: NDArray[np.float32],
    slope: NDArray[np.float32],
    barred: Mask,
) -> Points:
    """Return each cell's chance to belong to the upper layer.

    Minimises sum of seeds' weights * (u - seed)^2 / 2 + links * (u_i - u_j)^2 + a weak pull to 0.
    """
    number = np.full(inside.shape, -1, dtype=np.intp)
    size = int(np.count_nonzero(inside))
    number[inside] = np.arange(size)
    diagonal = 0.5 * (upper + lower)[inside].astype(float) + _LOWER_PULL
    right = 0.5 * upper[inside].astype(float)
    rows, columns, values = [], [], []
    for dy, dx in ((0, 1), (1, 0)):
        here = (slice(0, inside.shape[0] - dy), slice(0, inside.shape[1] - dx))
        there = (slice(dy, None), slice(dx, None))
        joined = inside[here] & inside[there]
        steep = np.maximum(slope[here], slope[there])[joined]
        link = np.exp(-(steep.astype(float) ** 2)) + _LINK
        link[(barred[here] | barred[there])[joined]] = _BORDER_LINK
        a, b = number[here][joined], number[there][joined]
        np.add.at(diagonal, a, link)
        np.add.at(diagonal, b, link)
        rows += [a, b]
        columns += [b, a]
        values += [-link, -link]
    every = np.arange(size)
    matrix = coo_array(
        (
            np.concatenate([*values, diagonal]),
            (np.concatenate([*rows, every]), np.concatenate([*columns, every])),
        ),
        shape=(size, size),
    )
    chance = np.zeros(inside.shape)
    chance[inside] = spsolve(matrix.tocsc(), right, permc_spec="MMD_AT_PLUS_A")
    return chance


def _longest_line(
    points: Points, cell: float, rng: np.random.Generator
) -> tuple[Points, Points, Points] | None:
    """Return centre, direction and places of the longest straight run (RANSAC), or None."""
    if len(points) < 10:
        return None
    best: NDArray[np.bool_] | None = None
    for _ in range(_DRAWS):
        a, b = points[rng.choice(len(points), 2, replace=False)]
        span = b - a
        length = float(np.hypot(*span))
        if length * cell < 0.04:
            continue
        off = np.abs((points - a) @ np.array([-span[1], span[0]])) / length
        near = off * cell < _LINE_M
        if best is None or np.count_nonzero(near) > np.count_nonzero(best):
            best = near
    if best is None:
        return None
    used = points[best]
    centre = used.mean(axis=0)
    along = np.linalg.svd(used - centre, full_matrices=False)[2][0]
    t = (used - centre) @ along
    if float(np.ptp(t)) * cell < _LEAST_FOLD_M:
        return None
    return centre, along, t


def _disc(radius: float, cell: float) -> NDArray[np.uint8]:
    size = 2 * round(radius / cell) + 1
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size)), dtype=np.uint8)
