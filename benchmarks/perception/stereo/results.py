"""The results of the benchmark `stereo`."""

from dataclasses import dataclass

from benchmarks.perception.calibration import ChessboardFigures


@dataclass(frozen=True, kw_only=True)
class DisparityErrors:
    """Errors on the cloth.

    Attributes:
        rms, bias, median: of the disparity, px.
        valid: share.
        height_rms: m.
        gross: share of heights beyond 3 mm.
        height_per_pixel: m of height per px of disparity.
    """

    rms: float
    bias: float
    median: float
    valid: float
    height_rms: float
    gross: float
    height_per_pixel: float


@dataclass(frozen=True)
class HeightErrors:
    """Errors of heights, m."""

    rms: float
    bias: float
    median: float


@dataclass(frozen=True)
class WrinkleErrors:
    """A ridge's true width and chord height, and the errors of its wrinkle, m; None if not found."""

    width: float
    height: float
    width_error: float | None = None
    height_error: float | None = None


@dataclass(frozen=True, kw_only=True)
class SceneFigures(DisparityErrors):
    """One scene: name, distance, m; errors of the map and of the spline; wrinkles."""

    name: str
    distance: float
    map: HeightErrors
    spline: HeightErrors
    wrinkles: tuple[WrinkleErrors, ...]


@dataclass(frozen=True, kw_only=True)
class SizeFigures(DisparityErrors):
    """One size of the images: megapixels, and time, s."""

    megapixels: int
    time: float


@dataclass(frozen=True, kw_only=True)
class MatcherFigures(DisparityErrors):
    """One way to match: name, and time, s."""

    name: str
    time: float


@dataclass(frozen=True)
class Times:
    """Times of a pair to its map, s: whole images, the table's region alone, the garment's map."""

    pair_to_map_median: float
    pair_to_map: tuple[float, ...]
    table_region_median: float
    garment_map_median: float


@dataclass(frozen=True)
class MotorcycleErrors:
    """Errors on Middlebury's Motorcycle: median, px; shares over 1 px, and of known pixels."""

    name: str
    median: float
    bad: float
    valid: float


@dataclass(frozen=True)
class RealPairs:
    """Errors on real pairs."""

    motorcycle: tuple[MotorcycleErrors, ...]
    chessboards: ChessboardFigures


@dataclass(frozen=True)
class StereoResult:
    """Pairs of 16 megapixels to range maps.

    Attributes:
        pair_to_map_time_median: s.
        peak_memory: of a process, bytes.
        disparity_rms, disparity_bias, valid_fraction: of textured cloth in the cell, px.
        speedup_over_sgbm_full, rms_ratio_over_sgbm_full: against full-resolution SGBM.
        times: of the stages.
        scenes: by name.
        sizes: of the images.
        methods: ours first, full-resolution SGBM second.
        real: None where the data is not at hand.
    """

    pair_to_map_time_median: float
    peak_memory: int
    disparity_rms: float
    disparity_bias: float
    valid_fraction: float
    speedup_over_sgbm_full: float
    rms_ratio_over_sgbm_full: float
    times: Times
    scenes: dict[str, SceneFigures]
    sizes: tuple[SizeFigures, ...]
    methods: tuple[MatcherFigures, ...]
    real: RealPairs | None
