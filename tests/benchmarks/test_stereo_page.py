"""The stereo page states what was measured; the committed figures meet the targets."""

import json
from pathlib import Path
from typing import Any

import cv2
import pytest

from benchmarks.perception.stereo import benchmark as stereo

Results = dict[str, Any]


@pytest.fixture(scope="module")
def report(repository: Path) -> dict[str, Any]:
    loaded: dict[str, Any] = json.loads((repository / "docs/results/stereo.json").read_text())
    return loaded


def test_the_page_shows_the_figures_it_is_given(report: dict[str, Any]) -> None:
    results: Results = {**report["results"], "disparity_rms": 0.4321, "peak_memory": 7.89e9}
    page = stereo.table(results)
    assert "0.432 px" in page
    assert "7.89 GB" in page
    for scene in results["scenes"].values():
        assert scene["name"] in page
    for row in results["methods"]:
        assert f"| {row['name']} | {row['time']:.2f} |" in page


def test_a_wrinkle_that_was_not_found_is_said_so(report: dict[str, Any]) -> None:
    results: Results = json.loads(json.dumps(report["results"]))
    wrinkle = results["scenes"]["terry"]["wrinkles"][0]
    del wrinkle["width_error"], wrinkle["height_error"]
    assert "not found" in stereo.table(results)


def test_the_plot_is_a_picture(report: dict[str, Any], tmp_path: Path) -> None:
    stereo.plot(report["results"], tmp_path / "stereo.png")
    picture = cv2.imread(str(tmp_path / "stereo.png"))
    assert picture is not None
    assert picture.shape[1] > 800
    assert picture.std() > 5.0


def test_the_committed_run_was_whole_and_meets_the_targets(report: dict[str, Any]) -> None:
    results = report["results"]
    assert report["quick"] is False
    assert results["pair_to_map_time_median"] < 2.0
    assert results["peak_memory"] < 2.5e9
    assert results["disparity_rms"] < 0.15
    assert abs(results["disparity_bias"]) < 0.02
    assert results["valid_fraction"] > 0.99
    assert results["speedup_over_sgbm_full"] > 12.0
    assert results["rms_ratio_over_sgbm_full"] > 1.5
    assert results["scenes"]["plain"]["rms"] < 0.35
