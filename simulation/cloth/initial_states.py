"""Initial states of a simulated garment: flat, with a ridge, bunched, pinched or dropped; folded
ones are in `folded_states`.
"""

import dataclasses as dc
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from unwrinkle.models.errors import InputError
from unwrinkle.models.scenario import FOLDED_STARTS, STARTS
from unwrinkle.simulation.cloth.cloth import Cloth
from unwrinkle.simulation.cloth.fingers import carry, let_go, take
from unwrinkle.simulation.cloth.folded_states import folded_state
from unwrinkle.simulation.cloth.measures import overstretch
from unwrinkle.simulation.cloth.state import ClothState

Centre = tuple[float, float]

#: Rest speed between one push and the next, m/s.
_REST_SPEED_M_S = 5e-3

#: Limit of attempts at a push.
_MAX_TRIES = 20

#: Overstretch above which cloth counts as locked in its own folds.
_MAX_OVERSTRETCH = 0.015


def ridge(
    cloth: Cloth,
    centre: Centre,
    direction: float,
    slack: float = 0.025,
    base: float = 0.045,
    offset: float = 0.0,
) -> ClothState:
    """Return the settled cloth with one straight ridge across it.

    The cloth is laid over a raised cosine of arc length base + slack, without stretch and without
    plastic bending.

    Args:
        cloth: the cloth.
        centre: world x, y of the flat garment's centre, m.
        direction: angle from world x of the direction across the ridge, in which to pull, rad.
        slack: excess length of cloth in the ridge, m.
        base: width of the ridge before it settles, m.
        offset: distance of the ridge from the garment's centre, m.

    Raises:
        InputError: a dimension is out of range, or the ridge is not on the cloth.
    """
    values = (direction, slack, base, offset)
    if not np.isfinite(values).all() or slack <= 0.0 or base <= 0.0 or slack > 2.0 * base:
        raise InputError(
            f"ridge: direction {direction}, slack {slack}, base {base}, offset {offset}; give "
            "finite values, slack and base above 0 and slack at most twice the base"
        )
    flat = cloth.flat(centre)
    e = np.array([np.cos(direction), np.sin(direction)])
    plane = cloth.outline.plane.reshape(-1, 2)
    across = plane @ e - offset
    s, x, z = _raised_cosine(slack, base)
    among = across[cloth.numbers]
    if among.min() > -s[-1] or among.max() < s[-1]:
        raise InputError(
            f"ridge: at offset {offset:g} m it hangs over the border of the "
            f"{cloth.outline.name}; give an offset nearer to 0"
        )
    flattened = np.where(
        np.abs(across) < s[-1], np.interp(across, s, x), across - np.sign(across) * 0.5 * slack
    )
    positions = flat.positions.copy()
    positions[:2] += np.outer(e, flattened - across)
    positions[2] += np.interp(across, s, z, left=0.0, right=0.0)
    return cloth.settle(dc.replace(flat, positions=positions, asleep=False))


def bunched(cloth: Cloth, centre: Centre, seed: int, pinches: int = 5) -> ClothState:
    """Return the cloth after two fingers pushed it together at `pinches` random places.

    It is nearly as wide as flat, with two to four crossing wrinkles, 20 to 30 mm high on a towel. A
    push that locks the cloth in its own folds is undone and redrawn: self-contact is between
    vertices and triangles without edges, so that such knots do not open as those of a towel do.

    Raises:
        InputError: bad centre, seed or number of pinches.
        ClothError: the solver failed.
    """
    rng, state = _begin(cloth, centre, seed, pinches)
    reach = 0.17 / 0.24  # of the half size: the towel's border is left alone
    half = 0.5 * np.ptp(cloth.rest, axis=0)
    for _ in range(pinches):
        for _ in range(_MAX_TRIES):
            middle = rng.uniform(-reach * half, reach * half)
            angle, apart = rng.uniform(0.0, np.pi), rng.uniform(0.08, 0.14)
            closing = rng.uniform(0.025, 0.05)
            e = np.array([np.cos(angle), np.sin(angle)])
            # Fingertips touch the cloth; higher points are preferred.
            points = [_under(cloth, state, middle + sign * 0.5 * apart * e) for sign in (1, -1)]
            if any(point is None for point in points):
                continue
            push = 0.5 * closing * np.append(e, 0.0)
            bunch = _pushed_together(cloth, state, points, push)
            if overstretch(cloth, bunch) <= _MAX_OVERSTRETCH:
                state = bunch
                break
    return cloth.settle(state)


def _pushed_together(
    cloth: Cloth, state: ClothState, points: list[Any], push: NDArray[np.float64]
) -> ClothState:
    """Return the cloth after two fingers at points (3,), m, moved by -push and +push (3,), m."""
    for hand, point in enumerate(points):
        state = take(cloth, state, hand, point)
    up = np.array([0.0, 0.0, 0.004])
    state = carry(cloth, state, (up, up), 0.1)
    state = carry(cloth, state, (-push, push), 0.5)
    state = carry(cloth, state, (-up, -up), 0.1)
    return cloth.settle(let_go(cloth, state), 1.0, _REST_SPEED_M_S)


