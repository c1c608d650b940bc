"""Noise profiles load, differ as the sensors do, and refuse nonsense."""

from dataclasses import replace

import pytest

from unwrinkle.models import InputError
from unwrinkle.perception.noise import noise_profile, noise_profile_names


def test_shipped_profiles() -> None:
    assert noise_profile_names() == ("stereo", "stereo-head", "tof", "xtion")
    stereo, head, tof, xtion = (noise_profile(name) for name in noise_profile_names())
    assert stereo.resolution == 0.0005
    assert stereo.knot_spacing < xtion.knot_spacing <= tof.knot_spacing
    assert stereo.depth_noise < head.depth_noise < xtion.depth_noise
    assert {p.halting_pull for p in (stereo, head, tof, xtion)} == {0.005}


@pytest.mark.parametrize(
    ("field", "value"),
    [("resolution", 0.0), ("knot_spacing", -0.001), ("halting_pull", float("nan"))],
)
def test_nonsense_is_refused(field: str, value: float) -> None:
    with pytest.raises(InputError, match=field):
        replace(noise_profile("stereo"), **{field: value})
