"""The comparison of masks with annotated outlines."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from benchmarks.perception.ctu_masks import best_overlap, run, silhouette, table
from unwrinkle.models.errors import InputError

SHAPE = [[0, 0], [300, 0], [300, 120], [140, 120], [140, 260], [0, 260]]


def _quiet(done: int, total: int, stage: str) -> None:
    return None


def test_overlap_is_one_for_a_moved_scaled_turned_copy() -> None:
    outline = np.array(SHAPE, dtype=float)
    c, s = 0.7 * np.cos(0.08), 0.7 * np.sin(0.08)
    moved = outline @ np.array([[c, s], [-s, c]]) + [90.0, 60.0]
    mask = np.zeros((300, 400), np.uint8)
    cv2.fillPoly(mask, [np.rint(moved).astype(np.int32)], 1)
    assert best_overlap(mask > 0, [outline]) > 0.985


def test_overlap_judges_shape() -> None:
    mask = np.zeros((300, 400), bool)
    mask[50:250, 80:320] = True
    assert best_overlap(mask, [np.array(SHAPE, dtype=float)]) < 0.85


def test_flaps_belong_to_the_silhouette() -> None:
    names = [["fold"], ["hem-a"], ["hem-b"], ["fold"], ["top"]]
    points = [[0.0, 0.0], [0.0, 5.0], [4.0, 5.0], [4.0, 0.0], [2.0, 9.0]]
    polygons = silhouette(points, names)
    assert len(polygons) == 2
    np.testing.assert_array_equal(polygons[1], points[:4])


def test_run_and_table(shared_data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("UNWRINKLE_DATA", str(shared_data))
    results = run(quick=True, seed=0, progress=_quiet)
    assert [s.name for s in results.samples] == ["cloD00023", "cloD01158", "cloD02321"]
    assert results.iou_min > 0.88
    assert results.iou_median > 0.92
    assert table(results).count("| cloD") == 3


def test_missing_data_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("UNWRINKLE_DATA", str(tmp_path))
    with pytest.raises(InputError, match="UNWRINKLE_DATA"):
        run(quick=True, seed=0, progress=_quiet)
