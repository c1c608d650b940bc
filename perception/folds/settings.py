"""Settings of the search for folds, by how fine the sensor is."""

from dataclasses import dataclass

from unwrinkle.perception.sensor import NoiseProfile

#: Standard deviation of a reading up to which a sensor counts as fine, metres.
_FINE_NOISE_M = 0.001


@dataclass(frozen=True)
class FoldSettings:
    """Lengths in metres. Values of rendered stereo pairs and of real and simulated Xtion images.

    Attributes:
        fine: whether the step of one layer of cloth is above the sensor's noise.
        cell: side of the cells of the height image, about.
        smoothing: sigma of the surface whose area is measured.
        level_smoothing: sigma of the surface whose levels are compared.
        most_relief: height of the highest over the lowest cloth up to which a garment is flat.
        least_area_share: share of the flat area below which layers are hidden.
        near: window ahead of and behind a step in which its two levels are averaged.
        far: window in which the levels further away are.
        along: sigma of both windows along the step.
        least_step: step that counts at all.
        border_step: step of a border.
        least_border_length: length of borders from which on layers lie on each other.
        least_rim: height of a fold's rim over the lowest cloth.
        walker_step: step that a border must have to mark its sides in full.
        walker_slope: slope at which neighbouring cells hardly belong together.
        least_flap_area: of a flap, m^2.
        bulge_length: ridges shorter than this are bulges of a stack if they stand on cloth that is
            `bulge_level` above the lowest; 0 for none.
        bulge_level: see there.
    """

    fine: bool
    cell: float
    smoothing: float
    level_smoothing: float
    most_relief: float
    least_area_share: float
    near: tuple[float, float]
    far: tuple[float, float]
    along: float
    least_step: float
    border_step: float
    least_border_length: float
    least_rim: float
    walker_step: float
    walker_slope: float
    least_flap_area: float
    bulge_length: float
    bulge_level: float


FINE = FoldSettings(
    fine=True,
    cell=0.002,
    smoothing=0.002,
    level_smoothing=0.004,
    most_relief=0.0035,
    least_area_share=0.970,
    near=(0.002, 0.010),
    far=(0.020, 0.040),
    along=0.010,
    least_step=0.0010,
    border_step=0.0012,
    least_border_length=0.08,
    least_rim=0.00125,
    walker_step=0.002,
    walker_slope=0.10,
    least_flap_area=0.002,
    bulge_length=0.0,
    bulge_level=0.0,
)
COARSE = FoldSettings(
    fine=False,
    cell=0.004,
    smoothing=0.006,
    level_smoothing=0.008,
    most_relief=0.007,
    least_area_share=0.957,
    near=(0.003, 0.015),
    far=(0.022, 0.045),
    along=0.016,
    least_step=0.0022,
    border_step=0.010,
    least_border_length=0.15,
    least_rim=0.004,
    walker_step=0.010,
    walker_slope=0.20,
    least_flap_area=0.004,
    bulge_length=0.08,
    bulge_level=0.009,
)


def fold_settings(profile: NoiseProfile) -> FoldSettings:
    """Return the settings for a sensor."""
    return FINE if profile.depth_noise <= _FINE_NOISE_M else COARSE
