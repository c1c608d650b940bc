"""Known garments: values, files."""

from pathlib import Path

import pytest

from unwrinkle.models.errors import InputError
from unwrinkle.models.garment import KnownGarment, load_garment, rectangle
from unwrinkle.models.robot import load_cell
from unwrinkle.models.scenario import load_scenario


def test_a_file_keeps_a_garment(tmp_path: Path) -> None:
    towel = rectangle("towel", 0.5, 0.7, 0.002)
    path = tmp_path / "towel.garment.yaml"
    towel.save(path)
    assert load_garment(path) == towel


def test_name_and_area_are_enough(tmp_path: Path) -> None:
    path = tmp_path / "shirt.garment.yaml"
    path.write_text("name: shirt\nflat_area: 0.31\n")
    known = load_garment(path)
    assert (known.flat_area, known.thickness, known.outline) == (0.31, 0.0, [])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("name: towel\n", "flat_area"),
        ("flat_area: 2500\n", "m\\^2"),
        ("flat_area: -0.2\n", "flat_area"),
        ("flat_area: .nan\n", "flat_area"),
        ("flat_area: 0.2\nthickness: 2.5\n", "thickness"),
        ("flat_area: 0.2\noutline: [[0, 0], [1, 0]]\n", "three or more"),
        ("flat_area: 0.2\noutline: [[0, 0], [1, 0, 0], [1, 1]]\n", "corners"),
        ("flat_area: 0.2\noutline: [[0, 0], [0.4, 0], [0.4, .inf]]\n", "finite"),
        ("flat_area: 0.2\noutline: [[0, 0], [400, 0], [400, 500], [0, 500]]\n", "metres"),
        ("flat_area: 0.2\nwidth: 0.4\n", "width"),
    ],
)
def test_what_is_no_garment_is_refused_with_its_file(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "bad.garment.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=rf"bad\.garment\.yaml.*{words}"):
        load_garment(path)


def test_a_scenario_names_it_beside_itself(tmp_path: Path) -> None:
    rectangle("towel", 0.5, 0.7).save(tmp_path / "towel.garment.yaml")
    path = tmp_path / "lab.scenario.yaml"
    path.write_text("Lab:\n  known_garment: towel.garment.yaml\n")
    cell = load_cell(path)
    assert isinstance(cell.garment, KnownGarment)
    assert cell.garment.flat_area == pytest.approx(0.35)
    assert load_cell().garment is None
    path.write_text("Lab:\n  known_garment: lost.garment.yaml\n")
    with pytest.raises(InputError, match=r"lost\.garment\.yaml"):
        load_cell(load_scenario(path))
