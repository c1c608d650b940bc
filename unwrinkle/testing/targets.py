"""Flattening targets, and the planning benchmark's set of them: fixed and seeded."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from unwrinkle.models.choices import PullReading
from unwrinkle.perception.target import FlatteningTarget, HandTarget

#: The paper's eight wrinkle directions, degrees.
DIRECTIONS = tuple(np.linspace(-45.0, 45.0, 8))
#: Garment centres, world x and y.
CENTRES = ((0.0, -1.05), (0.0, -1.10), (0.0, -1.15), (-0.10, -1.10), (0.10, -1.10))


@dataclass(frozen=True)
class Task:
    """A target and the set it belongs to: forward, lateral or wide."""

    group: str
    target: FlatteningTarget


def flattening_task(
    centre: tuple[float, float],
    phi: float,
    *,
    half: float = 0.24,
    pull: float = 0.03,
    errors: tuple[float, float] = (0.0, 0.0),
    table_height: float = 0.70,
) -> FlatteningTarget:
    """Make a target on a flat garment.

    Args:
        centre: of the wrinkle, world x and y, m.
        phi: direction of the wrinkle from the robot's forward (-y), counter-clockwise from above,
            rad.
        half: distance of each grasp point from the centre, m.
        pull: of each hand, m.
        errors: angles of each hand's grasp direction off the pull's line (contour normal), rad.
        table_height: world z, m.
    """
    n = np.array([np.cos(phi), np.sin(phi)])
    hands = []
    for side, error in zip((-1.0, 1.0), errors, strict=True):
        outward = side * n
        c, s = np.cos(error), np.sin(error)
        grasp = -np.array([c * outward[0] - s * outward[1], s * outward[0] + c * outward[1]])
        p = np.array([centre[0] + half * outward[0], centre[1] + half * outward[1], table_height])
        hands.append(HandTarget(p, grasp, outward, pull))
    return FlatteningTarget(
        hands=(hands[0], hands[1]),
        p_WC=np.array([centre[0], centre[1], table_height]),
        wrinkle_direction=np.array([n[1], -n[0]]),
        geodesic_distance=2.0 * half + 2.0 * pull,
        mode=PullReading.FOOT,
    )


def tasks(seed: int, *, quick: bool = False) -> list[Task]:
    """Return the fixed set: 8 directions x 5 centres in both readings of the paper's angles, and 40
    over +-90 degrees.
    """
    rng = np.random.default_rng(seed)

    def shape() -> dict[str, Any]:
        errors = tuple(np.radians(rng.uniform(-25.0, 25.0, 2)))
        return {"half": rng.uniform(0.20, 0.26), "pull": rng.uniform(0.005, 0.03), "errors": errors}

    out = []
    for group, turn in (("forward", 0.0), ("lateral", 90.0)):
        for centre in CENTRES:
            for direction in DIRECTIONS:
                phi = np.radians(direction + turn)
                out.append(Task(group, flattening_task(centre, phi, **shape())))
    for _ in range(40):
        centre = (rng.uniform(-0.1, 0.1), rng.uniform(-1.3, -1.0))
        phi = rng.uniform(-0.5 * np.pi, 0.5 * np.pi)
        out.append(Task("wide", flattening_task(centre, phi, **shape())))
    return out[::6] if quick else out
