"""The blades as the gripper's description states them."""

import numpy as np
import pytest
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from unwrinkle.models.blades import load_blades
from unwrinkle.models.io.loader_yaml import models_dir


def test_numbers_of_the_description() -> None:
    blades = load_blades()
    assert blades.width == pytest.approx(0.025)
    assert blades.thickness == pytest.approx(0.003)
    assert blades.lower_end == pytest.approx(0.0)
    assert blades.upper_end == pytest.approx(-0.010)
    assert blades.gap(0.030) == pytest.approx((0.003, 0.033))
    assert blades.middle(0.030) == pytest.approx((0.018, -0.005))


def test_the_upper_tip_is_where_drake_has_it() -> None:
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModels(str(models_dir() / "gripper.urdf"))
    plant.Finalize()
    context = plant.CreateDefaultContext()
    plant.GetJointByName("grip").set_translation(context, 0.030)
    finger, tcp = plant.GetFrameByName("upper_finger"), plant.GetFrameByName("tcp")
    inner_end = np.array([0.0, -0.0135, 0.290])  # of the tip's box in its link
    place = plant.CalcPointsPositions(context, finger, inner_end, tcp).ravel()
    blades = load_blades()
    assert place == pytest.approx([0.0, blades.gap(0.030)[1], blades.upper_end])
