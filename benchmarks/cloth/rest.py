"""A simulated towel at rest, pulled, repeated and timed."""

import dataclasses as dc
import hashlib
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial

import numpy as np

from benchmarks.cloth.results import AfterPull, Cost, PullFigures, RestFigures, SameBits, SizeCost
from unwrinkle.models.cloth import load_material
from unwrinkle.models.errors import UnwrinkleError
from unwrinkle.simulation.cloth.cloth import Cloth, ClothState
from unwrinkle.simulation.cloth.fingers import carry, let_go, take
from unwrinkle.simulation.cloth.initial_states import Centre, ridge, start_state
from unwrinkle.simulation.cloth.measures import largest_height, measure, overstretch
from unwrinkle.simulation.cloth.outlines import outline
from unwrinkle.testing.table import TABLE

CENTRE: Centre = (0.0, -1.1)
# Direction across the wrinkle in degrees, slack in m.
WRINKLES = (
    (-45, 0.030),
    (-30, 0.025),
    (-20, 0.020),
    (-8, 0.030),
    (8, 0.025),
    (20, 0.030),
    (30, 0.020),
    (45, 0.025),
)
SHARES = (0.55, 0.8, 1.1)  # of the slack, by each hand
_FINGERPRINT = (
    "from benchmarks.cloth.rest import fingerprint; "
    "import sys; sys.stdout.write(fingerprint({nodes}, {seed}))"
)


def towel(nodes: int = 80, time_step: float = 1e-3) -> Cloth:
    """Return the terry towel on the working table."""
    return Cloth(outline("towel", nodes), load_material("terry"), TABLE, time_step=time_step)


def awake(state: ClothState) -> ClothState:
    """Return the state awake."""
    return dc.replace(state, asleep=False, quiet=0.0)


def pull_out(
    cloth: Cloth, state: ClothState, direction: float, offset: float, distance: float
) -> tuple[ClothState, float]:
    """Take the towel at both ends of the section across a ridge and pull each by `distance`, m.

    Returns:
        The state settled after release, and the overstretch at the end of the pull.
    """
    e = np.array([np.cos(direction), np.sin(direction), 0.0])
    rim = cloth.vertices(state)[cloth.boundary]
    local = rim - np.array([*CENTRE, 0.0]) - offset * e
    across, along = local @ e, np.abs(local @ np.array([-e[1], e[0], 0.0]))
    near = along < 1.2 * cloth.outline.spacing
    for hand, sign in enumerate((1.0, -1.0)):
        state = take(cloth, state, hand, rim[np.argmax(np.where(near, sign * across, -1.0))])
    up = np.array([0.0, 0.0, 0.01])
    state = carry(cloth, state, (up, up), 0.3)
    state = carry(cloth, state, (distance * e, -distance * e), 1.5)
    stretched = overstretch(cloth, state)
    state = carry(cloth, state, (-up, -up), 0.3)
    return cloth.settle(let_go(cloth, state)), stretched


def pulls(seed: int, count: int) -> tuple[PullFigures, ...]:
    """Flatten `count` single wrinkles with one action each, at several pulls."""
    cloth, rng, rows = towel(), np.random.default_rng(seed), []
    for degrees, slack in WRINKLES[:count]:
        direction, offset = np.radians(degrees), rng.uniform(-0.03, 0.03)
        begin = time.thread_time()
        start = ridge(cloth, CENTRE, direction, slack, offset=offset)
        still = cloth.advance(awake(start), 1.0)
        after = {}
        for share in SHARES:
            end, stretched = pull_out(cloth, start, direction, offset, share * slack)
            after[f"{share:g}"] = AfterPull(
                **measure(cloth, end).to_json(), stretch_in_pull=stretched, asleep=end.asleep
            )
        rows.append(
            PullFigures(
                direction=direction,
                slack=slack,
                offset=offset,
                height=largest_height(cloth, start),
                settled_after=start.time,
                creep=float(np.abs(still.positions - start.positions).max()),
                after=after,
                cpu=time.thread_time() - begin,
            )
        )
    return tuple(rows)


