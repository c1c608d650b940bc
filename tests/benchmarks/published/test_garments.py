"""The benchmark `garments`: its figures and page on made-up trials, and one short baseline."""

import itertools
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.harness.results import to_json
from benchmarks.harness.trials import Trial
from benchmarks.published.garments import benchmark as garments
from benchmarks.published.garments import trials
from benchmarks.published.garments.results import GarmentsResult, StartMade
from benchmarks.published.garments.trials import METHODS, by_policy, made
from benchmarks.published.loop_trials import VERTICES
from unwrinkle.models.errors import InputError
from unwrinkle.models.io.archive import load_archive, save_archive
from unwrinkle.simulation.cloth.cloth import Cloth, ClothError, ClothState

# Ours is done after two actions; random spoils the garment; contour gets over 95 % and falls back.
COURSES = {
    "ours": [0.90, 0.96, 0.99],
    "together": [0.90, 0.995],
    "random": list(np.linspace(0.90, 0.50, 21)),
    "contour": [0.90, 0.97, *[0.94] * 19],
    "wrinkledness": [0.90] * 21,
}


def fake(folder: Path, *, shift: float = 0.0) -> Any:
    folder.mkdir(exist_ok=True)
    square = np.array([[-0.2, -1.3, 0.7], [0.2, -1.3, 0.7], [0.2, -0.9, 0.7]], dtype=np.float32)
    end = square + np.array([0.03, 0.04, 0.0], dtype=np.float32)
    end[2, 2] = 0.5  # one of three hangs down
    arrays = {"v0": square, "v1": end, "triangles": np.array([[0, 1, 2]])}
    save_archive(folder / VERTICES, {"flat_height": 0.7}, arrays)

    def trials(benchmark: str, wanted: Sequence[Trial], kind: Any, progress: Any) -> list[Any]:
        return [
            kind(
                **{
                    "name": row.name,
                    "settings": row.settings,
                    "folder": str(folder),
                    "wall": 10.0,
                    "code": "",
                    **(
                        start_made(row.name)
                        if row.name.endswith("-start")
                        else course(row.name.rsplit("-", 1)[1], shift)
                    ),
                }
            )
            for row in wanted
        ]

    return trials


def start_made(name: str) -> dict[str, Any]:
    """Two starts cannot be made."""
    failed = name in ("pinched-trousers-0-start", "pinched-trousers-1-start")
    return {"made": not failed, "reason": "torn" if failed else ""}


def course(method: str, shift: float = 0.0) -> dict[str, Any]:
    coverages = [float(value) for value in COURSES[method]]
    coverages[0] += shift if method == "random" else 0.0
    return {
        "reason": "",
        "status": "flat" if method == "ours" else "used all actions",
        "coverages": tuple(coverages),
        "heights": (0.03,) * len(coverages),
        "overstretch": (0.0, 0.02) + (0.0,) * (len(coverages) - 2),
        "actions": len(coverages) - 1,
        **({"broken": 2, "idle": 1, "empty": 0} if method == "random" else {}),
    }


