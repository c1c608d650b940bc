"""Tables I and II, on runs made up for them."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from benchmarks.harness.trials import Trial
from benchmarks.published import table1, table2
from benchmarks.published.loop_trials import Look, LoopTrial
from benchmarks.published.table2_results import OrderKept, Table2Result


def told(done: int, total: int, stage: str) -> None:
    """Take no notice."""


def made_up(
    row: Trial, *, actions: int, height: float, arms: int = 2, status: str = "flat"
) -> LoopTrial:
    look = Look(
        outcome="done",
        reason="",
        arms=arms,
        wrinkle=0,
        asked="dual",
        pull=0.01,
        wrinkles=1,
        refusals=(),
        seconds={"look": 4.0},
        total=7.0,
    )
    heights = [0.02] * actions + [height]
    return LoopTrial(
        name=row.name,
        folder="nowhere",
        settings=row.settings,
        wall=10.0,
        code="",
        reason="",
        status=status,
        actions=actions,
        heights=tuple(heights),
        coverages=(*[0.9] * actions, 0.99),
        overstretch=(*[0.0] * actions, 0.02),
        rni_truth=actions if height <= 0.005 else None,
        dual=actions * (arms == 2),
        single=actions * (arms == 1),
        missed=0,
        dual_wanted=actions,
        dual_found=actions * (arms == 2),
        looks=(look,) * actions,
    )


def table2_run(monkeypatch: pytest.MonkeyPatch, counts: dict[str, int]) -> Table2Result:
    def trials(
        benchmark: str, wanted: Sequence[Trial], kind: Any, progress: Any
    ) -> list[LoopTrial]:
        assert benchmark == "table2" and kind is LoopTrial
        found = []
        for row in wanted:
            cell, _, seed = row.name.rpartition("-")
            stereo = "stereo" in cell
            height = 0.003 if stereo or int(seed) % 2 else 0.009
            found.append(made_up(row, actions=counts[cell] + int(seed) % 2, height=height))
        return found

    monkeypatch.setattr(table2, "run_trials", trials)
    return table2.run(quick=False, seed=0, progress=told)


COUNTS = {
    "dual_stereo": 2,
    "single_stereo": 6,
    "dual_xtion": 8,
    "single_xtion": 10,
    "dual_stereo_together": 1,
}


def test_cells_are_paired_and_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    results = table2_run(monkeypatch, COUNTS)
    starts = {cell: [run.settings["start"] for run in results.runs[cell]] for cell in COUNTS}
    assert all(of == starts["dual_stereo"] for of in starts.values())
    assert results.cells["dual_stereo"].rni_mean == pytest.approx(2.5)
    assert results.cells["dual_stereo"].dual_success == 1.0
    assert results.cells["dual_xtion"].flat_by_truth == 5
    assert results.cells["dual_xtion"].rni_truth_mean == pytest.approx(9.0)
    assert results.order_kept == OrderKept(True, True)
    page = table2.table(results)
    assert "| dual-arm, stereo: mean RNI at most 3.5 | 2.5 | yes |" in page
    assert "simulated" in page.splitlines()[0]


def test_a_missed_target_is_called_missed(monkeypatch: pytest.MonkeyPatch) -> None:
    results = table2_run(monkeypatch, COUNTS | {"dual_stereo": 7, "single_xtion": 1})
    page = table2.table(results)
    assert "| dual-arm, stereo: mean RNI at most 3.5 | 7.5 | no |" in page
    assert "| dual-arm, stereo: below the published 4.7 | 7.5 | no |" in page
    assert "| order of the cells, by the detector | not kept | no |" in page


def test_runs_of_other_code_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    results = table2_run(monkeypatch, COUNTS)
    assert "versions of the code" not in table2.table(results)
    other = tuple(
        dataclasses.replace(run, code="c0ffee" * 10) for run in results.runs["dual_xtion"]
    )
    results = dataclasses.replace(results, runs={**results.runs, "dual_xtion": other})
    page = table2.table(results)
    assert "**These runs are of 2 versions of the code**" in page
    assert "c0ffeec0ffee: dual-arm, xtion." in page


def table1_run(monkeypatch: pytest.MonkeyPatch, spoilt: str) -> table1.Table1Result:
    def trials(
        benchmark: str, wanted: Sequence[Trial], kind: Any, progress: Any
    ) -> list[LoopTrial]:
        return [
            made_up(
                row, actions=1 + (row.name == spoilt), height=0.002, arms=2 - (row.name == spoilt)
            )
            for row in wanted
        ]

    monkeypatch.setattr(table1, "run_trials", trials)
    monkeypatch.setattr(table1, "RUN", tuple(table1.READINGS))
    return table1.run(quick=False, seed=0, progress=told)


def test_every_direction_has_its_repeats(monkeypatch: pytest.MonkeyPatch) -> None:
    results = table1_run(monkeypatch, "none")
    for reading in ("forward", "lateral"):
        assert (
            results.readings[reading].runs == 40 and len(results.readings[reading].directions) == 8
        )
        assert (
            results.readings[reading].dual_success == 1.0
            and results.readings[reading].rni_one == 40
        )
    starts = [str(run.settings["start"]) for run in results.runs["forward"]]
    assert len(set(starts)) == 40
    assert "| RNI 1 everywhere (forward) | 40 of 40 | yes |" in table1.table(results)


def test_a_second_action_and_a_single_arm_are_seen(monkeypatch: pytest.MonkeyPatch) -> None:
    results = table1_run(monkeypatch, "lateral-+45.0-2")
    page = table1.table(results)
    assert results.readings["lateral"].dual_least == pytest.approx(0.8)
    assert "| RNI 1 everywhere (lateral) | 39 of 40 | no |" in page
    assert "| lateral-+45.0-2 | flat | 2 | 1 |" in page


@pytest.mark.parametrize("benchmark", [table1, table2])
def test_figures_are_drawn_without_the_runs_folders(
    benchmark: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    made = (
        table1_run(monkeypatch, "none") if benchmark is table1 else table2_run(monkeypatch, COUNTS)
    )
    benchmark.plot(made, tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 10_000
