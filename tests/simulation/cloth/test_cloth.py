"""Cloth solver: grips, sleep, table and floor, repeatability, refused input."""

import dataclasses as dc
from typing import Any

import numpy as np
import pytest

from unwrinkle.models.cloth import load_material
from unwrinkle.models.errors import InputError
from unwrinkle.models.table import Table
from unwrinkle.simulation.cloth.cloth import Cloth, ClothError, ClothState
from unwrinkle.simulation.cloth.fingers import carry, let_go, take
from unwrinkle.simulation.cloth.outlines import Outline, outline
from unwrinkle.testing.table import TABLE

CENTRE = (0.0, -1.1)


@pytest.fixture(scope="module")
def cloth() -> Cloth:
    return Cloth(outline("towel", 40), load_material("terry"), TABLE)


@pytest.fixture(scope="module")
def lifted(cloth: Cloth) -> ClothState:
    """A towel held by a corner, 60 mm up."""
    flat = cloth.flat(CENTRE)
    state = take(cloth, flat, 0, flat.positions[:, 0])
    return carry(cloth, state, ((0.05, 0.05, 0.06), None), 0.4)


def test_a_cloth_that_flew_apart_is_an_error_of_the_cloth(cloth: Cloth) -> None:
    flat = cloth.flat(CENTRE)
    velocities = flat.velocities.copy()
    velocities[:, ::7] = 1e9 * np.resize([1.0, -1.0], velocities[:, ::7].shape)
    flung = dc.replace(flat, velocities=velocities, asleep=False)
    with pytest.raises(ClothError, match="flew apart"):
        cloth.advance(flung, 0.1)


def pose(p: Any, yaw: float = 0.0) -> np.ndarray:
    X = np.eye(4)
    X[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    X[:3, 3] = p
    return X


def test_a_flat_cloth_lies_and_sleeps(cloth: Cloth) -> None:
    state = cloth.flat(CENTRE, yaw=0.1)
    vertices = cloth.vertices(state)
    assert state.asleep
    assert vertices.shape == (1600, 3)
    np.testing.assert_allclose(vertices[:, 2], 0.70125)
    np.testing.assert_allclose(vertices.mean(axis=0)[:2], CENTRE, atol=1e-12)
    later = cloth.advance(dc.replace(state, asleep=False), 0.2)
    assert later.asleep
    np.testing.assert_allclose(later.positions, state.positions, atol=1e-12)


def test_asleep_only_the_time_goes_on(cloth: Cloth) -> None:
    state = cloth.flat(CENTRE)
    later = cloth.advance(state, 5.0)
    assert later.time == 5.0
    assert later.positions is state.positions or (later.positions == state.positions).all()
    held = take(cloth, state, 1, state.positions[:, 5])
    assert held.grips[1] is not None
    assert cloth.advance(held, 0.02, (None, held.grips[1].X_WT)).asleep


def test_a_grip_holds_the_patch_around_the_tip(cloth: Cloth) -> None:
    state = cloth.flat(CENTRE)
    tip = np.array([0.10, -1.0, 0.703])
    grip = cloth.grip(state, 0, pose(tip, 0.4)).grips[0]
    assert grip is not None
    distance = np.linalg.norm(state.positions.T - tip, axis=1)
    np.testing.assert_array_equal(grip.nodes, np.flatnonzero(distance <= 0.015))
    np.testing.assert_allclose(grip.at(grip.X_WT), state.positions[:, grip.nodes].T, atol=1e-12)


def test_a_grip_in_the_air_misses(cloth: Cloth) -> None:
    state = cloth.flat(CENTRE)
    assert cloth.grip(state, 0, pose((0.0, -1.1, 0.75))).grips == (None, None)
    assert cloth.grip(state, 0, pose((0.30, -1.1, 0.70))) is state


def test_held_nodes_follow_the_whole_pose(cloth: Cloth, lifted: ClothState) -> None:
    grip = lifted.grips[0]
    assert grip is not None
    target = grip.X_WT.copy()
    target[:3, :3] = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]) @ target[:3, :3]
    state = cloth.advance(lifted, 0.1, (target, None))
    np.testing.assert_allclose(state.positions[:, grip.nodes].T, grip.at(target), atol=1e-12)
    assert not state.asleep


