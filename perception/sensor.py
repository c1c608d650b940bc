"""What each kind of sensor can and cannot resolve: one profile per sensor, in metres."""

from dataclasses import dataclass, fields
from math import inf, isfinite, sqrt

from unwrinkle.models import InputError, load_yaml, models_dir

_LENGTHS_POSITIVE = (
    "resolution",
    "depth_noise",
    "garment_height",
    "knot_spacing",
    "rank_radius",
    "wrinkledness_window",
)

#: A ridge just shorter than `wrinkle_length` must be this many `depth_noise` high to be a wrinkle (what
#: is lower gives the closed loop no reason to pull), a shorter one higher: `NoiseProfile.least_height`.
STUB_NOISES = 2.0


@dataclass(frozen=True)
class NoiseProfile:
    """Settings that depend on the sensor's noise. Lengths in metres, curvatures in 1/m.

    Attributes:
        name: "stereo", "stereo-head", "xtion" or "tof".
        resolution: side of a height-map cell.
        depth_noise: standard deviation of one depth reading, quantisation included.
        garment_height: height above the table from which depth alone calls a cell garment.
        bias_degree: degree of the slow bias of depth that is taken out of the table, 0 for none.
        column_bias: whether the sensor has vertical bands (PrimeSense) that are taken out too.
        knot_spacing: knot spacing of the B-spline surface.
        smoothing: length of the smoothing penalty of the surface that ridges are found on.
        fine_smoothing: the same of the surface that they are measured on (widths, slack).
        averaging: measured profiles are averaged along the ridge over this (a sigma), 0 for none.
        flat_curvature: curvedness below which a cell is class 0, "flat".
        ridge_curvature: least curvature across a ridge for it to be kept.
        rank_radius: radius of the majority rank filter (its window is 2 * radius wide).
        link_gap: widest gap between two ridge pieces that may be linked.
        linking_cosine: least cosine between two pieces' directions for linking them.
        wrinkle_length: ridges shorter than this are no wrinkles, unless they are stubs.
        stub_length: ridges shorter than `wrinkle_length`, but not than this, are wrinkles if their
            height is beyond doubt (see `least_height`); 0 for none.
        triplet_spacing: distance between the ridge samples that triplets are sought at.
        contour_reach: how far from the ridge a contour is sought.
        wrinkledness_window: side of the window of the wrinkledness entropy.
        flat_inclination: normals tilted less (radians) share one histogram bin.
        halting_pull: the garment is flat when no wrinkle asks for more than this (the paper's
            0.5 cm).
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
        """Refuse settings that no later stage could work with."""
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
        """Length below which no ridge is a wrinkle, however high, metres."""
        return min(self.stub_length or self.wrinkle_length, self.wrinkle_length)

    def least_height(self, length: float) -> float:
        """Height that a ridge of this length must have to be a wrinkle, both in metres.

        One standard deviation of a reading from `wrinkle_length` on. A shorter one is fewer readings
        long, and a matched filter tells it from noise by height * sqrt(length): it must be
        STUB_NOISES * depth_noise * sqrt(wrinkle_length / length) high.
        """
        if length >= self.wrinkle_length:
            return self.depth_noise
        if length < self.shortest_ridge:
            return inf
        return STUB_NOISES * self.depth_noise * sqrt(self.wrinkle_length / length)


def noise_profile_names() -> tuple[str, ...]:
    """Return the names of the profiles that the package ships."""
    return tuple(sorted(p.stem for p in (models_dir() / "sensors").glob("*.yaml")))


def noise_profile(name: str) -> NoiseProfile:
    """Return the profile `name` ("stereo", "stereo-head", "xtion", "tof") from the package's sensors.

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
