"""Noise profiles: loading, plausible values, refused input."""

import math
from dataclasses import replace

import pytest

from unwrinkle.models.errors import InputError
from unwrinkle.perception.sensor import noise_profile, noise_profile_names


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


def test_a_stub_must_be_higher_the_shorter_it_is() -> None:
    xtion = noise_profile("xtion")
    assert xtion.shortest_ridge == xtion.stub_length < xtion.wrinkle_length
    assert xtion.least_height(0.08) == xtion.depth_noise
    assert xtion.least_height(0.079) == pytest.approx(2.0 * xtion.depth_noise, rel=0.01)
    assert xtion.least_height(0.04) == pytest.approx(2.0 * math.sqrt(2.0) * xtion.depth_noise)
    assert xtion.least_height(0.029) == math.inf


@pytest.mark.parametrize("name", ["stereo", "stereo-head"])
def test_without_stubs_the_shortest_wrinkle_is_the_shortest_ridge(name: str) -> None:
    profile = noise_profile(name)
    assert profile.shortest_ridge == profile.wrinkle_length
    assert profile.least_height(profile.wrinkle_length) == profile.depth_noise
    assert profile.least_height(0.999 * profile.wrinkle_length) == math.inf
    assert replace(profile, stub_length=1.0).shortest_ridge == profile.wrinkle_length
