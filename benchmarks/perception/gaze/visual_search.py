"""Visual search in rendered pictures of the table: two towels of a kind, another one, a marker."""

from __future__ import annotations

import time
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.arrays import Pose
from unwrinkle.models.transforms import inverse, transformed, turn
from unwrinkle.perception.features import Template, template, view
from unwrinkle.perception.gaze.visual_search import Instance, search
from unwrinkle.perception.stereo.head_file import nominal_head
from unwrinkle.simulation.rendering.image_noise import oversized, photograph
from unwrinkle.simulation.rendering.meshes import rectangle_mesh, towel_mesh
from unwrinkle.simulation.rendering.renderer import Renderer
from unwrinkle.simulation.rendering.synthetic_towel import Ridge, Towel
from unwrinkle.simulation.rendering.textures import Texture
from unwrinkle.testing.table import TABLE

FACTOR = 4
_MOST = 6000
_SIDE, _MARKER_SIDE = 0.22, 0.08
_SLOT = 0.19  # metres from the table's middle to the middles of its quarters
_AWAY = np.array([0.0, 0.0, -20.0])
_HIT = 0.01  # metres; a find this near to a thing's middle is it
_NAMES = {"towel 1": "towel", "towel 2": "towel", "other": "other", "marker": "marker"}
_SIDES = {"towel 1": _SIDE, "towel 2": _SIDE, "other": _SIDE, "marker": _MARKER_SIDE}


class SearchScene:
    """The table with things that can be moved, seen by the head's left eye."""

    def __init__(self, seed: int) -> None:
        """Make the things; the two towels have one print and different wrinkles."""
        rng = np.random.default_rng(seed)
        code = rng.integers(0, 2, (9, 9)).astype(np.uint8) * 200 + 25
        printed = cv2.resize(code, (288, 288), interpolation=cv2.INTER_NEAREST)
        marker = Texture(np.dstack([printed] * 3))
        items = [
            towel_mesh(_towel(seed + k), kind, name=name, seed=seed + cloth)
            for k, (name, kind, cloth) in enumerate(
                (("towel 1", "print", 0), ("towel 2", "print", 0), ("other", "print", 1))
            )
        ]
        items.append(rectangle_mesh("marker", (_MARKER_SIDE, _MARKER_SIDE), marker))
        self._renderer = Renderer(TABLE, items)
        self._head = nominal_head()
        self._seed = seed
        self._gaze = self._head.gaze_at(TABLE.top_centre)
        self.places: dict[str, Pose] = {}

    def lay(self, places: dict[str, Pose]) -> None:
        """Put things at poses X_WM; the others are taken away."""
        self.places = places
        gone = np.eye(4)
        gone[:3, 3] = _AWAY
        for name in _NAMES:
            self._renderer.move(name, places.get(name, gone))

    def photograph(self) -> NDArray[np.uint8]:
        """Take the left eye's picture."""
        self._seed += 1
        camera, wide = self._head.left.camera, oversized(self._head.left.camera)
        X_WL, _ = self._head.poses(self._gaze)
        return photograph(self._renderer.colour(wide, X_WL), wide, camera, seed=self._seed)

    def pixels(self, name: str, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Pixels (n, 2) of points (n, 3) of a thing."""
        X_WL, _ = self._head.poses(self._gaze)
        p_W = transformed(self.places[name], points)
        return self._head.left.camera.project(transformed(inverse(X_WL), p_W))

    def learn(self, name: str) -> Template:
        """Template of a thing that lies alone."""
        half = 0.47 * _SIDES[name]
        square = np.array([[-half, -half, 0], [half, -half, 0], [half, half, 0], [-half, half, 0]])
        hull = cv2.convexHull(np.rint(self.pixels(name, square)).astype(np.int32))
        camera = self._head.left.camera
        mask = np.zeros((camera.height, camera.width), dtype=np.uint8)
        cv2.fillConvexPoly(mask, np.asarray(hull), 1)
        seen = view(self.photograph(), factor=FACTOR, most=_MOST)
        middle = self.pixels(name, np.zeros((1, 3)))[0]
        return template(seen, _NAMES[name], mask=mask > 0, point=middle)

    def found(self, instance: Instance) -> str | None:
        """Which thing a find is of; None if of none."""
        for name in self.places:
            middle, beside = self.pixels(name, np.array([[0.0, 0.0, 0.0], [_HIT, 0.0, 0.0]]))
            off = float(np.linalg.norm(instance.centre - middle))
            if instance.name == _NAMES[name] and off < np.linalg.norm(beside - middle):
                return name
        return None


def _towel(seed: int) -> Towel:
    rng = np.random.default_rng(seed)
    ridge = Ridge(
        centre=(float(rng.uniform(-0.03, 0.03)), -1.1 + float(rng.uniform(-0.03, 0.03))),
        angle=float(rng.uniform(0.0, np.pi)),
        height=0.012,
        sigma=0.010,
        length=0.12,
    )
    return Towel(ridges=(ridge,), side=_SIDE, corner=0.008, seed=seed)


def _placed(off: NDArray[np.float64], yaw: float) -> Pose:
    X_WM = turn("z", yaw)
    X_WM[:3, 3] = TABLE.top_centre + [off[0], off[1], 0.0005]
    return X_WM


@dataclass(frozen=True)
class SearchFigures:
    """Visual search.

    Attributes:
        scenes: pictures.
        things: that lay there; found: finds that are of one; wrong: finds that are of none.
        time_median: of a picture, finding its features included, s.
    """

    scenes: int
    things: int
    found: int
    wrong: int
    time_median: float


def search_results(seed: int, scenes: int) -> SearchFigures:
    """Lay things at random, `scenes` times, and look for them."""
    table = SearchScene(seed)
    rng = np.random.default_rng(seed)
    templates = []
    for name in ("towel 1", "other", "marker"):
        table.lay({name: _placed(np.zeros(2), 0.0)})
        templates.append(table.learn(name))
    things = found = wrong = 0
    times = []
    for _ in range(scenes):
        slots = rng.permutation([[a, b] for a in (-_SLOT, _SLOT) for b in (-_SLOT, _SLOT)])
        jitter = rng.uniform(-0.02, 0.02, (4, 2))
        yaws = rng.uniform(-np.pi, np.pi, 4)
        places = {
            name: _placed(slot + off, float(yaw))
            for name, slot, off, yaw in zip(_NAMES, slots, jitter, yaws, strict=True)
        }
        table.lay(places)
        picture = table.photograph()
        start = time.perf_counter()
        instances = search(view(picture, factor=FACTOR, most=_MOST), templates)
        times.append(time.perf_counter() - start)
        owners = [table.found(instance) for instance in instances]
        hits = {owner for owner in owners if owner is not None}
        things += len(places)
        found += len(hits)
        wrong += len(owners) - len(hits)
    return SearchFigures(
        scenes=scenes, things=things, found=found, wrong=wrong, time_median=float(np.median(times))
    )
