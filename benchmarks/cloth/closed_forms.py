"""A simulated cloth against closed forms: cantilever, stretch, shear, sag, incline."""

import dataclasses as dc

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_bvp
from scipy.optimize import brentq

from benchmarks.cloth.results import Cantilever, Checks, Incline, Sag, Shear, Stretch
from unwrinkle.models.cloth import ClothMaterial, load_material
from unwrinkle.models.table import Table
from unwrinkle.simulation.cloth.cloth import Cloth, ClothState
from unwrinkle.simulation.cloth.outlines import Outline

G = 9.81  # m/s^2
AWAY = Table((50.0, 50.0), (0.5, 0.5), 0.7)  # a table out of the way
_HEIGHT = 1.0  # m above the floor, for what hangs
_CALM = {"air_drag": 30.0}  # loaded so slowly that it does not swing beyond its rest


def patch(nx: int, ny: int, spacing: float) -> Outline:
    """Return a rectangle of cloth."""
    return Outline("patch", np.ones((nx, ny), dtype=bool), spacing)


def laid_out(cloth: Cloth) -> ClothState:
    """Return the cloth flat in the air, its first column of nodes at x = 0, y = 0 in its middle."""
    plane = cloth.outline.plane.reshape(-1, 2)
    positions = np.vstack([plane.T, np.full(cloth.size, _HEIGHT)])
    positions[0] -= positions[0].min()
    zeros = np.zeros((3, cloth.size))
    return ClothState(0.0, positions, zeros, np.zeros((4, cloth.size)))


