"""Pictures of a look for the report page.

The camera's image and the measured height, with marks over them.

The view is the robot's, with the robot at the lower edge: the world's y axis points down and its x
axis to the left. Marks are SVG over the picture, so that they stay sharp.
"""

import base64
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import InputError
from unwrinkle.models.transforms import inverse, transformed
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.perception.stereo.head_file import load_head_angles
from unwrinkle.runs.look_folder import LookFolder
from unwrinkle.viewer.plan_shapes import COLOURS, OTHER_RIDGE

#: Function from world points (n, 3) to pixels (n, 2) of a picture.
Projection = Callable[[Array], Array]

#: Width of a picture, pixels.
WIDTH = 520
#: Colour scale of the height, from the table up; also that of the legend.
RAMP = ("#f4f5ea", "#cbe6c3", "#72c4bf", "#2f80b9", "#21387f")
_TABLE = (226, 224, 220)
#: Quality of the JPEG images, 0 to 100.
_QUALITY = 82
#: Margin of a picture around the garment, m.
_MARGIN = 0.075
#: Share of a garment's cells that may lie outside each side of the pictures' rectangle, apart from
#: its margin.
_STRAY = 0.01
#: Length of the arrows in the pictures, m; independent of the pull, which is only a few
#: millimetres.
_ARROW = 0.07
#: Borders of layers and fold lines: colours, and height above the table at which they are drawn, m.
BORDER, FOLD_LINE = "#aa00ff", "#212121"
_FOLD_HEIGHT = 0.008
#: Maximum number of wrinkles drawn.
_LISTED = 6


@dataclass(frozen=True)
class Picture:
    """JPEG image with SVG marks over it.

    Attributes:
        jpeg: content of the file.
        width, height: size, pixels.
        marks: SVG elements in pixels.
    """

    jpeg: bytes
    width: int
    height: int
    marks: str = ""

    def html(self, caption: str) -> str:
        """Return a figure for a page."""
        data = base64.b64encode(self.jpeg).decode("ascii")
        text = escape(caption)
        return (
            f'<figure><div class="picture"><img alt="{text}" width="{self.width}" height="{self.height}" '
            f'src="data:image/jpeg;base64,{data}"><svg viewBox="0 0 {self.width} {self.height}" '
            f'preserveAspectRatio="xMidYMid slice">{self.marks}</svg></div><figcaption>{text}</figcaption></figure>'
        )


@dataclass(frozen=True)
class Window:
    """Rectangle of the table in world x, y, m, that fills a picture."""

    x_min: float
    x_max: float
    y_min: float
    y_max: float

    @classmethod
    def around(cls, maps: Iterable[RangeMap]) -> "Window":
        """Return the rectangle around the garment, with a margin.

        The median over the maps ignores outliers.

        Raises:
            InputError: no map has a garment.
        """
        found = []
        for range_map in maps:
            rows, columns = np.nonzero(range_map.garment)
            if len(rows):
                cells = np.quantile(
                    np.column_stack([columns, rows]), [_STRAY, 1.0 - _STRAY], axis=0
                )
                found.append(range_map.world_from_cell(cells))
        if not found:
            raise InputError("range maps: none has a garment")
        low, high = np.median(found, axis=0)
        (x_min, y_min), (x_max, y_max) = low - _MARGIN, high + _MARGIN
        return cls(float(x_min), float(x_max), float(y_min), float(y_max))

    @property
    def pixel(self) -> float:
        """Return the side of a pixel, m."""
        return (self.x_max - self.x_min) / WIDTH

    @property
    def shape(self) -> tuple[int, int]:
        """Return the rows and columns of the picture."""
        return max(2, round((self.y_max - self.y_min) / self.pixel)), WIDTH

    @property
    def corners(self) -> Array:
        """Return the corners (4, 2), m."""
        return np.array(
            [
                [self.x_min, self.y_min],
                [self.x_max, self.y_min],
                [self.x_max, self.y_max],
                [self.x_min, self.y_max],
            ]
        )

    def project(self, points: Array) -> Array:
        """Return the pixels (n, 2) of world points (n, 2) or (n, 3), m."""
        x, y = np.asarray(points, dtype=float)[:, :2].T
        return np.column_stack([self.x_max - x, y - self.y_min]) / self.pixel

    def sample(self, range_map: RangeMap, values: NDArray[Any]) -> NDArray[Any]:
        """Resample values (ny, nx[, 3]) of a map's cells to the picture's pixels.

        They are 0 outside the map.
        """
        rows, columns = self.shape
        c, r = np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5)
        points = np.column_stack(
            [self.x_max - self.pixel * c.ravel(), self.y_min + self.pixel * r.ravel()]
        )
        cells = range_map.cell_from_world(points).astype(np.float32)
        j, i = (cells[:, k].reshape(rows, columns) for k in range(2))
        sigma = 0.5 * self.pixel / range_map.resolution
        smooth = cv2.GaussianBlur(values, (0, 0), sigma) if sigma > 0.4 else values
        return np.asarray(cv2.remap(smooth, j, i, cv2.INTER_LINEAR, borderValue=0))


