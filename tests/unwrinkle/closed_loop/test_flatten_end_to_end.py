"""Flatten a towel, with the example and with the command; the same seed gives the same run."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from unwrinkle.models.io.archive import load_archive
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.runs.folder import RunFolder

SMALL = "Small:\n  station: {garment: {nodes: 60}}\n"


def run(*words: str, folder: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, *words]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


@pytest.mark.slow
@pytest.mark.end_to_end
def test_a_ridge_is_seen_and_pulled_flat(repository: Path, tmp_path: Path) -> None:
    done = run(str(repository / "examples" / "flatten_in_simulation.py"), folder=tmp_path)
    assert done.returncode == 0, done.stderr + done.stdout
    assert done.stdout.startswith("flat: ")
    folder = RunFolder.open(tmp_path / "run")
    assert folder.status == "flat"
    first, *_, last = [look.action() for look in folder.looks()]
    assert first.truth_before is not None and last.truth_before is not None
    assert first.truth_before["height"] > 0.012
    assert last.truth_before["height"] < 0.005 and last.truth_before["coverage"] > 0.98
    for look in folder.looks()[:-1]:
        action = look.action()
        assert look.verdict()["plan_hash"] == look.plan().content_hash
        assert action.violations == () and action.following_error is not None
        assert action.following_error < 1e-3
        assert action.grip_distance_error is not None and action.grip_distance_error < 3e-3
    for page in ("report.html", "replay.html"):
        assert 1e4 < (folder.path / page).stat().st_size < 1e7


@pytest.mark.slow
@pytest.mark.end_to_end
def test_the_same_seed_gives_the_same_bits(tmp_path: Path) -> None:
    (tmp_path / "small.scenario.yaml").write_text(SMALL, encoding="utf-8")
    ends: list[tuple[Any, ...]] = []
    for name in ("one", "two"):
        done = run(
            *("-m", "unwrinkle", "flatten", "--no-live", "--scenario", "small.scenario.yaml"),
            *("--start", "ridge", "--sensor", "truth", "--seed", "3", "--actions", "1"),
            *("--out", name),
            folder=tmp_path,
        )
        assert done.returncode in (0, 3), done.stderr
        look = tmp_path / name / "000"
        assert json.loads((look / "action.json").read_text())["outcome"] == "done"
        _, after = load_archive(look / "after.npz")
        ends.append((FlatteningPlan.load(look / "plan.npz").content_hash, after))
    (plan, after), (plan_again, after_again) = ends
    assert plan == plan_again
    assert set(after) == set(after_again)
    assert all(np.array_equal(after[key], after_again[key]) for key in after)