def pinched(cloth: Cloth, centre: Centre, seed: int, pinches: int = 5) -> ClothState:
    """Return the folded cloth after it was lifted and dragged inwards at `pinches` random points.

    Raises:
        InputError: bad centre, seed or number of pinches.
        ClothError: the solver failed.
    """
    rng, state = _begin(cloth, centre, seed, pinches)
    for _ in range(pinches):
        vertices = cloth.vertices(state)
        point = vertices[rng.integers(len(vertices))]
        inwards = vertices[:, :2].mean(axis=0) - point[:2]
        angle = np.arctan2(inwards[1], inwards[0]) + rng.uniform(-0.7, 0.7)
        lift, drag = rng.uniform(0.03, 0.07), rng.uniform(0.05, 0.11)
        state = take(cloth, state, 0, point)
        state = carry(cloth, state, ((0.0, 0.0, lift), None), 0.4)
        move = (drag * np.cos(angle), drag * np.sin(angle), 0.0)
        state = carry(cloth, state, (move, None), 0.8)
        state = carry(cloth, state, ((0.0, 0.0, -0.8 * lift), None), 0.4)
        state = cloth.settle(let_go(cloth, state), 1.5, _REST_SPEED_M_S)
    return cloth.settle(state)


def dropped(cloth: Cloth, centre: Centre, seed: int, height: float = 0.22) -> ClothState:
    """Return the cloth lifted at a random point, lowered to a quarter of the height and dropped.

    Raises:
        InputError: bad centre, seed or height (m; 0.05 to 0.5).
        ClothError: the solver failed.
    """
    rng, state = _begin(cloth, centre, seed, 1)
    if not (np.isfinite(height) and 0.05 <= height <= 0.5):
        raise InputError(f"dropped: height {height:g} m; give 0.05 to 0.5")
    vertices = cloth.vertices(state)
    point = vertices[rng.integers(len(vertices))]
    state = take(cloth, state, 0, point)
    state = carry(cloth, state, ((0.0, 0.0, height), None), 1.2)
    home = np.append(np.asarray(centre) - point[:2], 0.0)
    state = carry(cloth, state, (home, None), 0.6)
    state = carry(cloth, state, ((0.0, 0.0, -0.75 * height), None), 0.8)
    return cloth.settle(let_go(cloth, state), 5.0)


def start_state(cloth: Cloth, name: str, centre: Centre, seed: int) -> ClothState:
    """Return a settled initial state by its name, at time 0.

    The direction, slack and offset of a ridge are drawn from the seed.

    Raises:
        InputError: unknown name, bad centre or seed.
        ClothError: the solver failed.
    """
    if name == "flat":
        _begin(cloth, centre, seed, 1)
        state = cloth.flat(centre)
    elif name == "ridge":
        rng, _ = _begin(cloth, centre, seed, 1)
        direction = rng.uniform(-0.25 * np.pi, 0.25 * np.pi)
        slack, offset = rng.uniform(0.020, 0.030), rng.uniform(-0.03, 0.03)
        state = ridge(cloth, centre, direction, slack, offset=offset)
    elif name == "bunched":
        state = bunched(cloth, centre, seed)
    elif name == "pinched":
        state = pinched(cloth, centre, seed)
    elif name == "dropped":
        state = dropped(cloth, centre, seed)
    elif name in FOLDED_STARTS:
        _begin(cloth, centre, seed, 1)
        state = folded_state(cloth, name, centre, seed)
    else:
        raise InputError(f"no start is called {name!r}; try one of {', '.join(STARTS)}")
    return dc.replace(state, time=0.0)


def _begin(
    cloth: Cloth, centre: Centre, seed: int, pinches: int
) -> tuple[np.random.Generator, ClothState]:
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise InputError(f"wrinkles: seed {seed!r}; give a whole number, 0 or more")
    if not 1 <= pinches <= 50:
        raise InputError(f"wrinkles: {pinches} pinches; give 1 to 50")
    return np.random.default_rng(seed), cloth.flat(centre)


def _under(
    cloth: Cloth, state: ClothState, offset: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    """Return the cloth's point (3,), m, under a finger at an offset (2,), or None."""
    vertices = cloth.vertices(state)
    place = vertices[:, :2].mean(axis=0) + offset
    distance = np.hypot(*(vertices[:, :2] - place).T) - 0.2 * (vertices[:, 2] - cloth.flat_height)
    nearest = int(distance.argmin())
    return vertices[nearest] if distance[nearest] < 2.0 * cloth.outline.spacing else None


def _raised_cosine(
    slack: float, base: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return (s, x, z), m, of z = A/2 (1 + cos(2 pi x / base)) of arc length base + slack.

    s is the arc length from the top.
    """
    x = np.linspace(-0.5 * base, 0.5 * base, 4001)
    shape = 0.5 * (1.0 + np.cos(2.0 * np.pi * x / base))

    def lengths(height: float) -> NDArray[np.float64]:
        return np.hypot(np.diff(x), height * np.diff(shape))

    height = brentq(lambda a: float(lengths(a).sum()) - base - slack, 0.0, base + slack)
    s = np.append(0.0, np.cumsum(lengths(height)))
    return s - 0.5 * s[-1], x, height * shape
