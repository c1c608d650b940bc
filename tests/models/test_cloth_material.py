"""Materials of cloth: what ships loads, what cannot be is refused."""

import math
from pathlib import Path

import pytest

from unwrinkle.models.cloth import ClothMaterial, load_material, material_names
from unwrinkle.models.errors import InputError
from unwrinkle.models.io.loader_yaml import models_dir


@pytest.mark.parametrize("name", material_names())
def test_what_ships_loads_whole(name: str) -> None:
    material = load_material(name)
    assert material.name == name
    material.check()


def test_terry_is_a_towel() -> None:
    terry = load_material("terry")
    assert 0.2 < terry.areal_density < 0.6
    assert terry.first_bending == terry.bending + terry.plastic_bending
    # Bending length of a soft towel: a few centimetres.
    assert 0.01 < (terry.first_bending / (terry.areal_density * 9.81)) ** (1 / 3) < 0.04


def test_a_path_loads_too(tmp_path: Path) -> None:
    text = (models_dir() / "cloths" / "terry.yaml").read_text().replace("name: terry", "")
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    assert load_material(path) == load_material("terry").__class__(
        **{**vars(load_material("terry")), "name": "mine"}
    )


@pytest.mark.parametrize("name", ["silk", "", "../terry", "terry.yml"])
def test_an_unknown_material_is_refused(name: str) -> None:
    with pytest.raises(InputError, match=r"no cloth is called|no such file"):
        load_material(name)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("shear: 10.0", "shaer: 10.0", "shaer"),
        ("shear: 10.0", "", "no value for shear"),
        ("shear: 10.0", "shear: .nan", "no value for shear"),
        ("shear: 10.0", "shear: -1.0", "shear is -1"),
        ("shear: 10.0", "shear: .inf", "shear is inf"),
        ("shear: 10.0", "shear: soft", "soft"),
        ("thickness: 0.0025", "thickness: 2.5", "check its unit"),
        ("areal_density: 0.35", "areal_density: 350.0", "check its unit"),
    ],
)
def test_a_bad_file_is_refused_by_key(tmp_path: Path, old: str, new: str, message: str) -> None:
    text = (models_dir() / "cloths" / "terry.yaml").read_text()
    assert old in text
    path = tmp_path / "bad.yaml"
    path.write_text(text.replace(old, new))
    with pytest.raises(InputError, match=message) as error:
        load_material(path)
    assert "bad.yaml" in str(error.value)


def test_changed_values_are_checked() -> None:
    terry = load_material("terry")
    assert terry.changed(friction=0.3).friction == 0.3
    with pytest.raises(InputError, match="friction"):
        terry.changed(friction=5.0)
    with pytest.raises(InputError, match="friction"):
        terry.changed(friction=math.nan)


def test_an_empty_material_is_incomplete() -> None:
    with pytest.raises(InputError, match="areal_density"):
        ClothMaterial("nothing").check()
