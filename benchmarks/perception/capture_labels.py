"""What is on the real captures, by eye: states, ridges and flaps."""

import json
import math
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

import cv2
import numpy as np
from numpy.typing import NDArray

from unwrinkle.perception.wrinkles.wrinkle import Wrinkle

#: A found ridge is a labelled one if it passes this near its centre, m, and is turned less, degrees.
_NEAR_M = 0.020
_TURN_DEG = 22.0


@dataclass(frozen=True)
class RidgeLabel:
    """A ridge: what it is, centre (2,), m, angle from x, degrees, length that was seen, m."""

    what: str
    centre: tuple[float, float]
    angle: float
    length: float


@dataclass(frozen=True)
class CaptureLabels:
    """Labels of a capture, laid on the table without a turn.

    Attributes:
        state: of the garment.
        ridges: that were judged.
        flaps: polygons (n, 2), m.
    """

    state: str
    ridges: tuple[RidgeLabel, ...]
    flaps: tuple[NDArray[np.float64], ...]

    def of(self, wrinkle: Wrinkle) -> str | None:
        """Return what a found ridge is; None if it was not judged."""
        angle = math.degrees(math.atan2(wrinkle.direction[1], wrinkle.direction[0]))
        near = []
        for ridge in self.ridges:
            apart = float(np.hypot(*(wrinkle.curve[:, :2] - ridge.centre).T).min())
            turn = abs((angle - ridge.angle + 90.0) % 180.0 - 90.0)
            if apart < _NEAR_M and turn < _TURN_DEG:
                near.append((apart, ridge.what))
        return min(near)[1] if near else None

    def on_flap(self, point: NDArray[np.float64]) -> bool:
        """Whether a point (x, y), m, lies on a flap."""
        x, y = float(point[0]), float(point[1])
        return any(
            cv2.pointPolygonTest(flap.astype(np.float32), (x, y), False) > 0 for flap in self.flaps
        )


@cache
def capture_labels() -> dict[str, CaptureLabels]:
    """Return the labels of the captures by their path in the data folder."""
    text = files("benchmarks.perception").joinpath("capture_labels.json").read_text("utf-8")
    return {
        path: CaptureLabels(
            each["state"],
            tuple(
                RidgeLabel(r["what"], (r["centre"][0], r["centre"][1]), r["angle"], r["length"])
                for r in each["ridges"]
            ),
            tuple(np.array(flap, dtype=float) for flap in each.get("flaps", [])),
        )
        for path, each in json.loads(text).items()
    }
