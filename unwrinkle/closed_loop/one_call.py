"""Run the closed loop in one call."""

from pathlib import Path

from unwrinkle.closed_loop.run import RunEnding
from unwrinkle.closed_loop.session import Choices, begin_run


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
    station: str | None = None,
) -> RunEnding:
    """Run the closed loop in the simulated cell until the garment is flat or the run stops.

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
        station: `sim`, or `loopback`: the drivers over real connections, against virtual devices.

    Returns:
        How it ended: `status` (flat, stopped, fault, interrupted) and `reason`.

    Raises:
        InputError: an input is bad, or the folder holds a run already or cannot be written.
    """
    choices = Choices(
        garment=garment,
        start=start,
        seed=seed,
        sensor=sensor,
        scale=scale,
        arms=arms,
        actions=actions,
        station=station,
    )
    session = begin_run(choices, None if scenario is None else Path(scenario), Path(folder))
    return session.run()
