"""One function that makes a station of any form."""

import datetime
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext

from numpy.typing import ArrayLike

from unwrinkle.hardware.run_log.writer import RunLog
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell
from unwrinkle.models.scenario import StationForm
from unwrinkle.models.site import Site, loopback_site
from unwrinkle.perception.stereo.head import StereoHead
from unwrinkle.perception.stereo.head_file import nominal_calibration
from unwrinkle.simulation.arms.trajectory_player import PlayerSettings
from unwrinkle.simulation.cloth.cloth import Cloth, ClothState
from unwrinkle.simulation.cloth.initial_states import start_state
from unwrinkle.systems.station.base import Station
from unwrinkle.systems.station.hardware import hardware_station
from unwrinkle.systems.station.loopback.controls import loopback_controls
from unwrinkle.systems.station.preconditions import calibration_of, check_permitted
from unwrinkle.systems.station.simulated import direct_controls
from unwrinkle.systems.station.world import (
    SimulatedStation,
    StationFaults,
    simulated_cloth,
    start_posture,
)


@contextmanager
def make_station(
    cell: Cell,
    *,
    form: str | None = None,
    site: Site | None = None,
    seed: int = 0,
    cloth: Cloth | None = None,
    state: ClothState | None = None,
    head: StereoHead | None = None,
    start: ArrayLike | None = None,
    faults: StationFaults | None = None,
    player: PlayerSettings | None = None,
    log: RunLog | None = None,
    go: bool = False,
) -> Iterator[Station]:
    """Make a station, a diagram called "station"; at the end the arms are held and the devices
    closed.

    Args:
        cell: robot and cell; its scenario states the periods, the sensor and the garment.
        form: `sim`, `loopback` or `hardware`, see `StationForm`; the scenario's if left out.
        site: devices; required by the hardware form, settings of the drivers in the loopback form.
        seed: of the simulated head's rest errors, the texture and the images' noise.
        cloth: solver of a simulated garment; the scenario's garment if left out.
        state: how that garment lies at first; the scenario's start if left out.
        head: stereo head; the site's calibration on hardware, else the nominal one if left out.
        start: (13,) initial posture of simulated axes, rad; home if left out.
        faults: to simulate; none if left out.
        player: settings of the simulated arms' controller, in the sim form.
        log: run log of what is sent and measured; unused in the sim form.
        go: permits the hardware form, which moves a robot, and states that an operator approves
            each plan.

    Raises:
        InputError: an argument does not fit the form; the form, a texture, sensor or fault is
            unknown; the garment does not fit the table; the start is no posture or beyond the
            limits; a period is no multiple of the cloth's time step; or a condition for moving a
            robot is not met, see `preconditions`.
        HardwareError: a device does not answer, or is not ready.
    """
    chosen = _form(cell.scenario.station.form if form is None else form)
    if chosen == StationForm.HARDWARE:
        given = {"cloth": cloth, "state": state, "start": start, "faults": faults, "player": player}
        _refuse(given, "hardware")
        site = check_permitted(cell, site, go=go, today=datetime.date.today())
        if head is None:
            head = _calibrated_head(cell, site)
        with hardware_station(cell, site, head=head, seed=seed, log=log) as station:
            yield station
        return
    if chosen == StationForm.SIM:
        _refuse({"site": site}, "sim")
    else:
        _refuse({"player": player}, "loopback")
        site = site or loopback_site()
    if head is None:
        head = nominal_calibration().stereo_head(cell.limits.head)
    cloth = simulated_cloth(cell) if cloth is None else cloth
    posture = start_posture(cell, cloth, start)
    if state is None:
        centre = cell.scenario.garment_centre
        state = start_state(
            cloth, cell.scenario.station.garment.start, (centre[0], centre[1]), seed
        )
    with (
        nullcontext(direct_controls(player))
        if site is None
        else loopback_controls(cell, site, posture, head=head, log=log)
    ) as controls:
        yield SimulatedStation(
            cell,
            cloth,
            state,
            head,
            seed=seed,
            start=posture,
            faults=faults or StationFaults(),
            controls=controls,
            form=chosen,
            site=site,
        )


def _form(name: str) -> StationForm:
    try:
        return StationForm(name)
    except ValueError:
        raise InputError(
            f"station form '{name}' is unknown; known: {', '.join(StationForm)}"
        ) from None


def _refuse(arguments: Mapping[str, object], form: str) -> None:
    """Refuse arguments that a form would ignore."""
    given = [name for name, value in arguments.items() if value is not None]
    if given:
        raise InputError(f"the {form} station takes no {', '.join(given)}; leave it out")


def _calibrated_head(cell: Cell, site: Site) -> StereoHead:
    """Return the calibrated head; with a depth camera, whose head is not used, the nominal one."""
    if cell.scenario.sensor.kind != "stereo" and not site.calibration:
        return nominal_calibration().stereo_head(cell.limits.head)
    return calibration_of(site).stereo_head(cell.limits.head)
