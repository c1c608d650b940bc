"""``unwrinkle garment``: what is known of a garment, for the search for folds."""

from pathlib import Path
from typing import Annotated

import typer

from unwrinkle.commands._shared.capture import (
    CameraOption,
    CaptureArgument,
    CaptureOptions,
    ColourOption,
    HeadOption,
    PoseOption,
    RegisteredOption,
    SeedOption,
    SensorOption,
    flattener_for,
    observed,
)
from unwrinkle.commands._shared.examples import examples
from unwrinkle.commands._shared.settings import ScenarioOption, SetOption

garment = typer.Typer(
    help="Keep what is known of a garment: flat area, outline and thickness. With it, a folded "
    "garment is told from a wrinkled one.",
    no_args_is_help=True,
)


@garment.command(
    epilog=examples(
        "unwrinkle garment learn left.png right.png --head head.yaml --out towel.garment.yaml",
        "unwrinkle garment learn depth.png --camera xtion-pro-live --out shirt.garment.yaml",
    )
)
def learn(
    files: CaptureArgument,
    out: Annotated[Path, typer.Option(help="File to write, *.garment.yaml.")],
    name: Annotated[
        str | None, typer.Option(help="Name of the garment (default: the file's).")
    ] = None,
    head: HeadOption = None,
    camera: CameraOption = None,
    colour: ColourOption = None,
    registered: RegisteredOption = None,
    pose: PoseOption = None,
    sensor: SensorOption = None,
    scenario: ScenarioOption = None,
    settings: SetOption = None,
    seed: SeedOption = 0,
) -> None:
    """Learn a garment from a look at it lying flat."""
    from rich.console import Console

    from unwrinkle.models.robot import load_cell
    from unwrinkle.models.scenario import load_scenario
    from unwrinkle.perception.folds.learn_garment import learn_garment

    options = CaptureOptions(
        files=tuple(files),
        head=head,
        camera=camera,
        colour=colour,
        registered=registered,
        pose=pose,
        sensor=sensor,
        seed=seed,
    )
    flattener = flattener_for(options, load_cell(load_scenario(scenario, settings=settings or ())))
    observation = observed(options, flattener)
    label = name or out.name.removesuffix(".yaml").removesuffix(".garment")
    known = learn_garment(observation.analysis.range_map, label)
    known.save(out)
    Console().print(
        f"{known.name}: {1e4 * known.flat_area:.0f} cm2, {1e3 * known.thickness:.1f} mm thick, "
        f"outline of {len(known.outline)} corners; written to {out}",
        highlight=False,
        soft_wrap=True,
    )
