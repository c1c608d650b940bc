"""Gaze control and vergence: geometry, and the closed loop on simulated images."""

import dataclasses
from math import atan2, degrees, radians

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from unwrinkle.models.arrays import Image
from unwrinkle.models.errors import InputError
from unwrinkle.models.transforms import inverse, transformed, turn
from unwrinkle.perception.features import Template, template, view
from unwrinkle.perception.gaze.localization import NotSeen, Sighting
from unwrinkle.perception.gaze.vergence import (
    TOLERANCE,
    Centring,
    centre,
    crossing,
    in_steps,
    measure_gaze,
    offset,
    quantised,
    ray,
    surface_point,
)
from unwrinkle.perception.stereo.head import Gaze, StereoHead
from unwrinkle.perception.stereo.head_file import nominal_head
from unwrinkle.simulation.devices.pan_tilt import VirtualPanTilt

NOMINAL = nominal_head()
TABLE = 0.70
AIM = np.array([0.02, -1.10, TABLE])


def small(head: StereoHead) -> StereoHead:
    """Return the head with images of an eighth of the size."""
    left, right = (
        dataclasses.replace(eye, camera=eye.camera.scaled(1 / 8)) for eye in (head.left, head.right)
    )
    return dataclasses.replace(head, left=left, right=right)


HEAD = small(NOMINAL)


class World:
    """A level, printed plane, seen by the head through its virtual units."""

    def __init__(self, seed: int = 0) -> None:
        rng = np.random.default_rng(seed)
        self.texture = np.full((2400, 2400), 128.0, dtype=np.float32)
        for sigma in (2.0, 4.0, 10.0):
            noise = cv2.GaussianBlur(rng.standard_normal((2400, 2400)), (0, 0), sigma)
            self.texture += (25.0 * noise / noise.std()).astype(np.float32)
        self.rng = rng
        self.rays = [
            np.stack([*eye.camera.rays(), np.ones((408, 616))], axis=-1)
            for eye in (HEAD.left, HEAD.right)
        ]
        self.units = [
            VirtualPanTilt(eye.unit.step, eye.unit.pan, eye.unit.tilt, seed=seed + k)
            for k, eye in enumerate((HEAD.left, HEAD.right))
        ]
        self.off: list[tuple[float, float]] = []

    def picture(self, eye: int, X_WC: NDArray[np.float64]) -> Image:
        """Noisy picture of the plane; 1.5 mm per texel, x and y from 1.8 m left and behind AIM."""
        rays = self.rays[eye] @ X_WC[:3, :3].T
        depth = (TABLE - X_WC[2, 3]) / np.minimum(rays[..., 2], -1e-3)
        texel = ((X_WC[:3, 3] + depth[..., None] * rays)[..., :2] - AIM[:2] + 1.8) / 0.0015
        u, v = (texel[..., k].astype(np.float32) for k in (0, 1))
        seen = cv2.remap(self.texture, u, v, cv2.INTER_LINEAR, borderValue=60.0)
        seen = (1.0 - 0.06 * eye) * seen + 3.0 * self.rng.standard_normal(seen.shape)
        return np.clip(np.rint(seen), 0, 255).astype(np.uint8)

    @property
    def true_gaze(self) -> Gaze:
        return Gaze(*self.units[0].true_angles, *self.units[1].true_angles)

    def take(self, wanted: Gaze) -> tuple[Image, Image, Gaze]:
        reported = []
        for unit, angles in zip(self.units, (wanted.left, wanted.right), strict=True):
            unit.move(*in_steps(HEAD.left.unit, *angles))
            reported += [unit.step * position for position in unit.position]
        poses = HEAD.poses(self.true_gaze)
        self.off.append(off_axis(poses, AIM))
        return self.picture(0, poses[0]), self.picture(1, poses[1]), Gaze(*reported)

    def begin(self, start: Gaze, target: Template | None, **options: object) -> Centring:
        self.off = []
        return centre(HEAD, target, start, self.take, height=TABLE, **options)


def off_axis(poses: tuple[NDArray[np.float64], ...], p_W: NDArray[np.float64]) -> tuple[float, ...]:
    points = (transformed(inverse(X_WC), p_W) for X_WC in poses)
    return tuple(atan2(float(np.hypot(x, y)), float(z)) for x, y, z in points)


def moved(gaze: Gaze, *offsets: float) -> Gaze:
    """A gaze with its four head angles moved by degrees."""
    return Gaze(*(np.array([*gaze.left, *gaze.right]) + np.radians(offsets)))


GOOD = HEAD.gaze_at(AIM)


@pytest.fixture(scope="module")
def world() -> World:
    return World()