def cantilever(material: ClothMaterial, overhang: float, spacing: float = 0.003) -> Cantilever:
    """Peirce's test: a wide strip held at one end; tip and bending length, simulated and exact.

    The exact shape is the heavy elastica's, with the material's own moment (elastic and slipping).
    Peirce's bending length is L (cos(t/2) / (8 tan t))^(1/3) with t the angle of the tip below the
    edge (Peirce 1930; ASTM D1388).
    """
    nx, ny = round(overhang / spacing) + 2, round(0.20 / spacing)
    calm = material.changed(**_CALM)
    step = _step(calm, spacing)
    cloth = Cloth(patch(nx, ny, spacing), calm, AWAY, time_step=step, clamped=range(2 * ny))
    state = cloth.settle(laid_out(cloth), 6.0, 5e-4)
    grid = state.positions.reshape(3, nx, ny)[:, :, ny // 2]
    # The bending at the second column has turned the first free piece already: the clamp is half
    # before it.
    length = (nx - 1.5) * spacing
    edge = 0.5 * spacing
    drop, out = float(_HEIGHT - grid[2, -1]), float(grid[0, -1] - edge)
    exact_out, exact_drop = _elastica(material, length)
    found, exact = (
        _bending_length(length, drop, out),
        _bending_length(length, exact_drop, exact_out),
    )
    return Cantilever(
        bending=material.first_bending,
        plastic=material.plastic_bending > 0.0,
        overhang=length,
        tip_drop=drop,
        tip_drop_exact=exact_drop,
        bending_length=found,
        bending_length_exact=exact,
        bending_length_material=(
            (material.first_bending / (material.areal_density * G)) ** (1 / 3)
        ),
        error=found / exact - 1.0,
        asleep=state.asleep,
    )


def stretch(material: ClothMaterial) -> Stretch:
    """Ten times its weight along a strip held at one end: lengthening against weight * L / (2 E).

    With free sides, E = Y + k Y / (Y + k) for yarns Y and diagonals k: these resist a little too.
    """
    nx, ny, h, pull = 61, 13, 0.004, 10.0 * G
    material = material.changed(**_CALM)
    cloth = Cloth(patch(nx, ny, h), material, AWAY, gravity=(pull, 0.0, 0.0), clamped=range(ny))
    state = cloth.settle(laid_out(cloth), 4.0, 2e-4)
    grid = state.positions.reshape(3, nx, ny)
    length = (nx - 1) * h
    found = float(grid[0, -1].mean() - grid[0, 0].mean()) - length
    y, k = material.stretch, material.shear
    exact = material.areal_density * pull * length**2 / (2.0 * (y + k * y / (y + k)))
    return Stretch(stretch=y, found=found, exact=exact, error=found / exact - 1.0)


def shear(material: ClothMaterial) -> Shear:
    """Its weight along the free edge of a short, wide strip: slip of that edge against weight * L /
    (2 G).

    The yarns are made 20 times as stiff: it would bend in its plane, and its ends lag, by 2-3 %
    else.
    """
    nx, ny, h = 31, 121, 0.004
    material = material.changed(stretch=20.0 * material.stretch, **_CALM)
    cloth = Cloth(patch(nx, ny, h), material, AWAY, gravity=(0.0, G, 0.0), clamped=range(ny))
    state = cloth.settle(laid_out(cloth), 4.0, 2e-4)
    grid = state.positions.reshape(3, nx, ny)
    inner = slice(ny // 4, 3 * ny // 4)  # near its ends the shear is not even
    found = float((grid[1, -1] - grid[1, 0])[inner].mean())
    exact = material.areal_density * G * ((nx - 1) * h) ** 2 / (2.0 * material.shear)
    return Shear(shear=material.shear, found=found, exact=exact, error=found / exact - 1.0)


def sag(material: ClothMaterial, slack: float = 1.1) -> Sag:
    """A limp cloth between two edges, `slack` times as long as their distance.

    Sag of the catenary.
    """
    nx, ny, h = 81, 13, 0.005
    limp = material.changed(bending=1e-6, plastic_bending=0.0, **_CALM)
    ends = [*range(ny), *range((nx - 1) * ny, nx * ny)]
    cloth = Cloth(patch(nx, ny, h), limp, AWAY, clamped=ends)
    length = (nx - 1) * h
    span = length / slack
    start = laid_out(cloth)
    positions = start.positions.copy()
    positions[0] /= slack
    u = positions[0] / span
    positions[2] -= np.sqrt(3.0 / 8.0 * span * (length - span)) * 4.0 * u * (1.0 - u)
    state = cloth.settle(dc.replace(start, positions=positions), 6.0, 5e-4)
    found = float(_HEIGHT - state.positions[2].reshape(nx, ny)[nx // 2].mean())
    # It hangs a little lower for being stretched: tension over stiffness adds to the length.
    exact, stretched = _catenary(span, length), length
    for _ in range(20):
        a = exact[1]
        tension = limp.areal_density * G * (0.5 * a + 0.25 * span / np.tanh(span / (2 * a)))
        stretched = length * (1.0 + tension / limp.stretch)
        exact = _catenary(span, stretched)
    return Sag(
        span=span,
        length=length,
        length_stretched=float(stretched),
        found=found,
        exact=exact[0],
        error=found / exact[0] - 1.0,
    )


def incline(material: ClothMaterial) -> Incline:
    """The angle of the table at which a patch begins to slide, against arctan(friction), rad."""
    n, h = 24, 0.006

    def slides(angle: float) -> bool:
        cloth = Cloth(
            patch(n, n, h),
            material,
            Table((0.0, 0.0), (4.0, 4.0), 0.7),
            gravity=(G * np.sin(angle), 0.0, -G * np.cos(angle)),
        )
        state = dc.replace(cloth.flat((0.0, 0.0)), asleep=False)
        moved = cloth.advance(state, 0.4).positions - state.positions
        return float(moved[0].mean()) > 1e-4

    low, high = 0.0, 1.2
    while high - low > 5e-4:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if slides(middle) else (middle, high)
    exact = float(np.arctan(material.friction))
    return Incline(
        friction=material.friction,
        found=0.5 * (low + high),
        exact=exact,
        error=0.5 * (low + high) / exact - 1.0,
    )


def run_checks() -> Checks:
    """Run all of them."""
    terry = load_material("terry")
    elastic = [
        cantilever(terry.changed(bending=b, plastic_bending=0.0), overhang)
        for b, overhang in ((3e-5, 0.036), (1e-4, 0.054), (3e-4, 0.081))
    ]
    shipped = [cantilever(terry, 0.036)]
    return Checks(
        cantilever=(*elastic, *shipped),
        stretch=tuple(stretch(load_material(name)) for name in ("terry", "cotton", "jersey")),
        shear=tuple(shear(load_material(name)) for name in ("terry", "cotton", "jersey")),
        sag=tuple(sag(terry, slack) for slack in (1.05, 1.2)),
        incline=tuple(incline(terry.changed(friction=mu)) for mu in (0.3, 0.6, 0.8)),
    )


def _step(material: ClothMaterial, spacing: float) -> float:
    """Return a time step short enough for bending and viscosity at a spacing, a part of 20 ms."""
    weight = 2.0 / (material.areal_density * spacing**2)  # at the border
    bend = spacing**2 / (2.0 / 3.0 * material.first_bending) / (3.0 * weight)
    most = min(1e-3, 0.7 * np.sqrt(bend), 0.2 * spacing**2 / material.viscosity)
    return 0.02 / float(np.ceil(0.02 / most))


def _elastica(material: ClothMaterial, length: float) -> tuple[float, float]:
    """Return (out, drop) of the tip of a heavy strip clamped level, m.

    phi' = curvature of the moment M, M' = -weight (L - s) cos(phi); phi(0) = 0, M(L) = 0.
    """
    weight = material.areal_density * G
    slipped = material.plastic_bending * material.yield_curvature

    def curvature(moment: NDArray[np.float64]) -> NDArray[np.float64]:
        yielding = material.first_bending * material.yield_curvature
        return np.where(
            moment <= yielding,
            moment / material.first_bending,
            (moment - slipped) / material.bending,
        )

    def slopes(s: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
        phi, moment = y[0], y[1]
        rate = -weight * (length - s) * np.cos(phi)
        return np.vstack([curvature(moment), rate, np.cos(phi), np.sin(phi)])

    def ends(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.array([a[0], b[1], a[2], a[3]])

    s = np.linspace(0.0, length, 200)
    guess = np.zeros((4, s.size))
    guess[0] = s / length
    guess[1] = 0.3 * weight * (length - s) ** 2
    guess[2] = s
    solution = solve_bvp(slopes, ends, s, guess, tol=1e-6, max_nodes=20000)
    return float(solution.y[2, -1]), float(solution.y[3, -1])


def _bending_length(length: float, drop: float, out: float) -> float:
    angle = np.arctan2(drop, out)
    return float(length * (np.cos(0.5 * angle) / (8.0 * np.tan(angle))) ** (1.0 / 3.0))


def _catenary(span: float, length: float) -> tuple[float, float]:
    """Return (sag, parameter a) of the catenary of `length` over `span`, m."""
    a = brentq(lambda a: 2.0 * a * np.sinh(0.5 * span / a) - length, 0.05 * span, 50.0 * span)
    return float(a * (np.cosh(0.5 * span / a) - 1.0)), float(a)
