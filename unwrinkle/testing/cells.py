"""The shipped cell, its planner and a plan, each made once, and cells that differ from it."""

import dataclasses as dc
from functools import cache
from pathlib import Path

import numpy as np
import yaml

from unwrinkle.models.robot import Cell, load_cell
from unwrinkle.models.scenario import Scenario, load_scenario, resolve
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.search.planner import FlatteningPlanner
from unwrinkle.testing.targets import flattening_task

_TABLE = "[0, -1.2, 0.70]"


@cache
def cell() -> Cell:
    """Load the shipped cell."""
    return load_cell()


@cache
def planner() -> FlatteningPlanner:
    """Build its planner."""
    return FlatteningPlanner(cell())


@cache
def plan() -> FlatteningPlan:
    """Plan a dual-arm motion in it, from home."""
    found = planner().plan(flattening_task((0.0, -1.10), 0.2)).plan
    assert found is not None
    return found


def home() -> np.ndarray:
    """Return the posture (13,) at home, rad."""
    return np.array(cell().robot.named_states["home"], dtype=float)


def with_table(folder: Path, y: float, scenario: Scenario | None = None) -> Scenario:
    """Return a scenario whose working table stands at another y, m, in a file of its own."""
    scenario = scenario or load_scenario()
    text = resolve(scenario.directives[0]).read_text(encoding="utf-8")
    assert text.count(_TABLE) == 1, "the working table's place in the shipped cell"
    path = folder / "cell.dmd.yaml"
    path.write_text(text.replace(_TABLE, f"[0, {y}, 0.70]"), encoding="utf-8")
    return dc.replace(scenario, directives=[str(path)])


def with_jerk(folder: Path, share: float) -> Scenario:
    """Return a scenario whose limits file states a share of the shipped jerk limits."""
    scenario = load_scenario()
    limits = yaml.safe_load(resolve(scenario.limits).read_text(encoding="utf-8"))
    for axis in (*limits["arm"].values(), *limits["turntable"].values()):
        axis["jerk"] = share * float(axis["jerk"])
    path = folder / "limits.yaml"
    path.write_text(yaml.safe_dump(limits), encoding="utf-8")
    return dc.replace(scenario, limits=str(path))
