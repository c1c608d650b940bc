"""The results of the benchmark `depth_cameras`."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class MedianNoise:
    """Medians of noise figures, see `NoiseFigures`."""

    distance: float
    table_rms: float
    plane_rms: float
    column_rms: float
    rest_rms: float
    along_rows: tuple[float, ...]
    holes: float
    garment_holes: float


@dataclass(frozen=True, kw_only=True)
class NoiseFigures(MedianNoise):
    """The table's readings in a capture.

    Attributes:
        distance: m.
        table_rms: as perception measures it, slow bias and bands taken out, m.
        plane_rms: off the plane, steps; bow: of u^2, u v, v^2; column_rms: of the columns' means,
            bow taken out; rest_rms: bow and columns taken out.
        along_rows, along_columns: correlation of the rest at LAGS.
        holes, garment_holes: shares without a reading.
        columns: means, steps; None where too little table is seen.
    """

    bow: tuple[float, ...]
    along_columns: tuple[float, ...]
    columns: tuple[float | None, ...]


@dataclass(frozen=True, kw_only=True)
class MapFigures(NoiseFigures):
    """The noise of a named map."""

    name: str


@dataclass(frozen=True)
class RealMaps:
    """Real maps, the step of inverse depth that explains them, 1/m, its rest, m, and its levels."""

    maps: tuple[MapFigures, ...] = ()
    step: float | None = None
    step_rest: float | None = None
    levels: int | None = None


@dataclass(frozen=True)
class RidgeSize:
    """Length, width and chord height of a ridge, m."""

    length: float
    width: float
    chord_height: float


@dataclass(frozen=True)
class LargestWrinkle:
    """The largest wrinkle as a camera sees it; lengths in m; None where none was found.

    Attributes:
        camera, seed: which.
        time: of the look, s.
        holes: share without a reading.
        wrinkles: found.
        truth: of the largest ridge.
        found: the wrinkle lies along it.
        beside, turn: of the wrinkle, m, degrees.
        length, width, chord_height: of the wrinkle.
    """

    camera: str
    seed: int
    time: float
    holes: float
    wrinkles: int
    truth: RidgeSize
    found: bool = False
    beside: float | None = None
    turn: float | None = None
    length: float | None = None
    width: float | None = None
    chord_height: float | None = None


@dataclass(frozen=True)
class Section:
    """The middle row of a picture: rays, true heights and readings, m; None without a reading."""

    ray: tuple[float | None, ...]
    truth: tuple[float | None, ...]
    reading: tuple[float | None, ...]


@dataclass(frozen=True)
class EdgeFigures:
    """What happens around the leaf's edge.

    Attributes:
        flying: share of the readings within 4 pixels of the edge that lie over 20 mm from both leaf
            and table; flying_count: their number.
        shadow: pixels without a reading to the left and to the right of the leaf, in the image's
            row through its middle.
        shadow_law: width of the shadow by the disparities of leaf and table there, pixels, 0 for a
            camera without projector.
    """

    flying: float
    flying_count: int
    shadow: tuple[int, int]
    shadow_law: float


@dataclass(frozen=True, kw_only=True)
class View:
    """Pictures of the middle of the image, as text, and its middle row; height in m."""

    height: float
    holes: float
    section: Section
    truth: str
    reading: str


@dataclass(frozen=True, kw_only=True)
class LeafView(View):
    """A view of the leaf."""

    edge: EdgeFigures


@dataclass(frozen=True, kw_only=True)
class GarmentView(View):
    """A view of the garment, with the share of it without a reading."""

    garment_holes: float


@dataclass(frozen=True)
class NoiseLaws:
    """Noise of single readings of a wall, and the published laws, at a distance; all in m."""

    distance: float
    khoshelham_step: float
    khoshelham_sigma: float
    nguyen_sigma: float
    smisek_step: float
    xtion_sigma: float | None
    tof_sigma: float | None


@dataclass(frozen=True)
class DepthCamerasResult:
    """Both simulated cameras.

    Attributes:
        real: maps of a real Xtion.
        simulated, simulated_step: the same of the simulated one.
        wrinkles, largest_found: from the camera's place in the cell; shares by camera.
        leaf, garment: views by camera.
        laws: noise by distance.
    """

    real: RealMaps
    simulated: tuple[MapFigures, ...]
    simulated_step: float
    wrinkles: tuple[LargestWrinkle, ...]
    largest_found: dict[str, float]
    leaf: dict[str, LeafView]
    garment: dict[str, GarmentView]
    laws: tuple[NoiseLaws, ...]