def test_two_hands_share_no_node(cloth: Cloth) -> None:
    state = cloth.flat(CENTRE)
    state = take(cloth, state, 0, (0.0, -1.1, 0.70))
    both = take(cloth, state, 1, (0.01, -1.1, 0.70))
    right, left = both.grips
    assert right is not None
    assert left is not None
    assert not set(right.nodes) & set(left.nodes)
    assert let_go(cloth, both).grips == (None, None)


def test_what_is_let_go_falls(cloth: Cloth, lifted: ClothState) -> None:
    state = cloth.settle(let_go(cloth, lifted))
    assert state.asleep
    assert state.time < lifted.time + 3.0
    heights = cloth.vertices(state)[:, 2]
    assert heights.min() >= 0.70125 - 1e-9
    assert heights.max() < 0.73
    assert (state.velocities == 0.0).all()


def test_nothing_goes_below_the_table(cloth: Cloth, lifted: ClothState) -> None:
    assert cloth.vertices(lifted)[:, 2].min() >= 0.70125 - 1e-9


def test_beyond_the_table_it_falls_to_the_floor() -> None:
    small = Table((0.0, 0.0), (0.10, 0.60), 0.70)
    cloth = Cloth(
        Outline("patch", np.ones((41, 21), dtype=bool), 0.01), load_material("terry"), small
    )
    plane = cloth.outline.plane.reshape(-1, 2)
    positions = np.vstack([plane.T, np.full(cloth.size, cloth.flat_height)])
    positions[0] += 0.15  # most of it beyond the edge
    zeros = np.zeros((3, cloth.size))
    state = ClothState(0.0, positions, zeros, np.zeros((4, cloth.size)))
    # It slides off over the edge, never through the table's side, and lies on the floor.
    state = cloth.advance(state, 0.2)
    x, _, z = cloth.vertices(state).T
    assert z.max() > 0.69
    assert z.min() < 0.65
    assert not ((np.abs(x) < 0.0425) & (z < 0.70)).any()
    state = cloth.settle(cloth.advance(state, 1.5))
    assert cloth.vertices(state)[:, 2].max() < 0.1
    np.testing.assert_allclose(cloth.vertices(state)[:, 2].min(), 0.00125, atol=1e-9)


