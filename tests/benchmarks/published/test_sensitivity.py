"""The benchmark `sensitivity`, on runs made up for it."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from benchmarks.harness.trials import Trial
from benchmarks.published.loop_trials import LoopTrial, changed
from benchmarks.published.sensitivity import benchmark as sensitivity
from benchmarks.published.sensitivity.conditions import (
    CONDITIONS,
    QUICK,
    STEREO,
    TRUTH,
    core_minutes,
)
from benchmarks.published.sensitivity.results import ConditionFigures, SensitivityResult
from unwrinkle.models.cloth import load_material
from unwrinkle.models.scenario import Scenario


def told(done: int, total: int, stage: str) -> None:
    """Take no notice."""


def made_up(row: Trial, actions: int, height: float = 0.003) -> LoopTrial:
    heights = [0.02] * actions + [height]
    return LoopTrial(
        name=row.name,
        folder="nowhere",
        settings=row.settings,
        wall=10.0,
        code="",
        reason="",
        status="flat" if height <= 0.005 else "stopped",
        actions=actions,
        heights=tuple(heights),
        coverages=(*[0.9] * actions, 0.99),
        overstretch=(0.5, *[0.02] * actions),
        rni_truth=None,
        dual=actions,
        single=0,
        missed=0,
        dual_wanted=actions,
        dual_found=actions,
        looks=(),
    )


def made_up_run(monkeypatch: pytest.MonkeyPatch, better: str = "section") -> SensitivityResult:
    """The default needs 3 or 4 actions, pulls of the whole section 2 fewer, pulls of the paper
    alone 2 more and leave the last one unflat.
    """

    def trials(name: str, wanted: Sequence[Trial], kind: Any, progress: Any) -> list[LoopTrial]:
        assert name == "sensitivity" and len({row.folder(name) for row in wanted}) == len(wanted)
        found = []
        for row in wanted:
            loop, seed = row.settings["scenario"]["loop"], row.settings["seed"]
            actions = 3 + seed % 2 - 2 * (loop.get("pull") == better)
            alone = loop.get("mode") == "paper" and loop.get("pull_gain") == 1.0
            height = 0.009 if alone and seed == 4 else 0.003
            found.append(made_up(row, actions + 2 * alone, height))
        return found

    monkeypatch.setattr(sensitivity, "run_trials", trials)
    return sensitivity.run(quick=False, seed=0, progress=told)


def condition(results: SensitivityResult, value: str, look: str = TRUTH) -> ConditionFigures:
    (found,) = [c for c in results.conditions if c.value == value and c.look == look]
    return found


def test_conditions_change_one_thing_that_the_scenario_and_the_cloth_know() -> None:
    material = load_material(Scenario().station.garment.material)
    for of in CONDITIONS:
        rows = of.trials(0)
        assert [row.settings["seed"] for row in rows] == list(range(of.starts))
        for row in rows:
            changed(Scenario(), row.settings["scenario"]).validate()
            assert row.settings["start"] == {"kind": "bunched", "seed": row.settings["seed"]}
        assert bool(of.loop) + bool(of.sensor) + bool(of.material) <= 1
        material.changed(**of.material)
    names = [row.name for of in CONDITIONS for row in of.trials(0)]
    assert len(set(names)) == len(names)
    assert {
        look: sum(of.is_default for of in CONDITIONS if of.look == look) for look in (STEREO, TRUTH)
    } == {
        STEREO: 1,
        TRUTH: 1,
    }


def test_bending_changes_its_elastic_and_its_plastic_part() -> None:
    material = load_material(Scenario().station.garment.material)
    (softer,) = [of for of in CONDITIONS if of.value == "bending x 0.5"]
    assert softer.material == pytest.approx(
        {"bending": 0.5 * material.bending, "plastic_bending": 0.5 * material.plastic_bending}
    )


def test_figures_are_paired_with_the_default_of_the_same_look(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    results = made_up_run(monkeypatch)
    section, alone = (
        condition(results, "all its slack pulled"),
        condition(results, "paper alone (published)"),
    )
    assert section.to_default is not None and alone.to_default is not None
    assert section.rni_mean == pytest.approx(1.5)
    assert section.to_default.mean == section.to_default.high == -2.0
    assert alone.to_default.mean == 2.0 and alone.flat_by_truth == alone.runs - 1
    assert alone.unfinished == 1 and alone.overstretch_max == 0.02
    stereo = condition(results, "", STEREO)
    assert stereo.runs == 3 and stereo.rni_mean == pytest.approx(10.0 / 3.0)
    assert stereo.to_default is None
    assert (spread := condition(results, "x 4", STEREO).to_default) and spread.count == 3
    assert sensitivity.paired([made_up(CONDITIONS[0].trials(90)[0], 2)], []) is None


def test_the_page_says_what_beats_the_default(monkeypatch: pytest.MonkeyPatch) -> None:
    page = sensitivity.table(made_up_run(monkeypatch))
    assert "simulated" in page.splitlines()[0]
    fewer, more, left = (
        next(line for line in page.splitlines() if line.startswith(f"- {start}"))
        for start in ("Fewer", "More", "Towels")
    )
    assert "section all its slack pulled, on true maps (-2.0 (-2.0 to -2.0), 10 starts)" in fewer
    assert "paper alone" in more and "foot" not in more
    assert "paper alone (published), on true maps (4 of 5)" in left
    assert "section all its slack pulled, on true maps" in page.splitlines()[-1]
    none = sensitivity.table(made_up_run(monkeypatch, better="nothing"))
    assert "by more than the interval (four starts or more): none." in none
    assert "the defaults stay as they are" in none.splitlines()[-1]


def test_a_quick_run_is_two_small_runs(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    asked: list[Trial] = []

    def trials(name: str, wanted: Sequence[Trial], kind: Any, progress: Any) -> list[LoopTrial]:
        asked.extend(wanted)
        return [made_up(row, 1 + number) for number, row in enumerate(wanted)]

    monkeypatch.setattr(sensitivity, "run_trials", trials)
    results = sensitivity.run(quick=True, seed=3, progress=told)
    assert "or more): none." in sensitivity.table(results)  # one start tells nothing
    assert len(asked) == len(QUICK) == 2
    for row in asked:
        scenario = row.settings["scenario"]
        assert (scenario["sensor"]["scale"], scenario["loop"]["actions"]) == (0.25, 2)
        assert row.settings["seed"] == 3
    assert results.expected_core_minutes is None and results.most_actions == 2
    sensitivity.plot(results, tmp_path / "quick.png")
    assert (tmp_path / "quick.png").stat().st_size > 10_000


def test_it_draws_and_says_what_it_costs(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    said: list[str] = []
    results = made_up_run(monkeypatch)
    sensitivity.run(quick=False, seed=0, progress=lambda done, total, stage: said.append(stage))
    assert f"about {core_minutes():.0f} core-minutes" in said[0]
    assert 20.0 < core_minutes() < 60.0
    sensitivity.plot(results, tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 30_000
