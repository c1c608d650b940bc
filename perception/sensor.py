"""Noise profiles: the settings of perception that depend on a sensor's noise."""

from dataclasses import dataclass, fields
from math import inf, isfinite, sqrt

from unwrinkle.models.errors import InputError
from unwrinkle.models.io.loader_yaml import load_yaml, models_dir

_LENGTHS_POSITIVE = (
    "resolution",
    "depth_noise",
    "garment_height",
    "knot_spacing",
    "rank_radius",
    "wrinkledness_window",
)

#: Least height of a ridge just shorter than `wrinkle_length`, multiples of `depth_noise`; shorter
#: ridges must be higher, see `NoiseProfile.least_height`.
STUB_NOISES = 2.0


@dataclass(frozen=True)
class NoiseProfile:
    """Settings that depend on the sensor's noise. Lengths in metres, curvatures in 1/m.

    Attributes:
        name: "stereo", "stereo-head", "xtion" or "tof".
        resolution: side of a height-map cell.
        depth_noise: standard deviation of one depth reading, quantisation included.
        garment_height: least height above the table of a garment cell, by depth alone.
        bias_degree: degree of the polynomial depth bias that is removed, 0 for none.
        column_bias: whether a bias per image column (PrimeSense's vertical bands) is removed.
        knot_spacing: knot spacing of the B-spline surface.
        smoothing: smoothing length of the surface on which ridges are detected.
        fine_smoothing: smoothing length of the surface on which they are measured.
        averaging: sigma of the averaging of cross-sections along the ridge, 0 for none.
        flat_curvature: curvedness below which a cell is classified flat.
        ridge_curvature: least curvature across a ridge.
        rank_radius: radius of the majority filter (its window is 2 * radius wide).
        link_gap: widest gap between two ridge pieces that may be linked.
        linking_cosine: least cosine between two pieces' directions for linking them.
        wrinkle_length: least length of a wrinkle, except for stubs.
        stub_length: least length of a stub, a ridge shorter than `wrinkle_length` that is a wrinkle
            if it is high enough (see `least_height`); 0 for no stubs.
        triplet_spacing: distance between the ridge samples with triplets.
        contour_reach: search distance of a contour from the ridge.
        wrinkledness_window: side of the window of the wrinkledness entropy.
        flat_inclination: inclination below which normals share one histogram bin, radians.
        halting_pull: pull distance below which a wrinkle is left alone (the source paper's 0.5 cm).
    """

    name: str = ""
    resolution: float = 0.0005
    depth_noise: float = 0.0001
    garment_height: float = 0.0012
    bias_degree: int = 0
    column_bias: bool = False
    knot_spacing: float = 0.008
    smoothing: float = 0.0
    fine_smoothing: float = 0.0
    averaging: float = 0.0
    flat_curvature: float = 2.0
    ridge_curvature: float = 4.0
    rank_radius: float = 0.0035
    link_gap: float = 0.03
    linking_cosine: float = 0.9
    wrinkle_length: float = 0.03
    stub_length: float = 0.0
    triplet_spacing: float = 0.002
    contour_reach: float = 0.05
    wrinkledness_window: float = 0.033
    flat_inclination: float = 0.0524
    halting_pull: float = 0.005

    def __post_init__(self) -> None:
        """Check that every setting is finite and in range."""
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, str):
                continue
            if not isfinite(value) or value < 0.0:
                raise InputError(
                    f"noise profile {self.name!r}: {field.name} = {value} must be finite and >= 0"
                )
            if field.name in _LENGTHS_POSITIVE and value <= 0.0:
                raise InputError(f"noise profile {self.name!r}: {field.name} must be positive")

    @property
    def shortest_ridge(self) -> float:
        """Least length of any wrinkle, metres."""
        return min(self.stub_length or self.wrinkle_length, self.wrinkle_length)

    def least_height(self, length: float) -> float:
        """Return the least height, metres, of a wrinkle of a length, metres.

        From `wrinkle_length` on it is one standard deviation of a reading. For a shorter ridge the
        signal of a matched filter is height * sqrt(length), so the least height is
        STUB_NOISES * depth_noise * sqrt(wrinkle_length / length).
        """
        if length >= self.wrinkle_length:
            return self.depth_noise
        if length < self.shortest_ridge:
            return inf
        return STUB_NOISES * self.depth_noise * sqrt(self.wrinkle_length / length)


def noise_profile_names() -> tuple[str, ...]:
    """Return the names of the noise profiles that the package ships."""
    return tuple(sorted(p.stem for p in (models_dir() / "sensors").glob("*.yaml")))


def noise_profile(name: str) -> NoiseProfile:
    """Load the noise profile of a sensor ("stereo", "stereo-head", "xtion" or "tof").

    Raises:
        InputError: there is no such profile, or its file does not fit.
    """
    names = noise_profile_names()
    if name not in names:
        raise InputError(f"noise profile {name!r}: unknown; known are {', '.join(names)}")
    profile = load_yaml(models_dir() / "sensors" / f"{name}.yaml", NoiseProfile)
    if profile.name != name:
        raise InputError(f"sensors/{name}.yaml: its name says {profile.name!r}")
    return profile
