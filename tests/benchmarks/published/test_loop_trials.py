"""The closed loop as a trial: run for real, with the sensor that costs no rendering."""

from pathlib import Path

import pytest

from benchmarks.published.loop_trials import VERTICES, changed, flattened
from unwrinkle.models.errors import InputError
from unwrinkle.models.io.archive import load_archive
from unwrinkle.models.scenario import load_scenario

SETTINGS = {
    "scenario": {"sensor": {"kind": "truth"}, "station": {"garment": {"nodes": 60}}},
    "seed": 0,
    "start": {"kind": "ridge", "direction": 0.3, "slack": 0.025},
}


def test_a_single_wrinkle_is_flattened_in_one_action(tmp_path: Path) -> None:
    result = flattened(SETTINGS, tmp_path)
    assert (result.status, result.actions, result.rni_truth) == ("flat", 1, 1)
    assert result.heights[0] > 0.020 and result.heights[1] < 0.003
    assert (result.dual, result.dual_wanted, result.dual_found) == (1, 1, 1)
    assert [look.outcome for look in result.looks] == ["done", "flat"]
    assert result.looks[0].total >= sum(
        result.looks[0].seconds[stage] for stage in ("look", "planning", "motion")
    )
    header, arrays = load_archive(tmp_path / VERTICES)
    risen = arrays["v0"][:, 2].max() - header["flat_height"]
    assert risen == pytest.approx(result.heights[0], abs=1e-5) and "v1" in arrays


def test_another_cloth_starts_as_the_usual_one_settles_on_it(tmp_path: Path) -> None:
    stiff = {**SETTINGS, "material": {"bending": 1e-4, "plastic_bending": 2e-4}}
    none = {**stiff, "scenario": {**stiff["scenario"], "loop": {"actions": 0}}}  # type: ignore[dict-item]
    result = flattened(none, tmp_path)
    assert result.actions == 0 and len(result.heights) == 1
    assert result.heights[0] < 0.017  # a stiff ridge pushes itself apart


def test_what_no_scenario_has_is_refused() -> None:
    assert changed(load_scenario(), {"loop": {"actions": 4}}).loop.actions == 4
    with pytest.raises(InputError, match="LoopSettings has no acts"):
        changed(load_scenario(), {"loop": {"acts": 4}})
    with pytest.raises(InputError, match="start 'heap': unknown; known are flat, ridge"):
        flattened({**SETTINGS, "start": {"kind": "heap"}}, Path())