@pytest.fixture(scope="module")
def target(world: World) -> Template:
    """AIM and what is around it, as the left eye saw it from another gaze."""
    X_WL, _ = HEAD.poses(moved(GOOD, 2.0, -1.0, 0.0, 0.0))
    u, v = HEAD.left.camera.project(transformed(inverse(X_WL), AIM))
    seen = view(world.picture(0, X_WL))
    return template(seen, box=(u - 60, v - 45, u + 60, v + 45), point=(u, v))


@settings(max_examples=40, deadline=None)
@given(
    x=st.floats(-0.2, 0.2),
    y=st.floats(-1.3, -0.9),
    z=st.floats(0.5, 1.0),
    pan=st.floats(-8.0, 8.0),
    tilt=st.floats(-5.0, 5.0),
)
def test_a_pixel_leads_back_to_the_point_it_shows(
    x: float, y: float, z: float, pan: float, tilt: float
) -> None:
    point = np.array([x, y, z])
    poses = NOMINAL.poses(moved(NOMINAL.gaze_at(AIM), pan, tilt, -pan, tilt))
    eyes = (NOMINAL.left, NOMINAL.right)
    pixels = []
    for eye, X_WC, off in zip(eyes, poses, off_axis(poses, point), strict=True):
        pixel = eye.camera.project(transformed(inverse(X_WC), point))
        if not ((pixel >= 0) & (pixel < [eye.camera.width, eye.camera.height])).all():
            return
        back = surface_point(eye.camera, X_WC, pixel, z)
        assert back is not None
        np.testing.assert_allclose(back, point, atol=1e-6)
        assert offset(eye.camera, pixel) == pytest.approx(off, abs=1e-7)
        pixels.append(pixel)
    met = crossing(NOMINAL, poses, *pixels)
    assert met is not None
    np.testing.assert_allclose(met[0], point, atol=1e-5)
    assert met[1] < 1e-5


def test_rays_that_miss_each_other_or_the_table() -> None:
    poses = HEAD.poses(GOOD)
    middles = [np.array([eye.camera.cx, eye.camera.cy]) for eye in (HEAD.left, HEAD.right)]
    apart = crossing(HEAD, poses, middles[0], middles[1] + [0.0, 20.0])
    assert apart is not None
    assert apart[1] == pytest.approx(2.3 * 20.0 / HEAD.left.camera.fy, rel=0.1)
    # Eyes that squint outwards.
    assert crossing(HEAD, HEAD.poses(moved(GOOD, 8.0, 0, -8.0, 0)), *middles) is None
    upwards = HEAD.poses(moved(GOOD, 0.0, 40.0, 0.0, 40.0))[0]
    for row in (0.0, 60.0):  # upwards, and hardly downwards
        assert surface_point(HEAD.left.camera, upwards, np.array([310.0, row]), TABLE) is None
    assert surface_point(HEAD.left.camera, poses[0], middles[0], 3.0) is None


def test_outside_the_image_the_ray_is_the_pinholes() -> None:
    camera = NOMINAL.left.camera
    x, y, z = ray(camera, np.array([camera.cx + 3.0 * camera.fx, camera.cy]))
    assert (x, y, z) == (pytest.approx(3.0), pytest.approx(0.0), 1.0)


@given(pan=st.floats(-2.7, 2.7), tilt=st.floats(-0.8, 0.5))
def test_steps_are_the_nearest(pan: float, tilt: float) -> None:
    unit = NOMINAL.left.unit
    for angle, steps in zip((pan, tilt), in_steps(unit, pan, tilt), strict=True):
        assert abs(angle - steps * unit.step) <= 0.5001 * unit.step


def test_steps_stay_within_the_limits() -> None:
    unit = NOMINAL.left.unit
    for pan, tilt in ((unit.pan[0], unit.tilt[0]), (unit.pan[1], unit.tilt[1])):
        a, b = in_steps(unit, pan, tilt)
        unit.check(a * unit.step, b * unit.step, "unit")
    with pytest.raises(InputError, match="left eye: tilt"):
        quantised(NOMINAL, Gaze(left_tilt=unit.tilt[1] + 0.01))


@pytest.mark.parametrize(
    "offsets", [(9, 4, -10, -5), (-12, -6, 8, 7), (6, -8, 6, 3), (0.3, 0.2, -0.2, 0.4)]
)
def test_the_target_is_centred_in_three_looks(
    world: World, target: Template, offsets: tuple[float, ...]
) -> None:
    outcome = world.begin(moved(GOOD, *offsets), target)
    assert outcome.centred, outcome.reason
    assert len(outcome.measurements) <= 3
    assert max(world.off[0]) > 10 * TOLERANCE
    assert max(world.off[-1]) < TOLERANCE
    last = outcome.measurements[-1]
    for measured, true in zip((last.left_offset, last.right_offset), world.off[-1], strict=True):
        assert degrees(abs(measured - true)) < 0.007
    assert quantised(HEAD, outcome.gaze) == outcome.gaze


