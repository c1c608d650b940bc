"""The benchmark of gaze: its truth, and the loop closed through small rendered pictures."""

import dataclasses

import numpy as np
import pytest

from benchmarks.perception.gaze import benchmark as gaze
from benchmarks.perception.gaze.rendered_head import HeadInCell
from benchmarks.perception.gaze.visual_search import SearchFigures
from unwrinkle.perception.gaze.vergence import TOLERANCE

#: The others run in `make bench`.
SHORT = ("gaze, poor calibration", "vergence")


@pytest.fixture(scope="module")
def cell() -> HeadInCell:
    return HeadInCell.of("print", 0, scale=0.25)


@pytest.mark.slow
def test_truth_is_the_surface_that_the_eye_sees(cell: HeadInCell) -> None:
    middle = np.array([0.05, -1.05, cell.surface])
    cell.take(cell.head.gaze_at(middle))
    camera = cell.head.left.camera
    point = cell.point_at(np.array([camera.cx, camera.cy]))
    # Where the axis meets the cloth: a towel of 2 mm with wrinkles of 21 mm.
    assert 0.001 < point[2] - cell.surface < 0.025
    assert np.linalg.norm(point[:2] - middle[:2]) < 0.03
    assert cell.off_axis(point)[0] < 1e-6
    assert cell.off_axis(middle)[1] < 0.75 * 2**0.5 * cell.units[0].step


@pytest.mark.slow
@pytest.mark.parametrize(
    "case",
    [pytest.param(case, marks=[] if case in SHORT else pytest.mark.long) for case in gaze.CASES],
)
def test_the_loop_closes_in_the_rendered_cell(cell: HeadInCell, case: str) -> None:
    target, aim = gaze._target(cell)
    row = gaze._start(cell, case, "print", 0, target, aim, np.random.default_rng(1))
    assert row.settled, row.reason
    assert row.looks <= 4
    # A quarter of the size: a pixel is 31 mdeg, and a window covers a whole wrinkle.
    assert row.error < 2.0 * TOLERANCE
    assert len(row.times) == len(row.offsets) == row.looks
    assert max(row.start_offset) > 10 * TOLERANCE


def test_the_table_states_what_was_measured() -> None:
    row = gaze.GazeStart(
        case="gaze",
        cloth="terry",
        start=0,
        start_offset=(0.1, 0.2),
        offsets=(),
        looks=2,
        settled=True,
        reason="",
        error=2e-4,
        left_error=1e-4,
        right_error=2e-4,
        vergence_error=3e-4,
        converged=True,
        correlation=(),
        times=(),
    )
    verged = dataclasses.replace(row, case="vergence", converged=False)
    trials = (row, verged)
    results = gaze.GazeResult(
        starts=1,
        starts_converged=1,
        looks_max=2,
        error_max=2e-4,
        error_median=2e-4,
        vergence_error_max=3e-4,
        time_per_look_median=0.1,
        time_per_look_max=0.2,
        tolerance=TOLERANCE,
        step=2.244e-4,
        cases=tuple(
            gaze._summary(case, [r for r in trials if r.case == case]) for case in gaze.CASES
        ),
        search=SearchFigures(1, 4, 3, 0, 0.5),
        trials=trials,
    )
    page = gaze.table(results)
    assert "| 1 | 1 | 2 | 11.5 | 11.5 |" in page
    assert "| 1 | 0 | 2 | 11.5 | 11.5 |" in page
    assert "| gaze | terry | 5.7, 11.5 | 2 | 5.7 | 11.5 |" in page
    assert "| vergence | terry | 5.7, 11.5 | 2 | - | 17.2 |" in page
    assert "3 of 4 found" in page
