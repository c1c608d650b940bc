"""The page of the benchmark `stereo` states the figures that it is given."""

import dataclasses
from pathlib import Path

import pytest

from benchmarks.harness.report import load_report
from benchmarks.perception.stereo import benchmark as stereo
from benchmarks.perception.stereo.results import StereoResult, WrinkleErrors


@pytest.fixture(scope="module")
def results(repository: Path) -> StereoResult:
    found: StereoResult = load_report(repository / "docs/results/stereo.json", StereoResult).results
    return found


def test_the_page_shows_the_figures_it_is_given(results: StereoResult) -> None:
    page = stereo.table(
        dataclasses.replace(results, disparity_rms=0.4321, peak_memory=7_890_000_000)
    )
    assert "0.432 px" in page and "7.89 GB" in page
    for row in results.methods:
        assert f"| {row.name} | {row.time:.2f} |" in page


def test_a_wrinkle_that_was_not_found_is_said_so(results: StereoResult) -> None:
    terry = dataclasses.replace(results.scenes["terry"], wrinkles=(WrinkleErrors(0.02, 0.01),))
    page = stereo.table(dataclasses.replace(results, scenes={"terry": terry}))
    assert "not found" in page
