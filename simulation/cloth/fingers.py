"""Manipulation of a simulated cloth without a robot: take at a point, carry, let go."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from unwrinkle.models.errors import InputError
from unwrinkle.simulation.cloth.cloth import Cloth
from unwrinkle.simulation.cloth.state import ClothState

#: Time between the poses of the hands, s.
STEP = 0.020
Displacement = NDArray[np.floating[Any]] | Sequence[float] | None


def take(
    cloth: Cloth, state: ClothState, hand: int, p_W: NDArray[np.floating[Any]] | Sequence[float]
) -> ClothState:
    """Grip the cloth at a world point (3,), m, with a tool of the world's orientation.

    Raises:
        InputError: bad point, unknown hand, or the hand holds cloth already.
    """
    X_WT = np.eye(4)
    X_WT[:3, 3] = p_W
    return cloth.grip(state, hand, X_WT)


def carry(
    cloth: Cloth, state: ClothState, moves: tuple[Displacement, Displacement], duration: float
) -> ClothState:
    """Move the held cloth by displacements (3,), m, from rest to rest; return the final state.

    Args:
        cloth: the cloth.
        state: its state.
        moves: displacement of the right and the left hand; None for no motion.
        duration: s, a multiple of 20 ms.

    Raises:
        InputError: the duration is not a multiple of 20 ms, or a hand is too fast.
        ClothError: the solver failed.
    """
    count = round(duration / STEP)
    if count < 1 or abs(count * STEP - duration) > 1e-9:
        raise InputError(f"carry: duration {duration} s; give a multiple of {STEP} s")
    begin = [None if grip is None else grip.X_WT for grip in state.grips]
    for k in range(1, count + 1):
        part = k / count
        part *= part * (3.0 - 2.0 * part)
        hands: list[NDArray[np.float64] | None] = [None, None]
        for hand in (0, 1):
            pose, move = begin[hand], moves[hand]
            if pose is not None and move is not None:
                moved = pose.copy()
                moved[:3, 3] += part * np.asarray(move, dtype=float)
                hands[hand] = moved
        state = cloth.advance(state, STEP, hands)
    return state


def let_go(cloth: Cloth, state: ClothState) -> ClothState:
    """Open both hands."""
    return cloth.release(cloth.release(state, 0), 1)
