"""The scenario's settings of the closed loop."""

import dataclasses as dc
import math

import numpy as np
import pytest

from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import build_robot_diagram, load_cell
from unwrinkle.models.scenario import Scenario, load_scenario, with_sensor


@pytest.mark.parametrize(
    ("part", "key", "value", "message"),
    [
        ("sensor", "kind", "radar", "sensor kind 'radar' is unknown; known: stereo, depth"),
        ("sensor", "scale", 0.3, "scale is 0.3"),
        ("sensor", "depth_camera_place", [0.0, 1.0], "x, y, z"),
        ("sensor", "depth_camera_place", [0.0, math.nan, 1.0], "x, y, z"),
        ("loop", "arms", "three", "known: any, dual, single"),
        ("loop", "mode", "toe", "known: foot, paper, between"),
        ("loop", "order", "colour", "known: volume, pull, height, length, together"),
        ("loop", "section", "end", "known: centre, highest"),
        ("loop", "pull", "all", "known: wrinkle, section"),
        ("sensor", "noise", -1.0, "noise is -1; give 0 to 10"),
        ("sensor", "noise", math.nan, "noise is nan"),
        ("loop", "halting_height", math.nan, "halting_height is nan"),
        ("loop", "actions", -1, "actions must be 0 to 1000"),
        ("loop", "grasp_attempts", 0, "grasp_attempts at least 1"),
        ("loop", "pull_gain", 0.5, "pull_gain must be 1 to 3"),
        ("loop", "pull_extra", math.nan, "pull_extra 0 to 0.05"),
        ("loop", "least_gain", 1.0, "least_gain is 1"),
        ("station", "form", "dream", "station form 'dream'"),
        ("station", "plant_step", 0.0, "plant_step is 0"),
        ("station", "cloth_step", 0.5, "up to 0.1"),
    ],
)
def test_settings_out_of_range_are_refused(part: str, key: str, value: object, message: str):
    scenario = Scenario()
    changed = dc.replace(scenario, **{part: dc.replace(getattr(scenario, part), **{key: value})})
    with pytest.raises(InputError, match=message):
        changed.validate()


@pytest.mark.parametrize(("key", "value"), [("outline", "sock"), ("start", "ironed"), ("nodes", 5)])
def test_garments_that_nobody_knows_are_refused(key: str, value: object):
    scenario = Scenario()
    garment = dc.replace(scenario.station.garment, **{key: value})
    changed = dc.replace(scenario, station=dc.replace(scenario.station, garment=garment))
    with pytest.raises(InputError, match=str(value)):
        changed.validate()


def test_an_unknown_key_of_the_loop_is_refused(tmp_path):
    path = tmp_path / "site.scenario.yaml"
    path.write_text("Site:\n  loop: {actoins: 3}\n")
    with pytest.raises(InputError, match="actoins"):
        load_scenario(path)


def test_the_shipped_file_and_the_defaults_agree():
    assert load_scenario() == Scenario()


def test_a_depth_camera_is_a_body_of_the_cell_where_it_looks_from():
    scenario = with_sensor(load_scenario(), "depth")
    cell = load_cell(scenario)
    plant = build_robot_diagram(cell).plant()
    body = plant.GetBodyByName("body", plant.GetModelInstanceByName("depth_camera"))
    place = body.EvalPoseInWorld(plant.CreateDefaultContext()).translation()
    assert np.allclose(place, scenario.sensor.depth_camera_place)
    assert cell.robot_hash != load_cell().robot_hash
    assert with_sensor(with_sensor(scenario, "depth"), "stereo") == load_scenario()
