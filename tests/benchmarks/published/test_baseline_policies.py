"""Simple ways to flatten: what they take, where to, and that they stay on the table."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.published.garments import baseline_policies as policies
from benchmarks.published.garments.baseline_policies import POLICIES, Pull, carried_out
from unwrinkle.models.cloth import load_material
from unwrinkle.perception.range_map import RangeMap
from unwrinkle.simulation.cloth.cloth import Cloth, ClothState
from unwrinkle.simulation.cloth.initial_states import ridge
from unwrinkle.simulation.cloth.measures import coverage
from unwrinkle.simulation.cloth.outlines import outline
from unwrinkle.systems.perception.true_range_map import true_range_map
from unwrinkle.testing.table import TABLE

CENTRE = (0.0, -1.10)
SPACE = 0.002


def seen(mask: NDArray[np.bool_], height: NDArray[np.float64] | None = None) -> RangeMap:
    """A map of a garment of 1 mm, or as high as given, its grid's first cell at (-0.3, -1.4)."""
    high = np.full(mask.shape, 0.001) if height is None else height
    return RangeMap(
        height=np.where(mask, high, 0.0).astype(np.float32),
        valid=np.ones(mask.shape, dtype=bool),
        garment=mask,
        resolution=SPACE,
        origin=np.array([-0.3, -1.4]),
        table_height=0.7,
        sensor="stereo-head",
    )


def rectangle() -> NDArray[np.bool_]:
    """0.40 m along x, 0.20 m along y."""
    mask = np.zeros((300, 300), dtype=bool)
    mask[100:200, 50:250] = True
    return mask


def ask(name: str, look: RangeMap, before: list[Pull] | None = None, seed: int = 0) -> Pull | None:
    return POLICIES[name](look, TABLE, np.random.default_rng(seed), before or [])


@pytest.fixture(scope="module")
def cloth() -> Cloth:
    support = TABLE
    return Cloth(outline("towel", 40), load_material("terry"), support)


@pytest.fixture(scope="module")
def ridged(cloth: Cloth) -> ClothState:
    return ridge(cloth, CENTRE, math.radians(20.0))


def test_random_takes_the_garment_and_puts_it_within_reach_on_the_table() -> None:
    mask = rectangle()
    look = seen(mask)
    pulls = [ask("random", look, seed=k) for k in range(200)]
    starts = np.array([pull.point for pull in pulls if pull is not None])
    moves = np.array([pull.move for pull in pulls if pull is not None])
    assert len(starts) == 200
    columns, rows = np.rint(look.cell_from_world(starts[:, :2])).astype(int).T
    assert mask[rows, columns].all()
    assert np.allclose(starts[:, 2], 0.701)
    lengths = np.hypot(*moves.T)
    assert lengths.max() <= policies.REACH
    # Uniform in a disc: half of them beyond 0.71 of its radius.
    assert 0.35 < np.mean(lengths > math.sqrt(0.5) * policies.REACH) < 0.65
    assert all(TABLE.overhang(end) == 0.0 for end in starts[:, :2] + moves)
    again = ask("random", look, seed=3)
    assert again is not None and pulls[3] is not None
    assert np.array_equal(again.move, pulls[3].move)


def test_contour_pulls_the_farthest_point_outwards() -> None:
    pull = ask("contour", seen(rectangle()))
    assert pull is not None
    centroid = np.array([0.0, -1.1])
    ray = pull.point[:2] - centroid
    assert np.hypot(*ray) == pytest.approx(math.hypot(0.2, 0.1) - 0.008, abs=0.004)
    assert np.hypot(*pull.move) == pytest.approx(policies.DRAG)
    assert pull.move @ ray == pytest.approx(policies.DRAG * float(np.hypot(*ray)), rel=1e-3)


def test_contour_goes_round_the_corners_and_not_back_at_once() -> None:
    pulls: list[Pull] = []
    for _ in range(8):
        pull = ask("contour", seen(rectangle()), pulls)
        assert pull is not None
        for other in pulls[-3:]:
            cosine = pull.move @ other.move / (np.hypot(*pull.move) * np.hypot(*other.move))
            assert cosine <= math.cos(math.radians(60.0)) + 1e-9
        pulls.append(pull)


def test_contour_leaves_what_is_at_the_edge_of_the_table() -> None:
    mask = np.zeros((300, 300), dtype=bool)
    mask[100:200, 140:300] = True
    look = seen(mask)
    moved = RangeMap(
        look.height, look.valid, look.garment, SPACE, np.array([-0.2, -1.4]), 0.7, "stereo-head"
    )  # it reaches x = 0.398, beyond the margin
    pull = ask("contour", moved)
    assert pull is not None
    assert TABLE.overhang(pull.point[:2] + pull.move) == 0.0
    assert pull.move[0] < 0.0  # the right-hand corners cannot be pulled any farther


@pytest.mark.parametrize("name", POLICIES)
def test_nothing_is_done_where_there_is_no_garment(name: str) -> None:
    assert ask(name, seen(np.zeros((300, 300), dtype=bool))) is None


def test_wrinkledness_takes_the_ridge_and_pulls_away_from_the_centroid(
    cloth: Cloth, ridged: ClothState
) -> None:
    look = true_range_map(cloth, ridged, 0)
    pull = ask("wrinkledness", look)
    assert pull is not None
    assert pull.point[2] > 0.7 + 0.010  # on the ridge
    middle = cloth.vertices(ridged)[:, :2].mean(axis=0)
    assert pull.move @ (pull.point[:2] - middle) > 0.0
    assert np.hypot(*pull.move) == pytest.approx(policies.CREST_DRAG)


def test_a_pull_at_the_corner_takes_a_ridge_out(cloth: Cloth, ridged: ClothState) -> None:
    state, pulls = ridged, list[Pull]()
    for look in range(3):
        pull = ask("contour", true_range_map(cloth, state, look), pulls)
        assert pull is not None
        state = carried_out(cloth, state, pull)
        pulls.append(pull)
    assert coverage(cloth, state) > coverage(cloth, ridged) + 0.01
    assert not state.held


def test_a_hand_beside_the_garment_changes_nothing(cloth: Cloth, ridged: ClothState) -> None:
    beside = Pull(np.array([0.35, -1.5, 0.701]), np.array([0.05, 0.0]), 0.01)
    assert carried_out(cloth, ridged, beside) is ridged


def test_a_hand_is_never_faster_than_it_may_be(
    cloth: Cloth, ridged: ClothState, monkeypatch: pytest.MonkeyPatch
) -> None:
    fastest = []

    def noted(
        _: object, state: ClothState, moves: tuple[object, object], duration: float
    ) -> object:
        fastest.append(1.5 * float(np.linalg.norm(np.asarray(moves[0], dtype=float))) / duration)
        return state

    monkeypatch.setattr(policies, "carry", noted)
    point = cloth.vertices(ridged)[0]
    carried_out(cloth, ridged, Pull(point, np.array([0.11, 0.07]), policies.LIFT))
    assert len(fastest) == 3
    assert max(fastest) <= policies.SPEED + 1e-9