def top_height(maps: Iterable[RangeMap]) -> float:
    """Return the height at the upper end of the colour scale for all maps of a run, m.

    It is at least 10 mm.
    """
    tops = [0.010]
    for range_map in maps:
        on = range_map.garment & range_map.valid
        if on.any():
            tops.append(float(np.percentile(range_map.height[on], 99.7)))
    return max(tops)


def relief(range_map: RangeMap, window: Window, top: float, marks: str = "") -> Picture:
    """Draw the measured height: coloured up to `top` (m), lit from the upper left."""
    height = np.where(range_map.garment, range_map.height, 0.0).astype(np.float32)
    h = window.sample(range_map, height)
    on = window.sample(range_map, range_map.garment.astype(np.float32))[..., None]
    slope = np.gradient(h / window.pixel, axis=1) + np.gradient(h / window.pixel, axis=0)
    light = np.clip(0.93 + 0.75 * slope, 0.45, 1.12)[..., None]
    colours = np.clip(_ramp(h / top) * light, 0.0, 255.0)
    return _picture(on * colours + (1.0 - on) * np.array(_TABLE), marks)


def seen_from_above(range_map: RangeMap, window: Window, marks: str = "") -> Picture | None:
    """Draw the colours of the range map; None if it has none."""
    if range_map.colour is None:
        return None
    return _picture(window.sample(range_map, range_map.colour), marks)


def camera_picture(
    look: LookFolder, window: Window, table_height: float, data: dict[str, Any] | None
) -> Picture:
    """Draw the left camera's image around the window, with the marks of the analysis.

    Raises:
        InputError: the image or its angles are missing or damaged.
    """
    pixels = look.left_picture()
    record, calibration = load_head_angles(look.path / "head.yaml")
    head = calibration.stereo_head()
    camera = head.left.camera
    scale = pixels.shape[1] / camera.width
    X_CW = inverse(head.poses(record.gaze)[0])

    def whole(points: Array) -> Array:
        return np.asarray(camera.project(transformed(X_CW, points)) * scale)

    corners = np.column_stack([window.corners, np.full(4, table_height)])
    low, high = _crop(whole(corners), pixels.shape[1::-1], window.shape[0] / window.shape[1])
    part = pixels[low[1] : high[1], low[0] : high[0]]
    zoom = WIDTH / part.shape[1]
    rows = max(2, round(zoom * part.shape[0]))
    small = cv2.resize(part, (WIDTH, rows), interpolation=cv2.INTER_AREA)

    def project(points: Array) -> Array:
        return (whole(points) - low) * zoom

    return _picture(small, "" if data is None else analysis_marks(data, project))