def rest(seed: int) -> tuple[RestFigures, ...]:
    """Wake settled states: does anything grow, is the cloth as long and as wide as it was made?"""
    cloth, rows = towel(), []
    rng = np.random.default_rng(seed)
    masses = cloth.material.areal_density * cloth.outline.area / len(cloth.numbers)
    for name in ("flat", "ridge", "bunched"):
        state = start_state(cloth, name, CENTRE, seed)
        grid = state.positions.reshape(3, *cloth.shape)
        corners = cloth.vertices(state)[cloth.triangles]
        area = (
            0.5
            * np.linalg.norm(
                np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
            ).sum()
        )
        lengths = [
            np.linalg.norm(np.diff(grid, axis=axis), axis=0).sum(axis=axis - 1) for axis in (1, 2)
        ]
        made = (np.array(cloth.shape) - 1) * cloth.outline.spacing
        strain = max(float(np.abs(v / m - 1.0).max()) for v, m in zip(lengths, made, strict=True))
        later = cloth.advance(awake(state), 2.0)
        kicked = dc.replace(awake(state), velocities=rng.normal(0.0, 0.02, state.velocities.shape))
        energies = [_kinetic(kicked, masses)]
        for _ in range(50):
            kicked = awake(cloth.advance(kicked, 0.02))
            energies.append(_kinetic(kicked, masses))
        rows.append(
            RestFigures(
                state=name,
                asleep=state.asleep,
                area_error=float(area / cloth.outline.area - 1.0),
                yarn_error=strain,
                moved_in_2s=float(np.abs(later.positions - state.positions).max()),
                kinetic_after_2s=_kinetic(later, masses),
                kick=energies[0],
                kick_after_20ms=energies[1],
                kick_largest_later=max(energies[2:]),
                kick_after_1s=energies[-1],
            )
        )
    return tuple(rows)


def _kinetic(state: ClothState, mass: float) -> float:
    """Kinetic energy with one mass for every node, J."""
    return float(0.5 * mass * (state.velocities**2).sum())


def fingerprint(nodes: int, seed: int) -> str:
    """Return a hash of every bit of a bunched towel."""
    state = start_state(towel(nodes), "bunched", CENTRE, seed)
    parts = (state.positions, state.velocities, state.curvatures)
    return hashlib.sha256(b"".join(part.tobytes() for part in parts)).hexdigest()


def same_bits(nodes: int, seed: int) -> SameBits:
    """Make a bunched towel in two new processes and compare every bit."""
    found = []
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, "-c", _FINGERPRINT.format(nodes=nodes, seed=seed)],
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode != 0:
            raise UnwrinkleError(f"a bunched towel could not be made: {done.stderr[-300:]}")
        found.append(done.stdout)
    return SameBits(nodes, seed, tuple(found), found[0] == found[1])


def cost(sizes: tuple[int, ...], rounds: int, seed: int) -> Cost:
    """Measure CPU seconds of this thread per simulated second; sizes in turn, so that all see one load.

    On the table: a ridge, kept awake. Pulled: two hands 0.1 m/s apart, one up. Folded: a dropped
    towel, kept awake. Asleep: a call that does nothing.
    """
    cases: dict[int, dict[str, Callable[[], object]]] = {}
    heights: dict[int, float] = {}
    for nodes in sizes:
        cloth = towel(nodes)
        lying = ridge(cloth, CENTRE, 0.35, 0.025)
        held = lying
        for hand, sign in enumerate((1.0, -1.0)):
            held = take(cloth, held, hand, (CENTRE[0] + sign * 0.2, CENTRE[1], cloth.flat_height))
        folded = start_state(cloth, "dropped", CENTRE, seed)
        heights[nodes] = largest_height(cloth, folded)
        cases[nodes] = {
            "lying": partial(_awake_for, cloth, lying, 0.1),
            "pulled": partial(carry, cloth, held, ((0.01, 0.0, 0.01), (-0.01, 0.0, 0.0)), 0.1),
            "folded": partial(_awake_for, cloth, folded, 0.1),
            "asleep": partial(cloth.advance, lying, 0.1),
        }
    times: dict[int, dict[str, list[float]]] = {n: {k: [] for k in cases[n]} for n in sizes}
    for _ in range(rounds):
        for nodes in sizes:
            for name, case in cases[nodes].items():
                begin = time.thread_time()
                case()
                times[nodes][name].append(10.0 * (time.thread_time() - begin))
    rows = [
        SizeCost(n, heights[n], **{name: float(np.median(v)) for name, v in times[n].items()})
        for n in sizes
    ]
    growth = np.polyfit(np.log(sizes), np.log([row.lying for row in rows]), 1)[0]
    return Cost(tuple(rows), float(growth), rounds)


def _awake_for(cloth: Cloth, state: ClothState, duration: float) -> ClothState:
    for _ in range(round(duration / 0.02)):
        state = cloth.advance(awake(state), 0.02)
    return state