def test_cloth_does_not_pass_through_cloth(cloth: Cloth) -> None:
    # Fold one half over the other: the upper layer stays a thickness above the lower.
    state = cloth.flat(CENTRE)
    state = take(cloth, state, 0, state.positions[:, 5])
    state = take(cloth, state, 1, state.positions[:, 34])
    state = carry(cloth, state, ((0.15, 0.0, 0.12), (0.15, 0.0, 0.12)), 0.6)
    state = carry(cloth, state, ((0.15, 0.0, -0.11), (0.15, 0.0, -0.11)), 0.6)
    state = cloth.settle(let_go(cloth, state))
    heights = cloth.vertices(state)[:, 2] - cloth.flat_height
    x = cloth.vertices(state)[:, 0]
    over = (np.arange(1600) // 40 < 10) & (x > -0.05)
    assert over.sum() > 200
    # A node may rest between three others: nearly a thickness, never through.
    assert np.median(heights[over]) > 0.0020
    assert np.quantile(heights[over], 0.02) > 0.0012


def test_clamped_nodes_stay_and_gravity_turns() -> None:
    away = Table((9.0, 9.0), (0.1, 0.1), 0.1)
    patch = Outline("patch", np.ones((21, 9), dtype=bool), 0.01)
    material = load_material("terry").changed(air_drag=20.0)
    cloth = Cloth(patch, material, away, gravity=(0.0, -9.81, 0.0), clamped=range(9))
    plane = patch.plane.reshape(-1, 2)
    positions = np.vstack([plane.T, np.full(cloth.size, 1.0)])
    start = ClothState(0.0, positions, np.zeros((3, 189)), np.zeros((4, 189)))
    state = cloth.settle(start, 4.0)
    np.testing.assert_array_equal(state.positions[:, :9], positions[:, :9])
    # In its plane it bends by 5 mm (weight L^4 / (8 Y b^3 / 12)) and shears by 7 mm (weight L^2 /
    # (2 G)).
    assert state.positions[1, -9:].mean() == pytest.approx(-0.012, abs=0.002)
    np.testing.assert_allclose(state.positions[2], 1.0, atol=1e-9)


def test_the_same_input_gives_the_same_bits(cloth: Cloth, lifted: ClothState) -> None:
    other = Cloth(outline("towel", 40), load_material("terry"), TABLE)
    cloth.advance(lifted, 0.1)  # leaves its scratch memory in another state
    a, b = (c.advance(let_go(c, lifted), 0.3) for c in (cloth, other))
    assert a.positions.tobytes() == b.positions.tobytes()
    assert a.curvatures.tobytes() == b.curvatures.tobytes()
    assert a.positions.tobytes() != lifted.positions.tobytes()


def test_short_and_long_calls_agree_bit_for_bit(cloth: Cloth, lifted: ClothState) -> None:
    start = let_go(cloth, lifted)
    long = cloth.advance(start, 0.1)
    short = start
    for _ in range(5):
        short = cloth.advance(short, 0.02)
    assert short.positions.tobytes() == long.positions.tobytes()


def test_a_shorter_step_gives_nearly_the_same(cloth: Cloth, lifted: ClothState) -> None:
    fine = Cloth(outline("towel", 40), load_material("terry"), TABLE, time_step=5e-4)
    a, b = (c.advance(let_go(c, lifted), 0.2) for c in (cloth, fine))
    assert np.abs(a.positions - b.positions).max() < 6e-3


def test_a_towel_torn_by_the_hands_is_an_error(cloth: Cloth) -> None:
    state = cloth.flat(CENTRE)
    state = take(cloth, state, 0, (0.02, -1.1, 0.70))
    state = take(cloth, state, 1, (-0.02, -1.1, 0.70))
    with pytest.raises(ClothError, match=r"torn at .* s"):
        carry(cloth, state, ((0.25, 0.0, 0.1), (-0.25, 0.0, 0.1)), 0.4)


def test_wild_velocities_stay_finite(cloth: Cloth) -> None:
    rng = np.random.default_rng(0)
    state = dc.replace(cloth.flat(CENTRE), velocities=rng.normal(0.0, 2.0, (3, 1600)), asleep=False)
    later = cloth.advance(state, 0.5)
    assert np.isfinite(later.positions).all()
    assert later.speed < 2.0


@pytest.mark.parametrize("duration", [0.0, -0.02, np.nan, np.inf, 0.0205])
def test_bad_durations_are_refused(cloth: Cloth, duration: float) -> None:
    state = dc.replace(cloth.flat(CENTRE), asleep=False)
    with pytest.raises(InputError, match="cannot advance"):
        cloth.advance(state, duration)


def test_bad_hands_are_refused(cloth: Cloth, lifted: ClothState) -> None:
    far = pose((0.5, -0.5, 1.0))
    with pytest.raises(InputError, match="a hand moves"):
        cloth.advance(lifted, 0.02, (far, None))
    with pytest.raises(InputError, match="right hand"):
        cloth.advance(lifted, 0.02, (np.full((4, 4), np.nan), None))
    with pytest.raises(InputError, match="poses of 1 hands"):
        cloth.advance(lifted, 0.02, (None,))
    with pytest.raises(InputError, match="no hand 2"):
        cloth.grip(lifted, 2, pose((0, 0, 0)))
    with pytest.raises(InputError, match="no hand -1"):
        cloth.release(lifted, -1)
    with pytest.raises(InputError, match="holds cloth already"):
        cloth.grip(lifted, 0, pose((0, 0, 0)))


def test_a_hand_that_holds_nothing_is_left_out(cloth: Cloth) -> None:
    state = cloth.flat(CENTRE)
    assert cloth.advance(state, 0.02, (None, pose((9.0, 9.0, 9.0)))).asleep


def test_a_state_of_another_cloth_is_refused(cloth: Cloth) -> None:
    other = Cloth(outline("towel", 30), load_material("terry"), TABLE)
    with pytest.raises(InputError, match="a state of 900 nodes"):
        cloth.advance(other.flat(CENTRE), 0.02)


@pytest.mark.parametrize("centre", [(0.3, -1.1), (0.0, -0.9), (np.nan, 0.0)])
def test_a_garment_beyond_the_table_is_refused(cloth: Cloth, centre: tuple[float, float]) -> None:
    with pytest.raises(InputError, match=r"beyond the table|finite"):
        cloth.flat(centre)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"time_step": 0.0}, "time step"),
        ({"time_step": np.nan}, "time step"),
        ({"time_step": 4e-3}, "too long|too stiff"),
        ({"gravity": (0.0, np.nan, 0.0)}, "gravity"),
        ({"clamped": [6400]}, "clamped"),
        ({"grasp_radius": 0.0}, "grasp radius"),
    ],
)
def test_bad_options_are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Cloth(outline("towel", 80), load_material("terry"), TABLE, **(options | {}))


