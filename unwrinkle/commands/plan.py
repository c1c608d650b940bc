"""``unwrinkle plan``: compute a verified flattening plan of a capture, and its preview page."""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

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
from unwrinkle.commands._shared.posture import StartOption, posture
from unwrinkle.commands._shared.settings import ScenarioOption, SetOption
from unwrinkle.garbage import gc_disabled
from unwrinkle.models.errors import NoVerifiedPlanError

if TYPE_CHECKING:
    from rich.console import Console

    from unwrinkle.flattening.flattener import Choice, NoProposal
    from unwrinkle.flattening.observation import Observation
    from unwrinkle.models.robot import Cell
    from unwrinkle.planning.plan import FlatteningPlan
    from unwrinkle.planning.verification.verdict import Verdict


_PLAN = "plan.npz"
_VERDICT = "verdict.json"
_PAGE = "preview.html"

EXAMPLES = (
    "unwrinkle plan depth.png --camera xtion-pro-live --pose pose.yaml",
    "unwrinkle plan left.png right.png --head head.yaml --arms dual --set loop.mode=paper",
)


@gc_disabled()  # a short process: collecting frees nothing
def plan(
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
    arms: Annotated[
        str | None,
        typer.Option(help="any (two if possible), dual or single (default: the scenario's)."),
    ] = None,
    speed: Annotated[
        float | None,
        typer.Option(help="Fraction of the catalogue speed (default: the scenario's)."),
    ] = None,
    start: StartOption = None,
    scenario: ScenarioOption = None,
    settings: SetOption = None,
    out: OutOption = None,
    seed: SeedOption = 0,
    pictures: PicturesOption = True,
) -> None:
    """Plan and verify the flattening of the largest reachable wrinkle.

    Write the plan and its page.
    """
    from rich.console import Console

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
    console = Console()
    clock = _Clock()
    cell = load_cell(load_scenario(scenario, settings=settings or ()))
    if speed is not None:
        cell = cell.with_speed(speed)
    standing = None if start is None else posture(start, cell.robot)
    flattener = flattener_for(options, cell)
    clock.lap("start")
    folder = out or options.folder
    check_folder(folder)
    observation = observed(options, flattener)
    clock.lap("perception")
    proposal = flattener.propose(observation, start=standing, arms=arms)
    if proposal.plan is None:
        _nothing_planned(
            proposal,
            observation,
            options=options,
            folder=folder,
            console=console,
            pictures=pictures,
        )
        return
    planning = proposal.planned.result.timings.total
    clock.add("planning", planning)
    clock.lap("verification", less=planning)
    print_garment(console, observation, proposal.choice)
    for text in proposal.refused:
        console.print(f"[bold]skipped[/bold]: {text}", highlight=False)
    with finished_folder(folder) as work:
        save_analysis(work, observation, proposal.choice, options, pictures=pictures)
        clock.lap("pictures")
        _save_plan(work, proposal.plan, proposal.verdict, cell, options.name)
        clock.lap("page")
    _print_plan(console, proposal.choice, proposal.plan, proposal.verdict)
    console.print(f"times: {clock}", highlight=False)
    console.print(f"plan    {folder / _PLAN}", highlight=False)
    console.print(f"page    {folder / _PAGE}", highlight=False)


def _nothing_planned(
    proposal: "NoProposal",
    observation: "Observation",
    *,
    options: CaptureOptions,
    folder: Path,
    console: "Console",
    pictures: bool,
) -> None:
    """Write the analysis of a garment that gets no plan.

    Raises:
        NoVerifiedPlanError: the garment is not flat, and no plan for it is verified.
    """
    from unwrinkle.flattening.flattener import NoChoice

    chosen = NoChoice(proposal.stop, proposal.state, proposal.refusals)
    print_garment(console, observation, chosen)
    if not proposal.flat and proposal.stop.state is None:
        raise NoVerifiedPlanError(f"no verified plan: {proposal.reason}")
    with finished_folder(folder, outdated=(_PLAN, _VERDICT, _PAGE)) as work:
        save_analysis(work, observation, chosen, options, pictures=pictures)
    if not proposal.flat:
        raise NoVerifiedPlanError(f"no verified plan: {proposal.reason}; analysis in {folder}/")
    console.print(f"{proposal.reason}; nothing to plan. Analysis in {folder}/", highlight=False)


def _save_plan(
    folder: Path, plan: "FlatteningPlan", verdict: "Verdict", cell: "Cell", title: str
) -> None:
    from unwrinkle.models.io.files import write_json, write_text
    from unwrinkle.viewer.overlay import PreviewSummary
    from unwrinkle.viewer.preview import preview_page

    plan.save(folder / _PLAN)
    write_json(folder / _VERDICT, verdict.to_json())
    page = preview_page(plan, cell, PreviewSummary.of(verdict), title=title)
    write_text(folder / _PAGE, page)


def _print_plan(
    console: "Console", choice: "Choice", plan: "FlatteningPlan", verdict: "Verdict"
) -> None:
    from math import degrees

    kind = "dual-arm" if plan.dual else "single-arm"
    tools = []
    for name, arm in zip(("right", "left"), plan.arms, strict=True):
        if arm is not None:
            pull = 1e3 * arm.share * plan.target.hands[arm.side].pull_distance
            tools.append(f"{name} arm pulls {pull:.1f} mm, tilt {degrees(arm.tilt):.0f} deg")
    console.print(
        f"{kind} plan for wrinkle {choice.decision.wrinkle.index + 1}: turn-table "
        f"{degrees(plan.turntable):.0f} deg, {', '.join(tools)}; motion {plan.motion_time:.2f} s",
        highlight=False,
    )
    if plan.note:
        console.print(f"[bold]note[/bold]: {plan.note}", highlight=False)
    console.print(verdict.summary(), highlight=False)


class _Clock:
    """Named laps of the wall clock, s."""

    def __init__(self) -> None:
        self._last = time.perf_counter()
        self._laps: dict[str, float] = {}

    def lap(self, name: str, less: float = 0.0) -> None:
        """Add the time since the last lap under a name, less the seconds counted elsewhere."""
        now = time.perf_counter()
        self.add(name, now - self._last - less)
        self._last = now

    def add(self, name: str, seconds: float) -> None:
        """Add seconds under a name."""
        self._laps[name] = self._laps.get(name, 0.0) + seconds

    def __str__(self) -> str:
        return ", ".join(f"{name} {seconds:.2f} s" for name, seconds in self._laps.items())
