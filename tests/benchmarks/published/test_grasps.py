"""The benchmark `grasps`: one real trial, and the page and figure of made-up ones."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.harness.results import to_json
from benchmarks.harness.trials import FailedTrial
from benchmarks.published.grasps import benchmark as grasps
from benchmarks.published.grasps.results import Attempt, GraspRun, GraspTrial, LeftOut
from benchmarks.published.grasps.states import STATES, cloth_of, start_of
from benchmarks.published.grasps.trials import CHOICES, OURS, grasped, wanted
from benchmarks.published.loop_trials import VERTICES
from unwrinkle.models.errors import InputError
from unwrinkle.models.io.archive import save_archive
from unwrinkle.models.robot import load_cell


@pytest.fixture(scope="module")
def ridge(tmp_path_factory: pytest.TempPathFactory) -> tuple[GraspRun, Path]:
    folder = tmp_path_factory.mktemp("ridge-0")
    return grasped({"state": "ridge", "seed": 0}, folder), folder


@pytest.mark.slow
def test_one_ridge_is_grasped_and_flat_cloth_is_not(ridge: tuple[GraspRun, Path]) -> None:
    row, folder = ridge
    assert json.dumps(to_json(row), allow_nan=False)
    assert tuple(row.choices) == CHOICES
    ours, random = row.choices[OURS], row.choices["random point"]
    assert ours.success and ours.cause is None and ours.inset and ours.area and ours.depth
    assert 0.0 < ours.inset < 0.24
    assert ours.area > 0.01 and ours.depth > 0.005
    assert np.shape(ours.tips) == (2, 2, 2)
    assert not random.success and random.cause == "not caught"
    assert random.misplaced == (0.0, 0.0)
    assert row.wrinkles == 1 and 0.9 < row.coverage < 1.0
    assert (folder / VERTICES).exists()


@pytest.mark.slow
def test_a_start_is_read_from_its_file(ridge: tuple[GraspRun, Path]) -> None:
    cell, kind = load_cell(), STATES[0]
    file = ridge[1] / "start.npz"
    cloth = cloth_of(kind, cell)
    before = file.stat().st_mtime_ns
    state = start_of(kind, cloth, cell, 99, file)
    assert file.stat().st_mtime_ns == before
    assert cloth.vertices(state)[:, 2].max() > cloth.flat_height + 0.015


def _made_up(name: str, seed: int, folder: Path, *, failed: bool) -> GraspTrial:
    height = 1e-3 * np.ones((3, 3), dtype=np.float32)
    height[:, :2] = np.array([[-0.1, -1.2], [0.1, -1.2], [0.0, -1.0]])
    arrays = {"v0": height, "v1": height, "triangles": np.array([[0, 1, 2]])}
    save_archive(folder / VERTICES, {"flat_height": 0.0}, arrays)
    done: dict[str, Any] = {
        "success": True,
        "cause": None,
        "reason": None,
        "tips": [[[0.0, -1.1], [0.02, -1.1]], [[0.0, -1.07], [0.02, -1.07]]],
        "depth": 0.0124,
        "misplaced": (1.0, 0.5),
        "weight": 0.3,
        "inset": 0.02,
    }
    none: dict[str, Any] = {"success": False, "cause": "far-reach", "reason": "too far by 0.1 m"}
    choices = {
        choice: Attempt(**(none if failed and choice == OURS else done)) for choice in CHOICES
    }
    return GraspTrial(
        name=f"{name}-{seed}",
        folder=str(folder),
        wall=10.0,
        code="",
        settings={"state": name, "seed": seed},
        wrinkles=3,
        coverage=0.5,
        height=0.04,
        choices=choices,
    )


def test_page_and_figure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []

    def trials(benchmark: str, rows: Any, kind: Any, progress: Any, *, tolerated: str) -> list[Any]:
        asked.extend(rows)
        made = []
        for row in rows:
            if row.name == "bunched-4":
                error = f"{tolerated}: it flew apart"
                made.append(FailedTrial(row.name, row.settings, error))
                continue
            folder = tmp_path / row.name
            folder.mkdir()
            failed = row.settings == {"state": "heap", "seed": 9}  # of seeds 3 to 12
            made.append(_made_up(*row.settings.values(), folder, failed=failed))
        return made

    monkeypatch.setattr(grasps, "try_trials", trials)
    results = grasps.run(quick=False, seed=3, progress=lambda done, total, stage: None)
    assert len(asked) == 51 and asked[-1].name == "bunched-13"
    left = LeftOut("bunched-4", "ClothError: it flew apart")
    assert results.starts_left_out == (left,)
    assert results.attempts == 50 and results.successes == 49
    low, high = results.success_interval
    assert 0.88 < low < 0.98 < high <= 1.0
    assert results.states["heap"].choices[OURS].causes == {"far-reach": 1}
    assert results.states["ridge"].layers == pytest.approx(2.0)
    assert json.dumps(to_json(results), allow_nan=False)
    page = grasps.table(results)
    assert "**49 of 50**" in page and "4 of 5 (38 to 96 %)" in page
    assert "the next seeds were taken: bunched-4." in page
    assert "heap-9: far-reach: too far by 0.1 m" in page and "simulated" in page
    for state in STATES:
        assert state.title in page
    grasps.plot(results, tmp_path / "grasps.png")
    assert (tmp_path / "grasps.png").stat().st_size > 10_000


def test_quick_is_one_seed_of_the_easier_states(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []

    def refuse(benchmark: str, rows: Any, kind: Any, progress: Any, *, tolerated: str) -> list[Any]:
        asked.extend(row.settings for row in rows)
        raise InputError("enough")

    monkeypatch.setattr(grasps, "try_trials", refuse)
    with pytest.raises(InputError, match="enough"):
        grasps.run(quick=True, seed=4, progress=lambda done, total, stage: None)
    assert asked == [{"state": name, "seed": 4} for name in ("ridge", "pushed", "bunched")]


def test_rows_name_their_work() -> None:
    (row,) = wanted(["heap"], [2])
    assert row.name == "heap-2" and row.work.endswith(":grasped")
