"""The results of the benchmark `cloth`."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Cantilever:
    """A strip that hangs over an edge; lengths in m, bending in N m.

    Attributes:
        bending, plastic, overhang: of the strip.
        tip_drop, bending_length: found; the same exact: of the elastica.
        bending_length_material: of the material's figures.
        error: relative.
        asleep: it came to rest.
    """

    bending: float
    plastic: bool
    overhang: float
    tip_drop: float
    tip_drop_exact: float
    bending_length: float
    bending_length_exact: float
    bending_length_material: float
    error: float
    asleep: bool


@dataclass(frozen=True, kw_only=True)
class Compared:
    """A value found, its closed form, and the relative error."""

    found: float
    exact: float
    error: float


@dataclass(frozen=True, kw_only=True)
class Stretch(Compared):
    """A strip under its weight, N/m and m."""

    stretch: float


@dataclass(frozen=True, kw_only=True)
class Shear(Compared):
    """A strip under its weight, sheared, N/m and m."""

    shear: float


@dataclass(frozen=True, kw_only=True)
class Sag(Compared):
    """Cloth between two edges, m."""

    span: float
    length: float
    length_stretched: float


@dataclass(frozen=True, kw_only=True)
class Incline(Compared):
    """Friction, and the angle at which the cloth slides, rad."""

    friction: float


@dataclass(frozen=True)
class Checks:
    """The cloth against closed forms."""

    cantilever: tuple[Cantilever, ...]
    stretch: tuple[Stretch, ...]
    shear: tuple[Shear, ...]
    sag: tuple[Sag, ...]
    incline: tuple[Incline, ...]


@dataclass(frozen=True)
class RestFigures:
    """A settled state, woken and kicked: relative errors, m, and kinetic energies, J."""

    state: str
    asleep: bool
    area_error: float
    yarn_error: float
    moved_in_2s: float
    kinetic_after_2s: float
    kick: float
    kick_after_20ms: float
    kick_largest_later: float
    kick_after_1s: float


@dataclass(frozen=True, kw_only=True)
class ClothMeasures:
    """True measures of a cloth: shares, and the height of its highest point, m."""

    coverage: float
    height: float
    above_5mm: float
    overstretch: float


@dataclass(frozen=True, kw_only=True)
class AfterPull(ClothMeasures):
    """The cloth after a pull."""

    stretch_in_pull: float
    asleep: bool


@dataclass(frozen=True)
class PullFigures:
    """One wrinkle, pulled: rad, m, s.

    Attributes:
        direction, slack, offset: of the wrinkle.
        height, settled_after, creep: of the start.
        after: by share of the slack that each hand pulls.
        cpu: s.
    """

    direction: float
    slack: float
    offset: float
    height: float
    settled_after: float
    creep: float
    after: dict[str, AfterPull]
    cpu: float


@dataclass(frozen=True)
class SameBits:
    """The same start from two processes: digests, and whether they agree."""

    nodes: int
    seed: int
    hashes: tuple[str, ...]
    same: bool


@dataclass(frozen=True)
class SizeCost:
    """CPU seconds per simulated second of one size, and the folded start's height, m."""

    nodes: int
    folded_height: float
    lying: float
    pulled: float
    folded: float
    asleep: float


@dataclass(frozen=True)
class Cost:
    """Costs by size, and the power of the nodes a side that they grow with."""

    sizes: tuple[SizeCost, ...]
    exponent_of_side: float
    rounds: int


@dataclass(frozen=True, kw_only=True)
class StartFigures(ClothMeasures):
    """A starting state, with its height map as text."""

    garment: str
    material: str
    start: str
    asleep: bool
    shape: tuple[int, int]
    height_map: str


@dataclass(frozen=True)
class ClothResult:
    """The simulated cloth: closed forms, rest, pulls, repeatability, cost, starts."""

    checks: Checks
    rest: tuple[RestFigures, ...]
    pulls: tuple[PullFigures, ...]
    pulls_flat: int
    same_bits: SameBits
    cost: Cost
    starts: tuple[StartFigures, ...]
