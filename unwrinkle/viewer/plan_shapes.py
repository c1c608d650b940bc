"""Small meshes of a plan for a scene: the wrinkle, the approaches, the pulls. World frame, m."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.search.key_poses import approach_direction
from unwrinkle.viewer.shapes import Mesh, arrow, tube

#: Maximum length of a pull's arrow, m.
_PULL_ARROW = 0.13


@dataclass(frozen=True)
class Colours:
    """Colours (#rrggbb) of the scene; arms right and left, poses in order."""

    ridge: str
    outline: str
    grasp: str
    pull: str
    arms: tuple[str, str]
    poses: tuple[str, ...]


ARMS = ("right", "left")
COLOURS = Colours(
    ridge="#d50000",
    outline="#00838f",
    grasp="#00a152",
    pull="#ff6d00",
    arms=("#d81b60", "#1e88e5"),
    poses=("#440154", "#443983", "#31688e", "#21918c", "#35b779", "#90d743", "#fde725"),
)
#: Colour of a ridge line that is not pulled.
OTHER_RIDGE = "#fb8c00"
#: Length of a grasp's arrow, m.
_GRASP_ARROW = 0.11
#: Maximum number of ridge lines.
_SHOWN = 6


def wrinkle_shapes(plan: FlatteningPlan) -> Iterator[tuple[str, Mesh, str]]:
    """Yield path, mesh and colour of the ridge line and, if observed, of the contour."""
    garment = plan.garment
    if garment is None:
        target = plan.target
        along = 0.1 * np.append(target.wrinkle_direction, 0.0)
        ridge = target.p_WC + np.array([[0.0, 0.0, 0.004]]) + np.array([[-1.0], [1.0]]) * along
        yield "wrinkle", tube(ridge, 0.003), COLOURS.ridge
        return
    if len(garment.ridge) > 1:
        yield "wrinkle", tube(garment.ridge, 0.003), COLOURS.ridge
    if len(garment.outline) > 1:
        yield "outline", tube(garment.outline, 0.0015), COLOURS.outline


def ridge_shapes(
    curves: Sequence[NDArray[np.floating[Any]]], chosen: int | None
) -> Iterator[tuple[str, Mesh, str]]:
    """Yield path, mesh and colour of the largest wrinkles' ridge lines.

    Args:
        curves: (n, 3) points of each ridge line, largest wrinkle first.
        chosen: index of the wrinkle to be pulled; None for none.
    """
    for index, curve in enumerate(curves[:_SHOWN]):
        thinned = np.asarray(curve, dtype=float)[_spread(len(curve))]
        if len(thinned) > 1 and np.ptp(thinned, axis=0).max() > 0.0:
            colour = COLOURS.ridge if index == chosen else OTHER_RIDGE
            yield f"wrinkle {index + 1}", tube(thinned + [0.0, 0.0, 0.001], 0.003), colour


def _spread(count: int) -> NDArray[np.intp]:
    """Return at most 60 indices below a count, including the first and the last."""
    return np.unique(np.linspace(0, max(count - 1, 0), min(count, 60)).astype(np.intp))


def target_shapes(plan: FlatteningPlan) -> Iterator[tuple[str, Mesh, str]]:
    """Yield path, mesh and colour of each arm's approach and pull, drawn longer than true."""
    for name, choice in zip(ARMS, plan.arms, strict=True):
        if choice is None:
            continue
        hand = plan.target.hands[choice.side]
        direction = np.append(approach_direction(hand, choice.offset), 0.0)
        tip: NDArray[np.float64] = hand.p_WG + [0.0, 0.0, 0.008]
        start = tip - _GRASP_ARROW * direction
        grasp = arrow(start, tip, 0.004, head_radius=0.011, head_length=0.03)
        yield f"grasp/{name}", grasp, COLOURS.grasp
        pull = choice.share * hand.pull_distance
        if pull <= 0.0:
            continue
        # Drawn inside the grasp point and above the cloth, where the gripper does not hide it.
        along = np.append(hand.pull_direction, 0.0)
        end = hand.p_WG - 0.03 * along + [0.0, 0.0, 0.03]
        tail = end - pull_magnification(plan) * pull * along
        yield (
            f"pull/{name}",
            arrow(tail, end, 0.005, head_radius=0.014, head_length=0.03),
            COLOURS.pull,
        )


def pull_magnification(plan: FlatteningPlan) -> int:
    """Return the magnification of the pulls' arrows.

    It is 5, or less if they would exceed the maximum length.
    """
    longest = max(
        choice.share * plan.target.hands[choice.side].pull_distance
        for choice in plan.arms
        if choice is not None
    )
    return max(1, min(5, int(_PULL_ARROW / max(longest, 1e-6))))