def test_a_stiff_cloth_asks_for_a_shorter_step() -> None:
    stiff = load_material("terry").changed(bending=1e-3)
    with pytest.raises(InputError, match=r"give (\S+) s or less") as error:
        Cloth(outline("towel", 80), stiff, TABLE)
    most = float(str(error.value).split("give ")[1].split(" s")[0])
    assert Cloth(outline("towel", 80), stiff, TABLE, time_step=most).time_step == most


@pytest.mark.parametrize("speed", [0.0, np.nan, -1.0])
def test_a_bad_settling_speed_is_refused(cloth: Cloth, speed: float) -> None:
    with pytest.raises(InputError, match="settling speed"):
        cloth.settle(cloth.flat(CENTRE), 1.0, speed)


def test_its_arrays_are_read_only(cloth: Cloth) -> None:
    for value in (cloth.numbers, cloth.triangles, cloth.rest):
        with pytest.raises(ValueError, match="read-only"):
            value[0] = 0


def test_a_sharp_bend_is_remembered_and_a_slight_one_is_not() -> None:
    # A strip held level at one end; turned gravity bends it up or down, then is taken away.
    away = Table((9.0, 9.0), (0.1, 0.1), 0.1)
    patch = Outline("patch", np.ones((12, 9), dtype=bool), 0.005)
    terry = load_material("terry").changed(air_drag=30.0)
    plane = patch.plane.reshape(-1, 2)
    positions = np.vstack([plane.T, np.full(108, 1.0)])
    flat = ClothState(0.0, positions, np.zeros((3, 108)), np.zeros((4, 108)))
    left = []
    for pull in (0.5, 20.0):
        pulled = Cloth(patch, terry, away, gravity=(0.0, 0.0, -pull), clamped=range(18))
        free = Cloth(patch, terry, away, gravity=(0.0, 0.0, 0.0), clamped=range(18))
        bent = pulled.advance(flat, 2.0)
        after = free.advance(dc.replace(bent, asleep=False), 3.0)
        left.append(1.0 - float(after.positions[2, -9:].mean()))
        assert bent.positions[2, -9:].mean() < 1.0 - 1.5 * left[-1]
    assert abs(left[0]) < 4e-4  # of 5 mm; it falls asleep before the last bit
    assert left[1] > 1e-3


def test_the_boundary_is_the_garments_border() -> None:
    cloth = Cloth(outline("tshirt", 60), load_material("jersey"), TABLE)
    mask = cloth.outline.mask
    assert len(cloth.numbers) == mask.sum()
    assert cloth.triangles.max() == mask.sum() - 1
    edges = np.sort(cloth.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    single, counts = np.unique(edges, axis=0, return_counts=True)
    assert set(cloth.boundary) == set(single[counts == 1].ravel())
    a, b, c = (cloth.rest[cloth.triangles[:, k]] for k in range(3))
    assert (np.linalg.det(np.stack([b - a, c - a], axis=-1)) > 0.0).all()
