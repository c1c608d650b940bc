"""Outlines: sizes, connectivity, refused input."""

import numpy as np
import pytest

from unwrinkle.models.errors import InputError
from unwrinkle.models.scenario import OUTLINES
from unwrinkle.simulation.cloth.outlines import NAMES, Outline, outline

SIZES = {"towel": (0.48, 0.48), "dishcloth": (0.54, 0.38), "tshirt": (0.66, 0.50)}
SIZES["trousers"] = (0.34, 0.56)


def test_the_scenarios_names_are_known() -> None:
    assert set(NAMES) == set(OUTLINES)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("nodes", [40, 80, 132])
def test_sizes_do_not_depend_on_the_nodes(name: str, nodes: int) -> None:
    shape = outline(name, nodes)
    place = shape.plane[shape.mask]
    assert max(shape.mask.shape) == nodes
    np.testing.assert_allclose(np.ptp(place, axis=0), SIZES[name], atol=0.025)
    np.testing.assert_allclose(shape.area, outline(name, 100).area, rtol=0.03)


def test_garments_lie_on_the_table_and_are_symmetric() -> None:
    for name in NAMES:
        shape = outline(name, 81)
        assert (np.abs(shape.plane[shape.mask]) < 0.34).all()
        assert (shape.mask == shape.mask[::-1]).all()


def test_a_shirt_has_sleeves_and_a_neck() -> None:
    shape = outline("tshirt", 100)
    widths = shape.mask.sum(axis=0) * shape.spacing
    assert 0.36 < widths[5] < 0.41
    assert widths.max() > 0.6
    middle = shape.mask[shape.mask.shape[0] // 2]
    assert not middle[-1]
    assert middle[0]


def test_trousers_have_two_legs() -> None:
    hem = outline("trousers", 100).mask[:, 3].astype(int)
    assert (np.diff(hem) == 1).sum() + hem[0] == 2


@pytest.mark.parametrize(("name", "nodes"), [("sock", 80), ("towel", 8), ("towel", 1000)])
def test_unknown_names_and_sizes_are_refused(name: str, nodes: int) -> None:
    with pytest.raises(InputError, match=r"outline"):
        outline(name, nodes)


def _with_hair() -> np.ndarray:
    mask = np.zeros((8, 8), dtype=bool)
    mask[:5, :5] = True
    mask[5, 2] = True
    return mask


def _two_pieces() -> np.ndarray:
    mask = np.ones((9, 4), dtype=bool)
    mask[4] = False
    return mask


@pytest.mark.parametrize(
    ("mask", "spacing", "message"),
    [
        (np.ones((2, 9), dtype=bool), 0.01, "nodes a side"),
        (np.ones((200, 9), dtype=bool), 0.01, "nodes a side"),
        (np.ones(9, dtype=bool), 0.01, "nodes a side"),
        (np.ones((9, 9), dtype=bool), np.nan, "spacing"),
        (np.ones((9, 9), dtype=bool), 0.0, "spacing"),
        (np.zeros((9, 9), dtype=bool), 0.01, "no square"),
        (_with_hair(), 0.01, "1 of its nodes"),
        (_two_pieces(), 0.01, "more than one piece"),
    ],
)
def test_what_is_no_piece_of_cloth_is_refused(
    mask: np.ndarray, spacing: float, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        Outline("mine", mask, spacing)


def test_the_mask_is_read_only() -> None:
    with pytest.raises(ValueError, match="read-only"):
        outline("towel", 20).mask[0, 0] = False
