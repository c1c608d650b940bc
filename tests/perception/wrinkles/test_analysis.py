import json
from dataclasses import replace

import numpy as np
import pytest

from unwrinkle.flattening.flattener import Choice, NoChoice, choose
from unwrinkle.flattening.observation import Observation
from unwrinkle.flattening.policy import PolicyState, Stop, decide
from unwrinkle.models.errors import InputError
from unwrinkle.models.scenario import LoopSettings
from unwrinkle.perception.depth.range_mapping import load_capture, range_map_from_capture
from unwrinkle.perception.folds.garment_state import GarmentState
from unwrinkle.perception.sensor import noise_profile
from unwrinkle.perception.target import NoTarget
from unwrinkle.perception.wrinkles.analysis import analyse
from unwrinkle.simulation.rendering.synthetic_towel import Ridge, Towel
from unwrinkle.testing.table import GARMENT_CENTRE, TABLE
from unwrinkle.testing.towels import (
    SENSORS,
    angle_between,
    compare,
    crossed_towel,
    crossing_separated,
    flat_map,
    map_of,
    ridged_towel,
)

UC3M = (
    "20150625_2__dishcloth01_1",
    "20150625_2__polo01_1",
    "20150625__dishcloth01_1",
    "20150625__sweater01_1",
    "20150902__blanket01_3",
    "20150902__blanket01_3b",
    "20150902__towel01_1",
    "20150902__towel01_2",
    "20150902__towel02_2",
    "dishcloth01_1",
    "polo01_1",
    "robe01_1",
    "sweater02_1",
    "tshirt01_1",
)


def chosen(analysis):
    """What the closed loop would do about it, by the shipped rules."""
    return choose(Observation.of(analysis), PolicyState(), LoopSettings(mode=analysis.mode))


def analysed(path):
    return analyse(
        range_map_from_capture(
            load_capture(path, camera="xtion-pro-live"),
            centre=GARMENT_CENTRE,
            table_height=TABLE.height,
        ),
        table=TABLE,
    )


@pytest.mark.parametrize("seed", range(5))
def test_several_gaussian_ridges(seed):
    towel = ridged_towel(seed)
    outcome = compare(towel, analyse(map_of(towel, 0.0005, seed=seed), table=TABLE))
    assert outcome.missed == outcome.extra == 0
    assert max(outcome.width) < 0.0003
    assert max(outcome.chord_height) < 0.0003
    assert max(outcome.direction) < np.radians(1.0)
    assert outcome.ranking_kept


@pytest.mark.parametrize("seed", [0, 4, 17, 44])
def test_crossing_ridges_stay_separate_wrinkles(seed):
    towel = crossed_towel(seed)
    assert crossing_separated(towel, analyse(map_of(towel, 0.0005, seed=seed), table=TABLE))


@pytest.mark.slow
@pytest.mark.parametrize("sensor", SENSORS)
def test_flat_cloth_has_no_wrinkle_above_the_halting_measure(sensor):
    for seed in range(20):
        analysis = analyse(flat_map(sensor, seed), table=TABLE)
        assert analysis.halting_measure < 0.002
        assert isinstance(chosen(analysis), NoChoice) and chosen(analysis).stop.flat


def test_the_largest_wrinkle_that_can_be_grasped_is_the_target():
    """The larger wrinkle's section leaves the table; the second's does not."""
    towel = Towel(
        ridges=(
            Ridge((0.32, -1.1), 1.5, 0.024, 0.0135, 0.2),
            Ridge((0.14, -1.1), 0.1, 0.018, 0.012, 0.12),
        ),
        centre=(0.22, -1.1),
        side=0.44,
    )
    analysis = analyse(map_of(towel, 0.0005), table=TABLE)
    assert analysis.wrinkles[0].centre[0] > 0.25
    choice = chosen(analysis)
    assert isinstance(choice, Choice) and choice.decision.wrinkle.index == 1
    assert isinstance(analysis.target_for(0), NoTarget)
    assert [(r.wrinkle, r.arms) for r in choice.refusals] == [(0, "dual")]
    with pytest.raises(InputError, match="wrinkle 2"):
        analysis.target_for(2)


