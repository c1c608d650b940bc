"""``unwrinkle analyse``: find the wrinkles, pictures and flattening target of a capture."""

from unwrinkle.commands._shared.capture import (
    AtOption,
    CameraOption,
    CaptureArgument,
    CaptureOptions,
    ColourOption,
    DepthUnitOption,
    HeadOption,
    ModeOption,
    OutOption,
    PicturesOption,
    PoseOption,
    RegionOption,
    RegisteredOption,
    SeedOption,
    SensorOption,
    YawOption,
    check_folder,
    finished_folder,
    flattener_for,
    observed,
    print_garment,
    save_analysis,
)
from unwrinkle.commands._shared.settings import ScenarioOption, SetOption
from unwrinkle.garbage import gc_disabled

EXAMPLES = (
    "unwrinkle analyse depth.png --camera xtion-pro-live",
    "unwrinkle analyse left.png right.png --head head.yaml --out out/first --no-pictures",
)


@gc_disabled()  # a short process: collecting frees nothing
def analyse(
    files: CaptureArgument,
    head: HeadOption = None,
    camera: CameraOption = None,
    colour: ColourOption = None,
    registered: RegisteredOption = None,
    pose: PoseOption = None,
    depth_unit: DepthUnitOption = None,
    at: AtOption = None,
    region: RegionOption = None,
    yaw: YawOption = 0.0,
    sensor: SensorOption = None,
    mode: ModeOption = None,
    scenario: ScenarioOption = None,
    settings: SetOption = None,
    out: OutOption = None,
    seed: SeedOption = 0,
    pictures: PicturesOption = True,
) -> None:
    """Find the wrinkles of a garment and the target for the largest."""
    from rich.console import Console

    from unwrinkle.flattening.flattener import Choice
    from unwrinkle.models.robot import load_cell
    from unwrinkle.models.scenario import load_scenario

    options = CaptureOptions(
        files=tuple(files),
        head=head,
        camera=camera,
        colour=colour,
        registered=registered,
        pose=pose,
        depth_unit=depth_unit,
        at=at,
        region=region,
        yaw=yaw,
        sensor=sensor,
        mode=mode,
        seed=seed,
    )
    flattener = flattener_for(options, load_cell(load_scenario(scenario, settings=settings or ())))
    folder = out or options.folder
    check_folder(folder)
    observation = observed(options, flattener)
    chosen = flattener.choose(observation)
    with finished_folder(folder) as work:
        save_analysis(work, observation, chosen, options, pictures=pictures, singles=True)
    console = Console()
    print_garment(console, observation, chosen)
    if isinstance(chosen, Choice):
        for number, hand in enumerate(chosen.target.hands):
            console.print(
                f"hand {number}: grasp ({hand.p_WG[0]:+.3f}, {hand.p_WG[1]:+.3f}) m, pull "
                f"{1e3 * hand.pull_distance:.1f} mm along ({hand.pull_direction[0]:+.2f}, "
                f"{hand.pull_direction[1]:+.2f})",
                highlight=False,
            )
    else:
        console.print(f"no target: {chosen.stop.reason}", highlight=False)
    console.print(f"written to {folder}/", highlight=False)
