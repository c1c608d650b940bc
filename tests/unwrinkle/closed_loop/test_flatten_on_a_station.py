"""The closed loop in one call, on a station that the caller has made."""

from pathlib import Path

import pytest

import unwrinkle as uw
from unwrinkle.models.scenario import load_scenario, with_sensor
from unwrinkle.runs.folder import RunFolder


@pytest.fixture
def cell() -> uw.Cell:
    scenario = with_sensor(load_scenario(), "truth")
    scenario.station.garment.start = "flat"
    scenario.station.garment.nodes = 32
    scenario.sensor.scale = 0.125
    scenario.loop.actions = 0
    return uw.load_cell(scenario)


@pytest.mark.slow
def test_a_flat_garment_is_found_flat(cell: uw.Cell, tmp_path: Path) -> None:
    with uw.make_station(cell, seed=3) as station:
        assert isinstance(station, uw.Station)
        ending = uw.flatten(tmp_path / "run", station=station)
    assert ending.status == "flat"
    settings = RunFolder.open(tmp_path / "run").settings
    assert settings.seed == 3 and settings.station == "sim"


def test_a_station_has_made_its_choices(cell: uw.Cell, tmp_path: Path) -> None:
    with uw.make_station(cell) as station, pytest.raises(uw.InputError):
        uw.flatten(tmp_path / "run", station=station, garment="towel")
    assert not (tmp_path / "run").exists()
