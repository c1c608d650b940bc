"""``unwrinkle export``: write plans, range maps and run logs in the formats of other tools."""

from pathlib import Path
from typing import Annotated

import typer

from unwrinkle.commands._shared.examples import examples
from unwrinkle.commands._shared.settings import ScenarioOption, SetOption
from unwrinkle.models.errors import InputError, NoVerifiedPlanError

export = typer.Typer(
    help="Write a plan, a range map or a run log in the format of another tool.",
    no_args_is_help=True,
)


@export.command(
    epilog=examples(
        "unwrinkle export plan out/first/plan.npz --out plan.json",
        "unwrinkle export plan out/first/plan.npz --out plan.mcap --scenario lab.scenario.yaml",
    )
)
def plan(
    plan: Annotated[Path, typer.Argument(metavar="PLAN", help="A plan made by `unwrinkle plan`.")],
    out: Annotated[Path, typer.Option(help="File to write: *.json, or *.mcap for ROS 2.")],
    scenario: ScenarioOption = None,
    settings: SetOption = None,
) -> None:
    """Verify a plan and write it as ROS trajectory_msgs/JointTrajectory, one per segment.

    The points are the samples that execute sends at the plan's own speed: positions in rad,
    velocities in rad/s, no accelerations; a controller must interpolate them cubically. Gripper
    events are listed apart. Exit code 3 if the plan is not verified.
    """
    from rich.console import Console

    from unwrinkle.exports.joint_trajectory import export_trajectory
    from unwrinkle.models.robot import load_cell
    from unwrinkle.models.scenario import load_scenario
    from unwrinkle.planning.plan import FlatteningPlan
    from unwrinkle.planning.verification.verifier import verify

    cell = load_cell(load_scenario(scenario, settings=settings or ()))
    loaded = FlatteningPlan.load(plan)
    loaded.check_made_for(cell)
    verdict = verify(loaded, cell)
    if not verdict.passed:
        raise NoVerifiedPlanError(verdict.summary())
    count = export_trajectory(loaded, cell, out)
    Console().print(
        f"{out}: {len(loaded.segments)} trajectories, {count} points; plan {loaded.content_hash}",
        highlight=False,
        soft_wrap=True,
    )


@export.command(
    "map",
    epilog=examples(
        "unwrinkle export map out/first/range_map.npz --out garment.ply --garment",
        "unwrinkle export map out/first/range_map.npz --out view.pcd",
    ),
)
def map_(
    range_map: Annotated[
        Path, typer.Argument(metavar="MAP", help="range_map.npz of `unwrinkle analyse` or `plan`.")
    ],
    out: Annotated[Path, typer.Option(help="File to write: *.ply or *.pcd.")],
    garment: Annotated[
        bool, typer.Option("--garment", help="Write the garment's points alone.")
    ] = False,
) -> None:
    """Write a range map as a point cloud in the world frame.

    Metres, z up, the origin at the robot's base on the floor; a field `garment` is 1 on the
    garment.
    """
    from rich.console import Console

    from unwrinkle.exports.point_cloud import export_cloud
    from unwrinkle.perception.range_map import RangeMap

    count = export_cloud(RangeMap.load(range_map), out, garment_only=garment)
    Console().print(f"{out}: {count} points", highlight=False, soft_wrap=True)


@export.command(
    epilog=examples(
        "unwrinkle export log run.jsonl --out run.mcap",
        "unwrinkle export log run.jsonl --out run.rrd --scenario lab.scenario.yaml",
    )
)
def log(
    path: Annotated[Path, typer.Argument(metavar="LOG", help="Log of `unwrinkle execute`.")],
    out: Annotated[Path, typer.Option(help="File to write: *.mcap for Foxglove, *.rrd for rerun.")],
    scenario: Annotated[
        Path | None, typer.Option(help="Scenario of the cell; the log's own if left out.")
    ] = None,
    settings: SetOption = None,
) -> None:
    """Write a run log for Foxglove (its own schemas) or rerun.

    Joint states in rad and rad/s, frames of the robot's bodies in the world (m), its shapes, the
    garment of the plan where the plan file is still there, and the events.
    """
    from rich.console import Console

    from unwrinkle.exports.foxglove_log import export_foxglove
    from unwrinkle.exports.rerun_log import export_rerun
    from unwrinkle.hardware.run_log.reader import read_run_log
    from unwrinkle.logs.replay import cell_of, plan_of

    if out.suffix not in (".mcap", ".rrd"):
        raise InputError(f"{out}: give a file *.mcap or *.rrd for a run log")
    records = read_run_log(path)
    cell = cell_of(records, scenario, settings or ())
    if out.suffix == ".rrd":
        export_rerun(records, out, cell, plan_of(records))
        Console().print(f"{out}", highlight=False, soft_wrap=True)
        return
    count = export_foxglove(records, out, cell, plan_of(records))
    Console().print(f"{out}: {count} messages", highlight=False, soft_wrap=True)
