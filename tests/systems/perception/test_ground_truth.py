"""Sensor `truth`, which reads the simulated cloth."""

import dataclasses as dc

import numpy as np
import pytest
from pydrake.common.value import Value

from unwrinkle.flattening.messages import Perceived
from unwrinkle.flattening.station_messages import DepthImage
from unwrinkle.models.cloth import load_material
from unwrinkle.models.errors import InputError
from unwrinkle.models.scenario import load_scenario, with_sensor
from unwrinkle.simulation.cloth.cloth import Cloth, ClothState
from unwrinkle.simulation.cloth.outlines import outline
from unwrinkle.systems.perception.ground_truth import TruePerceptionSystem
from unwrinkle.testing.table import TABLE


@pytest.fixture(scope="module")
def cloth() -> Cloth:
    return Cloth(outline("towel", 40), load_material("terry"), TABLE)


def looked(cloth: Cloth, state: ClothState, image: DepthImage, seed: int = 0) -> Perceived:
    system = TruePerceptionSystem(cloth, state, seed=seed)
    context = system.CreateDefaultContext()
    system.GetInputPort("image").FixValue(context, Value(image))
    system.GetInputPort("cloth").FixValue(context, Value(state))
    assert system.GetOutputPort("exposed").Eval(context)[0] == image.number
    found: Perceived = system.GetOutputPort("range_map").Eval(context)
    return found


def test_each_look_has_noise_of_its_own(cloth: Cloth) -> None:
    flat = cloth.flat((0.0, -1.1))
    maps = [looked(cloth, flat, DepthImage(number)).range_map for number in (1, 2, 1)]
    first, second, again = (found.height for found in maps if found is not None)
    assert np.array_equal(first, again) and not np.array_equal(first, second)
    assert abs(float(first[maps[0].garment].mean()) - cloth.material.thickness) < 5e-5  # type: ignore[union-attr]


def test_a_look_that_failed_shows_nothing(cloth: Cloth) -> None:
    flat = cloth.flat((0.0, -1.1))
    assert looked(cloth, flat, DepthImage()).range_map is None
    failed = looked(cloth, flat, DepthImage(3, reason="the head did not arrive"))
    assert failed.range_map is None and failed.number == 3
    assert failed.reason == "look 3: the head did not arrive" and not failed.empty


def test_no_hardware_knows_the_true_cloth() -> None:
    scenario = with_sensor(load_scenario(), "truth")
    with pytest.raises(InputError, match="simulated cloth itself; on hardware choose stereo"):
        dc.replace(scenario, station=dc.replace(scenario.station, form="hardware")).validate()
