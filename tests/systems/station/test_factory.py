"""One function makes a station of any form, or refuses before anything is opened."""

import dataclasses as dc
from typing import Any

import pytest

from unwrinkle.closed_loop.setup import loop_around
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell
from unwrinkle.models.scenario import StationForm
from unwrinkle.models.site import CameraSite, PanTiltSite, loopback_site
from unwrinkle.perception.stereo.head_file import nominal_calibration
from unwrinkle.systems.station.base import Station
from unwrinkle.systems.station.factory import make_station
from unwrinkle.systems.station.world import StationFaults, simulated_cloth

READY = dc.replace(
    loopback_site(),
    pan_tilt=PanTiltSite("/dev/null", "/dev/null"),
    cameras=CameraSite("folder", folder="."),
)


@pytest.mark.parametrize("form", ["sim", "loopback"])
def test_a_station_knows_what_it_is_made_of(station_cell: Cell, form: str) -> None:
    head = nominal_calibration().stereo_head(station_cell.limits.head)
    cloth = simulated_cloth(station_cell)
    with make_station(
        station_cell,
        form=form,
        seed=7,
        cloth=cloth,
        state=cloth.flat((0.0, -1.1)),
        head=head,
    ) as station:
        assert station.form == StationForm(form) and not station.real
        assert station.cell is station_cell and station.head is head and station.cloth is cloth
        assert station.seed == 7 and (station.site is None) == (form == "sim")


def test_the_scenario_states_the_form(station_cell: Cell) -> None:
    settings = dc.replace(station_cell.scenario.station, form="hardware")
    cell = dc.replace(station_cell, scenario=dc.replace(station_cell.scenario, station=settings))
    with pytest.raises(InputError), make_station(cell):
        pass


@pytest.mark.parametrize(
    "arguments",
    [
        {"site": None, "go": True},
        {"site": READY},  # nobody permits motion
        {"site": dc.replace(READY, commissioning=True), "go": True},
        {"site": dc.replace(READY, virtual=False), "go": True},  # no calibration
        {"site": dc.replace(READY, cameras=CameraSite()), "go": True},
        {"site": dc.replace(READY, pan_tilt=PanTiltSite()), "go": True},
        {"site": READY, "go": True, "faults": StationFaults()},
    ],
)
def test_moving_a_robot_has_conditions(
    station_cell: Cell, arguments: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    def opened(*_: object, **__: object) -> None:
        raise AssertionError("a device was opened")

    monkeypatch.setattr("unwrinkle.systems.station.factory.hardware_station", opened)
    with pytest.raises(InputError), make_station(station_cell, form="hardware", **arguments):
        pass
    with (
        pytest.raises(AssertionError),
        make_station(station_cell, form="hardware", site=READY, go=True),
    ):
        pass


@pytest.mark.parametrize(
    "arguments",
    [{"form": "real"}, {"form": "sim", "site": READY}, {"form": "sim", "start": [0.0] * 12}],
)
def test_what_does_not_fit_a_form_is_refused(station_cell: Cell, arguments: dict[str, Any]) -> None:
    with pytest.raises(InputError), make_station(station_cell, **arguments):
        pass


def test_a_loop_on_a_real_robot_needs_an_operator(station_cell: Cell) -> None:
    station = Station()
    station.form, station.cell = StationForm.HARDWARE, station_cell
    assert station.real
    with pytest.raises(InputError):
        loop_around(station)