@pytest.fixture
def results(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> GarmentsResult:
    monkeypatch.setattr(garments, "run_trials", fake(tmp_path / "row"))
    monkeypatch.setitem(garments._SEEDS, "pinched", 1)
    return garments.run(quick=False, seed=0, progress=lambda done, total, stage: None)


def test_every_garment_start_seed_and_method_has_a_row(results: GarmentsResult) -> None:
    names = {run.name for run in results.runs}
    assert len(names) == len(results.runs) == 4 * (5 + 1) * 5
    assert "pinched-towel-0-wrinkledness" in names
    by_start: dict[str, set[str]] = {}
    for run in results.runs:
        key = run.name.rsplit("-", 1)[0]
        one = run.settings
        same = [one["start"], one["seed"], one["scenario"]["station"]]
        by_start.setdefault(key, set()).add(json.dumps(same))
    assert all(len(values) == 1 for values in by_start.values())  # paired
    assert results.unpaired == ()


def test_a_start_that_cannot_be_made_gives_way_to_the_next(results: GarmentsResult) -> None:
    assert results.seeds["pinched-trousers"] == (2,)
    assert results.seeds["bunched-trousers"] == (0, 1, 2, 3, 4)
    left = [one.start for one in results.starts_left_out]
    assert left == ["pinched-trousers-0", "pinched-trousers-1"]
    assert "the next seeds taken: pinched-trousers-0, pinched-trousers-1." in garments.table(
        results
    )


def test_no_start_at_all_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    def none(benchmark: str, wanted: Sequence[Trial], kind: Any, progress: Any) -> list[Any]:
        values = {"name": "", "settings": {}, "folder": "", "wall": 0.0, "code": ""}
        return [kind(made=False, reason="torn", **values) for _ in wanted]

    monkeypatch.setattr(garments, "run_trials", none)
    with pytest.raises(InputError, match="bunched-towel-4; give another seed"):
        garments.chosen_seeds(
            [("bunched", "towel")], 0, {"bunched": 1}, lambda done, total, stage: None
        )


@pytest.mark.parametrize("error", [ClothError("torn"), ValueError("array is too big")])
def test_a_start_that_flies_apart_is_told(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, error: Exception
) -> None:
    def fails(*_: object) -> ClothState:
        raise error

    monkeypatch.setattr(trials, "start_of", fails)
    row = made({"scenario": SHORT["scenario"], "start": SHORT["start"]}, tmp_path / "row")
    assert row == StartMade(made=False, reason=str(error))


def test_what_stopped_early_keeps_its_last_value(results: GarmentsResult) -> None:
    ours = results.cells["bunched"]["towel"]["ours"]
    assert [ours.coverage[n].mean for n in (0, 5, 20)] == pytest.approx([0.9, 0.99, 0.99])
    assert ours.improvement[10].mean == pytest.approx(0.9)
    assert ours.success == ours.success_ever == 5
    assert ours.first_success.mean == 1.0
    assert ours.overstretch_max == 0.02
    assert ours.moved.mean == pytest.approx(0.05)
    assert ours.hanging_max == pytest.approx(1.0 / 3.0)


def test_falling_back_is_no_success(results: GarmentsResult) -> None:
    contour = results.cells["pinched"]["tshirt"]["contour"]
    assert (contour.success, contour.success_ever) == (0, 1)
    assert contour.best.mean == pytest.approx(0.97)
    assert contour.improvement[20].mean == pytest.approx(0.4)
    random = results.overall["bunched"]["random"]
    assert random.improvement[20].mean == pytest.approx(-4.0)
    assert (random.broken, random.runs) == (40, 20)


def test_improvement_of_a_flat_start_means_nothing() -> None:
    assert garments.improvement([0.9995, 1.0], 5) is None
    assert garments.improvement([0.8, 0.9, 0.7], 5) == pytest.approx(-0.5)


def test_the_page_shows_figures_failures_and_whose_they_are(results: GarmentsResult) -> None:
    page = garments.table(results)
    assert page.startswith("Cloth and robot are simulated.")
    assert "| towel | contour | 90.0 (90.0 to 90.0) | 94.0 (94.0 to 94.0) |" in page
    assert "| 0 of 5 (5; 0) | 1.0 | 97.0 |" in page
    assert "How ours ended: towel 5 flat;" in page
    assert "- random: of 400 actions 40 the cloth's solver could not follow" in page
    assert "another simulator" in page and "arXiv:2105.03655" in page
    assert "NOT PAIRED" not in page
    rows = [line for line in page.splitlines() if line.startswith("|")]
    for first, second in itertools.pairwise(rows):
        if second.startswith("|---"):
            assert first.count("|") == second.count("|")


def test_starts_that_differ_are_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(garments, "run_trials", fake(tmp_path / "row", shift=0.01))
    results = garments.run(quick=True, seed=0, progress=lambda done, total, stage: None)
    assert results.unpaired == ("bunched-towel", "bunched-dishcloth")
    assert "NOT PAIRED" in garments.table(results)


def test_quick_is_small_and_plots(
    results: GarmentsResult, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(garments, "run_trials", fake(tmp_path / "quick"))
    quick = garments.run(quick=True, seed=3, progress=lambda done, total, stage: None)
    assert (quick.most_actions, quick.counts, quick.seeds["bunched-towel"]) == (3, (3,), (3,))
    assert len(quick.runs) == 2 * len(METHODS)
    rules = {run.settings["scenario"].get("loop", {}).get("order") for run in quick.runs}
    assert rules == {None, "volume", "together"}
    garments.plot(quick, tmp_path / "quick.png")
    assert (tmp_path / "quick.png").stat().st_size > 10_000


SHORT = {
    "scenario": {"station": {"garment": {"outline": "dishcloth", "nodes": 30}}},
    "start": {"kind": "bunched", "seed": 1, "pinches": 1},
    "seed": 1,
    "actions": 2,
}


def test_a_row_of_bare_hands(tmp_path: Path) -> None:
    row = by_policy({**SHORT, "policy": "contour"}, tmp_path / "one")
    assert row.actions == 2 and len(row.coverages) == len(row.heights) == 3
    assert 0.8 < row.coverages[0] < 0.9995 and row.coverages[-1] > row.coverages[0]
    assert row.idle == row.empty == row.broken == 0
    json.dumps(to_json(row), allow_nan=False)
    _, arrays = load_archive(tmp_path / "one" / VERTICES)
    assert {"v0", "v1", "triangles"} <= set(arrays)
    assert not np.array_equal(arrays["v0"], arrays["v1"])
    # The next method begins with the very same cloth, and the same row is the same again.
    assert len(list((tmp_path / "starts").iterdir())) == 1
    assert by_policy({**SHORT, "policy": "contour"}, tmp_path / "two") == row


@pytest.mark.parametrize("error", [ClothError("torn"), ValueError("array is too big")])
def test_a_pull_that_tears_is_taken_back(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, error: Exception
) -> None:
    def torn(cloth: Cloth, state: ClothState, pull: object) -> ClothState:
        raise error

    monkeypatch.setattr(trials, "carried_out", torn)
    row = by_policy({**SHORT, "policy": "random"}, tmp_path / "row")
    assert row.broken == 2
    assert row.coverages[0] == row.coverages[1] == row.coverages[2]


def test_an_unknown_policy_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="contour, random, wrinkledness"):
        by_policy({**SHORT, "policy": "fling"}, tmp_path)