def test_a_poor_calibration_costs_a_look_and_no_accuracy(world: World, target: Template) -> None:
    tilted = HEAD.left.X_MC @ turn("x", radians(0.4)) @ turn("y", radians(-0.4))
    camera = dataclasses.replace(HEAD.left.camera, fx=HEAD.left.camera.fx * 1.02)
    poor = dataclasses.replace(
        HEAD, left=dataclasses.replace(HEAD.left, X_MC=tilted, camera=camera)
    )
    start = moved(GOOD, -9.0, 5.0, 8.0, 5.0)
    world.off = []
    outcome = centre(poor, target, start, world.take, height=TABLE)
    assert outcome.centred, outcome.reason
    assert len(outcome.measurements) <= 4
    assert max(world.off[-1]) < TOLERANCE


@pytest.mark.parametrize("blind", ["left", "right"])
def test_an_eye_that_does_not_see_the_target_is_sent_there(
    world: World, target: Template, blind: str
) -> None:
    offsets = (45, 0, 3, 2) if blind == "left" else (3, 2, -45, 0)
    outcome = world.begin(moved(GOOD, *offsets), target)
    assert isinstance(getattr(outcome.measurements[0], blind), NotSeen)
    assert getattr(outcome.measurements[0], f"{blind}_offset") == float("inf")
    assert outcome.centred, outcome.reason
    assert len(outcome.measurements) <= 3
    assert max(world.off[-1]) < TOLERANCE


def test_vergence_alone_leaves_the_left_eye_where_it_is(world: World) -> None:
    start = quantised(HEAD, moved(GOOD, 1.0, 1.0, -6.0, 4.0))
    outcome = world.begin(start, None)
    assert outcome.centred, outcome.reason
    assert outcome.gaze.left == start.left
    X_WL, X_WC = HEAD.poses(world.true_gaze)
    point = X_WL[:3, 3] + (TABLE - X_WL[2, 3]) / X_WL[2, 2] * X_WL[:3, 2]
    assert off_axis((X_WC,), point)[0] < TOLERANCE


def test_a_target_that_is_nowhere_is_a_result(world: World, target: Template) -> None:
    outcome = world.begin(moved(GOOD, 45.0, 0.0, 45.0, 0.0), target)
    assert not outcome.centred
    assert "in neither eye: target: too few of its" in outcome.reason
    assert len(outcome.measurements) == 1
    assert outcome.measurements[0].next is None
    other = World(seed=7).picture(0, HEAD.poses(GOOD)[0])
    stranger = template(view(other), "stranger", box=(240, 140, 380, 260))
    assert "stranger" in world.begin(GOOD, stranger).reason


def test_a_unit_that_cannot_look_there_says_so(world: World, target: Template) -> None:
    start = moved(GOOD, 3.0, 3.0, 3.0, 3.0)
    unit = dataclasses.replace(HEAD.right.unit, pan=(start.right_pan - 0.01, 2.0))
    stiff = dataclasses.replace(HEAD, right=dataclasses.replace(HEAD.right, unit=unit))
    outcome = centre(stiff, target, start, world.take, height=TABLE)
    assert not outcome.centred
    assert "right eye" in outcome.reason
    assert "pan" in outcome.reason


def test_the_number_of_measurements_is_limited(world: World, target: Template) -> None:
    outcome = world.begin(moved(GOOD, 5.0, 2.0, 4.0, 2.0), target, max_measurements=1)
    assert not outcome.centred
    assert len(outcome.measurements) == 1
    assert "after 1 measurements still 5" in outcome.reason
    with pytest.raises(InputError, match="at least one"):
        world.begin(GOOD, target, max_measurements=0)


def test_a_black_eye_is_a_result(world: World, target: Template) -> None:
    left, right, gaze = world.take(GOOD)
    black = measure_gaze(HEAD, target, left, np.zeros_like(right), gaze, height=TABLE)
    assert isinstance(black.right, NotSeen)
    assert not black.centred
    assert black.next is not None
    none = measure_gaze(
        HEAD, target, np.full_like(left, 255), np.zeros_like(right), gaze, height=TABLE
    )
    assert none.next is None
    assert "in neither eye" in none.reason


def test_images_of_another_size_are_refused(world: World, target: Template) -> None:
    left, right, gaze = world.take(GOOD)
    with pytest.raises(InputError, match=r"right image is 308 x 408, its camera 616 x 408"):
        measure_gaze(HEAD, target, left, right[:, :308], gaze, height=TABLE)
    with pytest.raises(InputError, match="height"):
        measure_gaze(HEAD, target, left, right, gaze, height=float("nan"))
    seen = measure_gaze(HEAD, target, left, right, gaze, height=TABLE)
    assert isinstance(seen.left, Sighting)
    assert seen.left.sharp
