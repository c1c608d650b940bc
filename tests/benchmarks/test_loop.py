"""The benchmark of whole runs, on records made up for it."""

import dataclasses
from pathlib import Path
from typing import Any

import pytest

from benchmarks.loop import benchmark as loop
from benchmarks.loop.benchmark import LoopResult, Repeated
from benchmarks.loop.runs import Run


def action(outcome: str, seconds: float, height: float) -> dict[str, Any]:
    return {
        "index": 0,
        "outcome": outcome,
        "arms": ["right", "left"] if outcome == "done" else [],
        "seconds": {"render": seconds, "stereo": 1.0, "planning": 0.5},
        "truth_before": {"height": height, "coverage": 0.9, "overstretch": 0.0},
        "truth_after": {"height": height / 2, "coverage": 0.99, "overstretch": 0.01},
        "clearance": 0.040,
        "clearance_measured": 0.039,
        "following_error": 1e-4,
        "grip_distance_error": 2e-4,
        "violations": ["too fast"] if height > 0.02 else [],
    }


def fake(root: Path, name: str, options: tuple[str, ...]) -> Run:
    height = 0.03 if "towel" in name else 0.01
    actions = [action("done", 4.0, height), action("flat", 4.0, height / 2)]
    return Run(name, options, root, 50.0, 0, {"status": "flat", "reason": ""}, actions)


@pytest.fixture
def results(monkeypatch: pytest.MonkeyPatch) -> LoopResult:
    monkeypatch.setattr(loop, "flatten", fake)
    monkeypatch.setattr(Run, "unverified", lambda self: 1 if self.name == "towel-3" else 0)
    monkeypatch.setattr(Run, "fingerprint", property(lambda self: self.name[:7]))
    return loop.run(quick=False, seed=0, progress=lambda done, total, stage: None)


def test_figures_come_from_the_records(results: LoopResult) -> None:
    assert len(results.towels) == 10 and len(results.shirts) == 5
    assert results.actions_mean == 1.0 and results.dual_share == 1.0
    assert results.unverified_motions == 1 and results.violations == 10
    assert results.flat_by_truth == 0  # 7.5 mm are left
    assert results.clearance_short_worst == pytest.approx(0.001)
    assert results.stages["computing"].median == 1.5
    assert results.repeated.same_bits


def test_what_misses_its_target_is_seen_in_the_table(results: LoopResult) -> None:
    page = loop.table(results)
    assert "| bunched towels flat by truth | 10 of 10, or a reason | 0 of 10 |" in page
    assert "| motions without a verdict | 0 | 1 |" in page
    assert "| towel-3 | flat | 1 (1, 0) | 30.0 to 7.5 |" in page
    other = dataclasses.replace(results, repeated=Repeated(False, ""))
    assert "DIFFERENT" in loop.table(other)
