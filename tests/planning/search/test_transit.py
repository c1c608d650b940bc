"""Transits: straight lines, detours around an obstacle, and the answer when there is none."""

import dataclasses as dc
from pathlib import Path

import numpy as np
import pytest

from unwrinkle.models.robot import Cell, load_cell
from unwrinkle.planning.robot.collision import CollisionModel
from unwrinkle.planning.search.planner import FlatteningPlanner
from unwrinkle.planning.search.settings import PlannerSettings, TransitSettings
from unwrinkle.planning.search.transit import TransitPlanner


def with_box(cell: Cell, folder: Path, size: str, place: str) -> Cell:
    """The cell with one more box in it; size and place as three numbers each, m."""
    model = folder / "box.sdf"
    model.write_text(
        "<sdf version='1.9'><model name='box'><link name='box'><collision name='c'><geometry>"
        f"<box><size>{size}</size></box></geometry></collision></link></model></sdf>"
    )
    extra = folder / "box.dmd.yaml"
    extra.write_text(
        f"directives:\n- add_model: {{name: box, file: file://{model}}}\n"
        f"- add_weld: {{parent: world, child: box::box, X_PC: {{translation: [{place}]}}}}\n"
    )
    directives = [*cell.scenario.directives, str(extra)]
    return load_cell(dc.replace(cell.scenario, directives=directives))


def planner_of(
    cell: Cell, budget: float, seed: int = 0, settings: TransitSettings | None = None
) -> tuple[TransitPlanner, CollisionModel]:
    collision = CollisionModel(cell, contact=False)
    return TransitPlanner(cell, collision, budget, seed, settings=settings), collision


#: Without via points, so that only RRT-Connect finds a way.
SEARCHED = TransitSettings(leans=())


SWUNG = np.array([0.9, *12 * [0.0]])


def test_free_line_is_taken(cell):
    transit = planner_of(cell, 1.0)[0].plan(np.zeros(13), SWUNG)
    assert transit is not None and transit.kind == "line"
    assert np.array_equal(transit.points, [np.zeros(13), SWUNG])


@pytest.mark.parametrize(
    ("seed", "settings", "kind"), [(0, None, "via"), (0, SEARCHED, "rrt"), (1, SEARCHED, "rrt")]
)
def test_detour_around_a_post_is_free_and_ends_where_it_should(
    cell, tmp_path, seed, settings, kind
):
    blocked = with_box(cell, tmp_path, "0.06 0.06 1.5", "0.75, -0.62, 0.75")
    transits, collision = planner_of(blocked, 20.0, seed, settings)
    assert collision.free(np.zeros(13)) and collision.free(SWUNG)
    assert not collision.edge_free(np.zeros(13), SWUNG)
    transit = transits.plan(np.zeros(13), SWUNG)
    assert transit is not None and transit.kind == kind
    assert np.array_equal(transit.points[0], np.zeros(13))
    assert np.allclose(transit.points[-1], SWUNG)
    assert collision.path_free(transit.points)
    inside = (transit.points >= blocked.limits.lower) & (transit.points <= blocked.limits.upper)
    assert np.all(inside)


def test_same_seed_same_detour(cell, tmp_path):
    blocked = with_box(cell, tmp_path, "0.06 0.06 1.5", "0.75, -0.62, 0.75")
    points = [
        planner_of(blocked, 20.0, 5, SEARCHED)[0].plan(np.zeros(13), SWUNG).points for _ in range(2)
    ]
    assert np.array_equal(*points)


def test_a_search_that_finds_no_way_in_its_time_is_none(cell, tmp_path):
    blocked = with_box(cell, tmp_path, "0.06 0.06 1.5", "0.75, -0.62, 0.75")
    assert planner_of(blocked, 0.0, 0, SEARCHED)[0].plan(np.zeros(13), SWUNG) is None


def test_no_way_is_an_answer_with_its_cause(cell, tmp_path, make_target):
    """A roof over the table keeps both arms from coming down to it."""
    roofed = with_box(cell, tmp_path, "1.6 0.5 0.02", "0, -1.15, 1.05")
    settings = dc.replace(PlannerSettings(), budget=3.0, transit_budget=0.3)
    result = FlatteningPlanner(roofed, settings).plan(make_target(), arms="dual")
    assert result.plan is None
    assert result.failure.cause == "collision"
    assert "no dual-arm motion" in result.failure.message and "box::box" in result.failure.message
