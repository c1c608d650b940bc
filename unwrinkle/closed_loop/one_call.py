"""Run the closed loop in one call."""

from pathlib import Path

from unwrinkle.closed_loop.run import RunEnding
from unwrinkle.closed_loop.session import Choices, begin_run, begin_run_on
from unwrinkle.flattening.state_machine import Approve
from unwrinkle.models.errors import InputError
from unwrinkle.systems.station.base import Station


def flatten(
    folder: str | Path,
    *,
    scenario: str | Path | None = None,
    seed: int = 0,
    garment: str | None = None,
    start: str | None = None,
    sensor: str | None = None,
    scale: float | None = None,
    arms: str | None = None,
    actions: int | None = None,
    station: str | Station | None = None,
    approve: Approve | None = None,
) -> RunEnding:
    """Run the closed loop until the garment is flat or the run stops.

    Options left out are taken from the scenario.

    Args:
        folder: folder of the run, for pictures, plans, verdicts, motions, report and replay.
        scenario: scenario file; the shipped one if left out.
        seed: seed of all random numbers.
        garment: `towel`, `dishcloth`, `tshirt` or `trousers`.
        start: `bunched`, `ridge`, `pinched`, `dropped` or `flat`.
        sensor: `stereo`, `xtion`, `tof` or `truth`.
        scale: scale of the head's pictures: 1 (16 megapixels), 0.5, 0.25 or 0.125.
        arms: `any`, `dual` or `single`.
        actions: maximum number of actions.
        station: `sim`, or `loopback`: the drivers over real connections, against virtual devices;
            or a station of `make_station`, which states the scenario and the seed.
        approve: callback that asks the operator about each verified plan; required by a station
            that moves a robot.

    Returns:
        How it ended: `status` (flat, stopped, fault, interrupted) and `reason`.

    Raises:
        InputError: an input is bad, choices are given beside a station, or the folder holds a run
            already or cannot be written.
    """
    choices = Choices(
        garment=garment,
        start=start,
        seed=seed,
        sensor=sensor,
        scale=scale,
        arms=arms,
        actions=actions,
        station=None if isinstance(station, Station) else station,
    )
    if isinstance(station, Station):
        if scenario is not None or choices != Choices(seed=0):
            raise InputError("the station states scenario and seed; leave the other choices out")
        return begin_run_on(station, Path(folder), approve=approve).run()
    file = None if scenario is None else Path(scenario)
    return begin_run(choices, file, Path(folder), approve=approve).run()
