"""``unwrinkle plan``: a capture in; a verified dual-arm flattening plan and its page out."""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from unwrinkle.commands._shared.capture import (
    CameraOption,
    CaptureArgument,
    CaptureOptions,
    ColourOption,
    HeadOption,
    ModeOption,
    OutOption,
    PicturesOption,
    PoseOption,
    RegisteredOption,
    ScenarioOption,
    SeedOption,
    SensorOption,
    YawOption,
    analysed,
    finished_folder,
    print_wrinkles,
    save_analysis,
)
from unwrinkle.commands._shared.posture import StartOption, posture
from unwrinkle.models.errors import NoSafePlanError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray
    from rich.console import Console

    from unwrinkle.models.robot import Cell
    from unwrinkle.perception.wrinkles.analysis import Analysis
    from unwrinkle.planning.search.planner import PlanResult
    from unwrinkle.planning.verification.verdict import Verdict


_PLAN, _VERDICT, _PAGE = _PLAN_FILES = ("plan.npz", "verdict.json", "preview.html")


def plan(
    files: CaptureArgument,
    head: HeadOption = None,
    camera: CameraOption = None,
    colour: ColourOption = None,
    registered: RegisteredOption = None,
    pose: PoseOption = None,
    yaw: YawOption = 0.0,
    sensor: SensorOption = None,
    mode: ModeOption = "foot",
    arms: Annotated[str, typer.Option(help="any (two if possible), dual or single.")] = "any",
    speed: Annotated[
        float | None, typer.Option(help="Fraction of the catalogue speed [the scenario's].")
    ] = None,
    start: StartOption = None,
    scenario: ScenarioOption = None,
    out: OutOption = None,
    seed: SeedOption = 0,
    pictures: PicturesOption = True,
) -> None:
    """Plan and verify the flattening of the largest wrinkle that can be reached; write the plan and its page."""
    from rich.console import Console

    from unwrinkle.models.robot import load_cell
    from unwrinkle.models.scenario import load_scenario

    options = CaptureOptions(
        tuple(files), head, camera, colour, registered, pose, yaw, sensor, mode, seed
    )
    console = Console()
    clock = _Clock()
    cell = load_cell(load_scenario(scenario))
    if speed is not None:
        cell = cell.with_speed(speed)
    standing = None if start is None else posture(start, cell.robot)
    clock.lap("start")
    analysis = analysed(options, cell)
    clock.lap("perception")
    folder = out or options.folder
    chosen = _planned(analysis, cell, arms, standing, clock)
    print_wrinkles(console, analysis, None if chosen is None else chosen[0])
    if chosen is None:
        with finished_folder(folder, outdated=_PLAN_FILES) as work:
            save_analysis(work, analysis, options, pictures=pictures)
        console.print(
            f"flat: no wrinkle asks for a pull of {1e3 * analysis.profile.halting_pull:.0f} mm; "
            f"nothing to plan. Analysis in {folder}/",
            highlight=False,
        )
        return
    index, result, verdict = chosen
    with finished_folder(folder) as work:
        save_analysis(work, analysis, options, pictures=pictures)
        clock.lap("pictures")
        _save_plan(work, result, verdict, cell, options.name)
        clock.lap("page")
    _print_plan(console, index, result, verdict)
    console.print(f"times: {clock}", highlight=False)
    console.print(f"plan    {folder / 'plan.npz'}", highlight=False)
    console.print(f"page    {folder / 'preview.html'}", highlight=False)


def _planned(
    analysis: "Analysis",
    cell: "Cell",
    arms: str,
    start: "NDArray[np.float64] | None",
    clock: "_Clock",
) -> "tuple[int, PlanResult, Verdict] | None":
    """A verified plan for the largest wrinkle that has one; None if the garment is flat.

    Raises:
        NoSafePlanError: there are wrinkles to flatten, and no verified motion for any.
    """
    from unwrinkle.flattening.verified_planning import plan_verified
    from unwrinkle.perception.target import NoTarget
    from unwrinkle.planning.search.planner import FlatteningPlanner
    from unwrinkle.viewer.garment_mesh import garment_of

    if analysis.flat:
        return None
    planner = FlatteningPlanner(cell)
    clock.lap("cell model")
    reasons: list[str] = []
    for index in analysis.worth_pulling:
        target = analysis.target_for(index)
        if isinstance(target, NoTarget):
            reasons.append(f"wrinkle {index + 1}: {target.reason}")
            continue
        garment = garment_of(analysis, index)
        clock.lap("garment mesh")
        found = plan_verified(planner, cell, target, start=start, garment=garment, arms=arms)
        result = found.result
        clock.add("planning", result.timings.total)
        clock.lap("verification", less=result.timings.total)
        if found.verdict is not None:
            return index, result, found.verdict
        message = result.failure.message if result.failure is not None else "no motion"
        reasons.append(f"wrinkle {index + 1}: {message}")
    raise NoSafePlanError("no verified plan: " + "; ".join(reasons))


def _save_plan(
    folder: Path, result: "PlanResult", verdict: "Verdict", cell: "Cell", title: str
) -> None:
    from unwrinkle.models.files import write_json, write_text
    from unwrinkle.viewer.overlay import PreviewSummary
    from unwrinkle.viewer.preview import preview_page

    assert result.plan is not None
    result.plan.save(folder / _PLAN)
    write_json(folder / _VERDICT, verdict.to_json())
    page = preview_page(result.plan, cell, PreviewSummary.of(verdict), title=title)
    write_text(folder / _PAGE, page)


def _print_plan(console: "Console", index: int, result: "PlanResult", verdict: "Verdict") -> None:
    from math import degrees

    plan = result.plan
    assert plan is not None
    kind = "dual-arm" if plan.dual else "single-arm"
    tools = []
    for name, arm in zip(("right", "left"), plan.arms, strict=True):
        if arm is not None:
            pull = 1e3 * arm.share * plan.target.hands[arm.side].pull_distance
            tools.append(f"{name} arm pulls {pull:.1f} mm, tilt {degrees(arm.tilt):.0f} deg")
    console.print(
        f"{kind} plan for wrinkle {index + 1}: turn-table {degrees(plan.turntable):.0f} deg, "
        f"{', '.join(tools)}; motion {plan.motion_time:.2f} s",
        highlight=False,
    )
    if plan.note:
        console.print(f"[bold]note[/bold]: {plan.note}", highlight=False)
    console.print(verdict.summary(), highlight=False)


class _Clock:
    """Laps of the wall clock by name."""

    def __init__(self) -> None:
        self._last = time.perf_counter()
        self._laps: dict[str, float] = {}

    def lap(self, name: str, less: float = 0.0) -> None:
        """Add the time since the last lap under a name, less some seconds that are counted elsewhere."""
        now = time.perf_counter()
        self.add(name, now - self._last - less)
        self._last = now

    def add(self, name: str, seconds: float) -> None:
        """Add some seconds under a name."""
        self._laps[name] = self._laps.get(name, 0.0) + seconds

    def __str__(self) -> str:
        return ", ".join(f"{name} {seconds:.2f} s" for name, seconds in self._laps.items())
