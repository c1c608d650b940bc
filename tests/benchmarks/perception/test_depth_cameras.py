"""The depth cameras' page states what was measured; the committed figures meet the real ones."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from benchmarks.harness.report import load_report
from benchmarks.perception.depth_cameras import benchmark as depth_cameras
from benchmarks.perception.depth_cameras.noise import levels_of, noise_figures, step_of
from benchmarks.perception.depth_cameras.results import DepthCamerasResult, LargestWrinkle, RealMaps
from benchmarks.perception.depth_cameras.scenes import edge_figures, restored, stored
from unwrinkle.perception.camera import load_camera
from unwrinkle.perception.depth.capture import Capture
from unwrinkle.simulation.depth_cameras.cameras import load_depth_camera


@pytest.fixture(scope="module")
def results(repository: Path) -> DepthCamerasResult:
    path = repository / "docs/results/depth_cameras.json"
    found: DepthCamerasResult = load_report(path, DepthCamerasResult).results
    return found


def test_the_page_shows_the_figures_it_is_given(results: DepthCamerasResult) -> None:
    tof = results.leaf["tof"]
    flying = dataclasses.replace(tof, edge=dataclasses.replace(tof.edge, flying=0.777))
    row = results.wrinkles[0]
    missed = LargestWrinkle(row.camera, row.seed, row.time, row.holes, 0, row.truth)
    page = depth_cameras.table(
        dataclasses.replace(
            results,
            real=dataclasses.replace(results.real, step=0.0031415),
            leaf={**results.leaf, "tof": flying},
            wrinkles=(missed,),
        )
    )
    assert "3.142 mm at 1 m" in page
    assert "77.7" in page
    assert f"| {row.seed} | no | - | - | - | - | - |" in page


def test_without_real_maps_there_is_a_page_and_a_plot(
    results: DepthCamerasResult, tmp_path: Path
) -> None:
    without = dataclasses.replace(results, real=RealMaps())
    assert "not at hand" in depth_cameras.table(without)
    depth_cameras.plot(without, tmp_path / "plot.png")
    assert (tmp_path / "plot.png").stat().st_size > 10_000


def test_the_step_of_known_levels() -> None:
    depth = np.rint(1e3 / (0.0029 * np.arange(280, 390))) * 1e-3
    levels = levels_of(np.concatenate([depth, depth]))
    assert levels.min() > 0.9
    assert levels.max() < 1.2
    step, rest = step_of(levels, 0.00285)
    assert step == pytest.approx(0.0029, rel=1e-3)
    assert rest < 0.0004


def test_figures_of_known_noise() -> None:
    """Columns of 0.5 steps and white noise of 0.8, on a table with a box on it."""
    camera, step = load_camera("xtion-pro-live"), 0.0029
    rng = np.random.default_rng(1)
    columns = 0.5 * np.sign(np.sin(np.arange(640) / 20.0))
    steps = 1.0 / step + columns + 0.8 * rng.standard_normal((480, 640))
    depth = 1.0 / (step * steps)
    depth[180:300, 250:390] -= 0.05
    depth[:, :8] = 0.0
    figures = noise_figures(Capture(depth.astype(np.float32), camera), step)
    assert figures.distance == pytest.approx(1.0, abs=0.002)
    assert figures.column_rms == pytest.approx(0.5, abs=0.08)
    assert figures.rest_rms == pytest.approx(0.8, abs=0.05)
    assert abs(figures.along_rows[0]) < 0.05
    assert figures.holes == pytest.approx(8 / 640, abs=1e-6)
    assert figures.columns[0] is None
    assert figures.columns[100] == pytest.approx(columns[100], abs=0.2)


def test_edge_figures_count_what_flies_and_what_lacks() -> None:
    model = load_depth_camera("tof")
    truth = np.zeros((200, 200))
    truth[60:140, 60:140] = 0.25
    reading = truth.copy()
    reading[60:140, 60] = 0.12
    reading[100, 50:60] = np.nan
    found = edge_figures(truth, reading, model, 1.1)
    assert found.flying_count == 80
    assert found.shadow == (10, 0)
    assert found.shadow_law == 0.0


def test_pictures_survive_as_text() -> None:
    height = np.array([[0.0, -0.7], [0.2501, np.nan]])
    back = restored(stored(height))
    assert np.isnan(back[1, 1])
    assert np.nanmax(np.abs(back - height)) < 6e-5
