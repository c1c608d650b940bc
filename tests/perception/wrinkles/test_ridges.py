import numpy as np
import pytest

from unwrinkle.perception.sensor import noise_profile
from unwrinkle.perception.wrinkles.ridges import contour_points, link, ridge_points
from unwrinkle.perception.wrinkles.surface import fit_surface, sample
from unwrinkle.simulation.rendering.synthetic_towel import Ridge, Towel
from unwrinkle.testing.towels import angle_between, map_of

CENTRE = (0.0, -1.1)
PROFILE = noise_profile("stereo")


def surface_of(*ridges, side=0.4):
    return fit_surface(map_of(Towel(ridges=ridges, side=side), 0.0005, extent=side + 0.05), PROFILE)


def lines_of(surface):
    return link(ridge_points(surface, PROFILE), surface, PROFILE)


@pytest.mark.parametrize("angle", [0.0, 0.6, np.pi / 2, 2.5])
def test_ridge_points_lie_on_the_crest(angle):
    surface = surface_of(Ridge(CENTRE, angle, 0.015, 0.012, 0.2))
    rows, columns = np.nonzero(ridge_points(surface, PROFILE))
    away = surface.world(np.column_stack([columns, rows])) - np.array(CENTRE)
    aside = away @ np.array([-np.sin(angle), np.cos(angle)])
    along = away @ np.array([np.cos(angle), np.sin(angle)])
    assert np.abs(aside[np.abs(along) < 0.09]).max() < 0.0021
    assert np.ptp(along) > 0.18


def test_a_hollow_is_no_ridge():
    surface = surface_of(Ridge(CENTRE, 0.3, -0.015, 0.012, 0.2))
    rows, columns = np.nonzero(ridge_points(surface, PROFILE))
    away = surface.world(np.column_stack([columns, rows])) - np.array(CENTRE)
    aside = away @ np.array([-np.sin(0.3), np.cos(0.3)])
    along = away @ np.array([np.cos(0.3), np.sin(0.3)])
    # The shoulders of a Gaussian groove are convex, at sqrt(3) sigma; its bottom is not.
    assert np.abs(aside[np.abs(along) < 0.08]).min() > 0.012


def test_the_rim_of_thick_cloth_is_no_ridge():
    towel = Towel(ridges=(), side=0.3, thickness=0.02)
    surface = fit_surface(map_of(towel, 0.0005, extent=0.4), PROFILE)
    assert lines_of(surface) == []


def test_contours_are_two_sigma_apart():
    surface = surface_of(Ridge(CENTRE, 0.0, 0.015, 0.012, 0.2))
    column = round(float(surface.cells(np.array(CENTRE))[0]))
    rows = np.flatnonzero(contour_points(surface)[:, column])
    y = surface.origin[1] + rows * surface.resolution - CENTRE[1]
    inner = y[np.abs(y) < 0.02]
    assert inner.min() == pytest.approx(-0.012, abs=0.0015)
    assert inner.max() == pytest.approx(0.012, abs=0.0015)


def test_a_broken_ridge_is_joined_when_the_gap_is_small():
    half = 0.15
    near = [Ridge((x, -1.1), 0.0, 0.015, 0.010, 0.10) for x in (-0.048, 0.048)]
    apart = [Ridge((x, -1.1), 0.0, 0.015, 0.010, 0.10) for x in (-0.10, 0.10)]
    joined = lines_of(surface_of(*near, side=2 * half + 0.1))
    assert len(joined) == 1
    assert np.ptp(joined[0][:, 0]) * 0.001 > 0.15
    assert len(lines_of(surface_of(*apart, side=2 * half + 0.15))) == 2


def test_two_ridges_meeting_at_a_corner_are_not_merged():
    corner = [
        Ridge((-0.08, -1.1), 0.0, 0.015, 0.010, 0.15),
        Ridge((0.0, -1.02), np.pi / 2, 0.015, 0.010, 0.15),
    ]
    lines = lines_of(surface_of(*corner))
    angles = []
    for line in lines:
        direction = line[-1] - line[0]
        angles.append(min(angle_between(direction, 0.0), angle_between(direction, np.pi / 2)))
    assert len(lines) >= 2
    assert max(angles) < np.radians(8.0)


def test_lines_are_in_order():
    (line,) = lines_of(surface_of(Ridge(CENTRE, 0.7, 0.015, 0.012, 0.2)))
    assert np.hypot(*np.diff(line, axis=0).T).max() < 30.0
    along = line @ np.array([np.cos(0.7), np.sin(0.7)])
    steps = np.diff(along)
    assert np.mean(steps > 0.0) > 0.95 or np.mean(steps < 0.0) > 0.95


def test_sample_is_bilinear_and_takes_many_and_no_points():
    image = np.arange(12, dtype=np.float32).reshape(3, 4)
    assert sample(image, np.array([[1.5, 0.5]]))[0] == pytest.approx(3.5, abs=0.05)
    assert sample(image, np.empty((0, 2))).shape == (0,)
    many = np.zeros((40000, 2))
    many[:, 0] = 2.0
    assert np.all(sample(image, many) == 2.0)
