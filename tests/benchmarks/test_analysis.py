import pytest

from benchmarks.harness.data import TABLE
from benchmarks.perception import analysis
from unwrinkle.perception.wrinkles.analysis import analyse
from unwrinkle.simulation.rendering.synthetic_towel import Ridge


def test_the_formulas():
    ridge = Ridge((0.0, 0.0), 0.0, 0.022, 0.0135, 0.2)
    assert analysis.formula_width(ridge) == pytest.approx(0.027)
    assert analysis.formula_chord_height(ridge) == pytest.approx(0.00866, abs=1e-5)


def test_compare_sees_what_is_missed_and_what_is_too_much():
    towel, other = analysis.ridged_towel(0), analysis.ridged_towel(1)
    found = analyse(analysis.map_of(towel, 0.001), table=TABLE)
    assert analysis.compare(towel, found)["missed"] == 0
    assert max(analysis.compare(other, found)["width"], default=1.0) > 0.0003
    assert not analysis.crossing_separated(analysis.crossed_towel(0), found)


@pytest.mark.slow
def test_a_small_run_has_the_keys_and_a_table(monkeypatch):
    monkeypatch.setattr(analysis, "_SIZES", analysis._SIZES[:1])
    stages = []
    results = analysis.run(quick=True, seed=0, progress=lambda *args: stages.append(args))
    for key in ("range_map_to_target_time_median", "width_error_max", "chord_height_error_max"):
        assert results[key] > 0.0
    assert results["width_error_max"] < 0.0003
    assert stages
    assert "2 sigma" in analysis.table(results)