def _crop(
    seen: Array, size: tuple[int, ...], aspect: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the first and last pixel (x, y) of a crop around points, of about an aspect."""
    whole = np.array(size)
    middle = 0.5 * (seen.min(axis=0) + seen.max(axis=0))
    width, height = np.ptp(seen, axis=0)
    half = 0.5 * np.array([max(width, height / aspect), max(height, width * aspect)])
    low = np.clip(np.floor(middle - half), 0, whole - 1).astype(np.int64)
    high = np.clip(np.ceil(middle + half), 1, whole).astype(np.int64)
    if np.any(high - low < 16):  # the points are outside the image: use all of it
        return np.zeros(2, dtype=np.int64), whole.astype(np.int64)
    return low, high


def analysis_marks(data: dict[str, Any], project: Projection, *, only_target: bool = False) -> str:
    """Draw an analysis as SVG: ridge lines with numbers, borders of layers, flaps with their fold
    lines and the directions they open in, and the target's grasps and pulls.

    Args:
        data: analysis as plain data, with points.
        project: projection to the picture's pixels.
        only_target: whether to leave out the other wrinkles, their numbers, borders and flaps.
    """
    target = data.get("target", {})
    marked = target.get("wrinkle")
    parts = [] if only_target else _fold_marks(data.get("garment", {}), project)
    for index, wrinkle in reversed(list(enumerate(data.get("wrinkles", [])[:_LISTED]))):
        if only_target and index != marked:
            continue
        curve = np.array(wrinkle.get("curve", []), dtype=float).reshape(-1, 3)
        if len(curve) < 2:
            continue
        pixels = project(curve)
        chosen = index == marked
        parts.append(
            _line(pixels, COLOURS.ridge if chosen else OTHER_RIDGE, 3.5 if chosen else 2.0)
        )
        if not only_target:
            parts.append(_number(pixels[-1], index + 1, COLOURS.ridge if chosen else OTHER_RIDGE))
    for hand in target.get("hands", []):
        p = np.array(hand["p_WG"])
        way, pull = (np.append(hand[f"{name}_direction"], 0.0) for name in ("grasp", "pull"))
        if np.dot(way, pull) < -0.5:  # the arrows would overlap: draw them side by side
            aside = 0.013 * np.array([-way[1], way[0], 0.0])
        else:
            aside = np.zeros(3)
        grasp = project(np.array([p - _ARROW * way + aside, p + aside]))
        parts.append(_arrow(grasp, COLOURS.grasp, dashed=True))
        parts.append(
            _arrow(project(np.array([p - aside, p - aside + _ARROW * pull])), COLOURS.pull)
        )
    return "".join(parts)


def _fold_marks(garment: dict[str, Any], project: Projection) -> list[str]:
    """Draw borders of layers and flaps."""
    height = garment.get("table_height", 0.0)

    def raised(points: Any) -> Array:
        flat = np.array(points, dtype=float).reshape(-1, 2)
        return np.column_stack([flat, np.full(len(flat), height + _FOLD_HEIGHT)])

    lines = [raised(line) for line in garment.get("borders", [])]
    parts = [_line(project(line), BORDER, 2.0) for line in lines if len(line) > 1]
    for flap in garment.get("flaps", []):
        line = raised(flap["line"])
        middle = line.mean(axis=0)
        parts.append(_line(project(line), FOLD_LINE, 2.5))
        opens = np.append(flap["opening"], 0.0)
        parts.append(_arrow(project(np.array([middle, middle + _ARROW * opens])), FOLD_LINE))
    return parts


def _picture(pixels: NDArray[Any], marks: str) -> Picture:
    rgb = np.clip(np.rint(pixels), 0, 255).astype(np.uint8)
    quality = [cv2.IMWRITE_JPEG_QUALITY, _QUALITY]
    done, data = cv2.imencode(".jpg", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), quality)
    if not done:
        raise RuntimeError("OpenCV cannot write JPEG")
    return Picture(data.tobytes(), rgb.shape[1], rgb.shape[0], marks)


def _ramp(share: NDArray[Any]) -> Array:
    stops = np.array([[int(c[i : i + 2], 16) for i in (1, 3, 5)] for c in RAMP], dtype=float)
    places = np.linspace(0.0, 1.0, len(stops))
    level = np.clip(share, 0.0, 1.0)
    return np.stack([np.interp(level, places, stops[:, k]) for k in range(3)], axis=-1)


def _line(pixels: Array, colour: str, width: float) -> str:
    points = " ".join(f"{x:.1f},{y:.1f}" for x, y in pixels)
    shared = f'points="{points}" fill="none" stroke-linecap="round" stroke-linejoin="round"'
    return (
        f'<polyline {shared} stroke="#fff" stroke-opacity="0.85" stroke-width="{width + 2.5}"/>'
        f'<polyline {shared} stroke="{colour}" stroke-width="{width}"/>'
    )


def _number(place: Sequence[float] | Array, number: int, colour: str) -> str:
    x, y = place
    return (
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="10" fill="#fff" stroke="{colour}" stroke-width="2"/>'
        f'<text x="{x:.1f}" y="{y + 4.5:.1f}" text-anchor="middle" font-size="13">{number}</text>'
    )


def _arrow(pixels: Array, colour: str, *, dashed: bool = False) -> str:
    a, b = pixels
    length = float(np.hypot(*(b - a)))
    if length < 1.0:
        return ""
    u = (b - a) / length
    n = np.array([-u[1], u[0]])
    neck = b - 15.0 * u
    head = " ".join(f"{x:.1f},{y:.1f}" for x, y in (b, neck + 7.0 * n, neck - 7.0 * n))
    ends = f'x1="{a[0]:.1f}" y1="{a[1]:.1f}" x2="{neck[0]:.1f}" y2="{neck[1]:.1f}"'
    dash = ' stroke-dasharray="7 4"' if dashed else ""
    return (
        f'<line {ends} stroke="#fff" stroke-opacity="0.85" stroke-width="6.5"/>'
        f'<line {ends} stroke="{colour}" stroke-width="4"{dash}/>'
        f'<polygon points="{head}" fill="{colour}" stroke="#fff" stroke-width="1.2"/>'
    )