def test_below_the_halting_pull_nothing_is_pulled_and_only_a_level_garment_is_flat():
    towel = Towel(ridges=(Ridge((0.0, -1.1), 0.3, 0.010, 0.012, 0.15),), side=0.4)
    range_map = map_of(towel, 0.0005)
    foot, paper = analyse(range_map, table=TABLE), analyse(range_map, mode="paper", table=TABLE)
    assert foot.halting_measure > paper.halting_measure
    low = replace(
        Observation.of(paper).features,
        wrinkles=tuple(replace(w, height=0.003) for w in Observation.of(paper).features.wrinkles),
    )
    assert paper.halting_measure < 0.005
    stop = decide(low, PolicyState(), LoopSettings())
    assert isinstance(stop, Stop) and stop.state is GarmentState.WRINKLED and not stop.flat
    stop = decide(replace(low, state=GarmentState.FLAT), PolicyState(), LoopSettings())
    assert isinstance(stop, Stop) and stop.flat
    eager = replace(noise_profile("stereo"), halting_pull=0.001)
    assert isinstance(chosen(analyse(range_map, mode="paper", profile=eager, table=TABLE)), Choice)


def test_maps_have_the_range_maps_shape_and_json_is_plain():
    analysis = analyse(map_of(ridged_towel(0), 0.0005), table=TABLE)
    for picture in (analysis.classes, analysis.ridges, analysis.contours, analysis.surface_height):
        assert picture.shape == analysis.range_map.shape
    assert analysis.classes.max() <= 9 and analysis.ridges.any() and analysis.contours.any()
    assert analysis.wrinkledness.entropy.shape == analysis.surface.z.shape
    report = json.loads(json.dumps(analysis.to_json(points=True)))
    assert len(report["wrinkles"]) == len(analysis.wrinkles)


def test_the_same_map_gives_the_same_analysis():
    range_map = map_of(ridged_towel(3), 0.0005)
    assert analyse(range_map, table=TABLE).to_json(points=True) == analyse(
        range_map, table=TABLE
    ).to_json(points=True)


def test_the_papers_patches_find_the_same_largest_wrinkle():
    towel = Towel(ridges=(Ridge((0.0, -1.1), 0.5, 0.018, 0.0135, 0.2),), side=0.4)
    range_map = map_of(towel, 0.0005)
    patches = analyse(range_map, patches=True, table=TABLE).wrinkles
    (single,) = analyse(range_map, table=TABLE).wrinkles
    assert patches
    assert angle_between(patches[0].direction, 0.5) < np.radians(5.0)
    assert single.width == pytest.approx(0.027, abs=0.0003)


def test_unknown_modes_and_sensors_are_refused():
    range_map = map_of(ridged_towel(0), 0.002)
    with pytest.raises(InputError, match="mode"):
        analyse(range_map, mode="feet", table=TABLE)
    with pytest.raises(InputError, match="sonar"):
        analyse(replace(range_map, sensor="sonar"), table=TABLE)


@pytest.mark.slow
@pytest.mark.parametrize("name", UC3M)
def test_real_captures_are_analysed(shared_data, name):
    analysis = analysed(shared_data / "uc3m_textiles" / f"{name}_fold_depth_mm.png")
    for wrinkle in analysis.wrinkles:
        numbers = [v for v in wrinkle.to_json().values() if isinstance(v, float)]
        assert np.isfinite(numbers).all()
        assert 0.01 < wrinkle.width < 0.1
    json.dumps(analysis.to_json(points=True), allow_nan=False)


@pytest.mark.slow
@pytest.mark.parametrize("number", ["00023", "01158", "02321"])
def test_ctu_samples_are_analysed(shared_data, number):
    analysis = analysed(shared_data / "clopema_ctu_spread_garments" / f"cloD{number}.png")
    assert analysis.wrinkles
    json.dumps(analysis.to_json(points=True), allow_nan=False)


@pytest.mark.slow
def test_long_folds_of_the_robe_are_the_largest(shared_data):
    analysis = analysed(shared_data / "uc3m_textiles" / "robe01_1_fold_depth_mm.png")
    folds = [w for w in analysis.wrinkles[:3] if w.length > 0.35]
    assert len(folds) == 2
    for fold, angle in zip(folds, (38.0, -18.0), strict=True):
        assert angle_between(fold.direction, np.radians(angle)) < np.radians(6.0)
        assert 0.025 < fold.width < 0.037
    assert isinstance(chosen(analysis), Choice)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["20150902__blanket01_3", "20150902__blanket01_3b"])
def test_the_long_fold_of_the_blanket_is_the_largest(shared_data, name):
    analysis = analysed(shared_data / "uc3m_textiles" / f"{name}_fold_depth_mm.png")
    fold = analysis.wrinkles[0]
    assert fold.length > 0.25
    assert angle_between(fold.direction, np.radians(-35.0)) < np.radians(6.0)
