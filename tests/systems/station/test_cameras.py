"""The simulated station's head and cameras: one exposure per command, at rest, and faults."""

import dataclasses as dc
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, DiagramBuilder, LeafSystem, State

from unwrinkle.flattening.station_messages import (
    GripperCommand,
    HeadCommand,
    HeadImage,
    TrajectoryCommand,
)
from unwrinkle.models.robot import Cell, load_cell
from unwrinkle.models.scenario import load_scenario
from unwrinkle.perception.stereo.head import Gaze, StereoHead
from unwrinkle.perception.stereo.head_file import nominal_calibration
from unwrinkle.perception.stereo.pair import StereoPair
from unwrinkle.perception.stereo.range_mapping import range_map_from_pair
from unwrinkle.planning.trajectory import Trajectory
from unwrinkle.simulation.cloth.initial_states import ridge
from unwrinkle.simulation.cloth.measures import height_map
from unwrinkle.simulation.rendering.image_noise import SensorModel
from unwrinkle.systems.station.head import ACCELERATION
from unwrinkle.systems.station.photographer import CellPhotographer, CellPosture, averaged, noisier
from unwrinkle.systems.station.world import StationFaults
from unwrinkle.testing.table import TABLE

MakeBench = Callable[..., Any]


@pytest.fixture(scope="module")
def head(station_cell: Cell) -> StereoHead:
    return nominal_calibration().stereo_head(station_cell.limits.head)


@pytest.fixture(scope="module")
def gaze(head: StereoHead) -> Gaze:
    return head.gaze_at(np.array([0.0, -1.1, 0.70]))


def test_one_exposure_for_one_command(bench: Any, gaze: Gaze, head: StereoHead) -> None:
    left = bench.look(gaze)
    right = bench.read("head.right_image")
    assert left.number == right.number == 1 and left.reason == right.reason == ""
    camera = head.left.camera
    assert left.pixels.shape == (round(camera.height / 8), round(camera.width / 8), 3)
    assert left.pixels.std() > 20.0 and (left.pixels != right.pixels).any()
    step = head.left.unit.step
    reported = np.array(dc.astuple(left.gaze))[:4]
    np.testing.assert_allclose(reported / step, np.rint(reported / step), atol=1e-9)
    np.testing.assert_allclose(reported, dc.astuple(gaze)[:4], atol=step / 2)
    np.testing.assert_allclose(bench.read("head.position_measured"), reported)
    true = bench.station.motion_log.between(bench.context, 0.0).head[-1]
    error = np.abs(true - reported) / step
    assert (error < 0.8).all() and error.max() > 0.01  # near, but not equal to the reported angle
    bench.go(1.0)
    assert bench.read("head.left_image") is left  # unchanged
    again = bench.look(gaze, 0.3)
    assert again.number == 2 and again.time > left.time
    noise = again.pixels.astype(float) - left.pixels
    assert 0.2 < noise.std() < 2.0 and abs(noise.mean()) < 0.05  # the same view, other noise


class _Reader(LeafSystem):
    """Slow perception and a supervisor that polls it: count how often a picture is evaluated."""

    def __init__(self) -> None:
        super().__init__()
        self.worked = 0
        self.seen = 0
        self._image = self.DeclareAbstractInputPort("image", Value(HeadImage()))
        ticket = {self.input_port_ticket(self._image.get_index())}
        self.DeclareAbstractOutputPort("result", lambda: Value([0]), self._work, ticket)

    def _work(self, context: Context, output: Value) -> None:
        self.worked += 1
        output.set_value([self._image.Eval(context).number])


class _Poller(LeafSystem):
    def __init__(self) -> None:
        super().__init__()
        self.numbers: list[int] = []
        self._result = self.DeclareAbstractInputPort("result", Value([0]))
        self.DeclarePeriodicUnrestrictedUpdateEvent(0.025, 0.0, self._poll)

    def _poll(self, context: Context, state: State) -> None:
        self.numbers.append(self._result.Eval(context)[0])


def test_what_is_made_of_a_picture_is_made_once(make_bench: MakeBench, gaze: Gaze) -> None:
    station = make_bench(faults=StationFaults(cameras={1: "black"})).station
    builder = DiagramBuilder()
    builder.AddSystem(station)
    reader, poller = builder.AddSystem(_Reader()), builder.AddSystem(_Poller())
    builder.Connect(station.GetOutputPort("head.left_image"), reader.get_input_port())
    builder.Connect(reader.get_output_port(), poller.get_input_port())
    builder.ExportInput(station.GetInputPort("head.command"), "head")
    for name in ("trajectory", "gripper.command"):
        builder.ExportInput(station.GetInputPort(name), name)
    simulator = Simulator(builder.Build())
    context = simulator.get_mutable_context()
    root = simulator.get_system()
    root.GetInputPort("head").FixValue(context, Value(HeadCommand(1, gaze)))
    root.GetInputPort("trajectory").FixValue(context, Value(TrajectoryCommand()))
    root.GetInputPort("gripper.command").FixValue(context, Value(GripperCommand()))
    simulator.AdvanceTo(2.0)
    assert poller.numbers[0] == 0 and poller.numbers[-1] == 1 and len(poller.numbers) > 70
    assert reader.worked == 2  # before the exposure and after it


def test_the_cameras_wait_for_the_arms(
    bench: Any, gaze: Gaze, swing: Callable[..., Trajectory]
) -> None:
    trajectory = swing(bench.read("joints.position_measured"), way=0.2)
    bench.send("trajectory", TrajectoryCommand(1, trajectory))
    assert bench.look(gaze, 0.9).number == 0
    bench.go(0.4)
    image = bench.read("head.left_image")
    assert image.number == 1 and image.time > 0.97


def test_the_cameras_wait_for_the_cloth_but_not_for_ever(make_bench: MakeBench, gaze: Gaze) -> None:
    bench = make_bench(faults=StationFaults(cameras={1: "black"}))
    cloth = bench.station.cloth
    flat = cloth.flat((0.0, -1.1))
    shaken = dc.replace(flat, velocities=flat.velocities + 0.5, asleep=False)
    bench = make_bench(state=shaken, faults=StationFaults(cameras={1: "black"}))
    image = bench.look(gaze, 3.5)
    asleep = bench.read("truth.cloth").time
    assert image.number == 1 and min(asleep, 3.0) - 0.1 < image.time < 3.5


def test_beyond_the_limits_nothing_moves(bench: Any, gaze: Gaze) -> None:
    before = bench.read("head.position_measured")
    image = bench.look(dc.replace(gaze, right_tilt=0.9), 0.3)
    assert image.number == 1 and image.pixels is None
    assert "right eye: tilt 0.9" in image.reason
    assert bench.read("head.right_image").reason == image.reason
    np.testing.assert_array_equal(bench.read("head.position_measured"), before)


def test_units_keep_their_speed(bench: Any, gaze: Gaze) -> None:
    bench.send("head.command", HeadCommand(1, dc.replace(gaze, left_pan=2.0)))
    bench.go(1.0)
    pan = bench.station.motion_log.between(bench.context, 0.0).head[:, 0]
    speed = np.diff(pan) / 0.004
    assert speed.max() == pytest.approx(2.6, rel=0.02)
    assert np.abs(np.diff(speed)).max() / 0.004 < 1.5 * ACCELERATION
    assert pan[-1] == pytest.approx(2.0, abs=0.002)


@pytest.mark.parametrize("fault", ["nothing", "black", "noise"])
def test_scripted_faults_come_once(make_bench: MakeBench, gaze: Gaze, fault: str) -> None:
    bench = make_bench(faults=StationFaults(cameras={1: fault}))
    image = bench.look(gaze)
    assert image.number == 1
    if fault == "nothing":
        assert image.pixels is None and "no image" in image.reason
    else:
        assert image.reason == "" and image.pixels.shape[2] == 3
        assert image.pixels.max() == 0 or (fault == "noise" and 70.0 < image.pixels.std() < 78.0)


def test_a_seed_gives_the_same_picture(station_cell: Cell, head: StereoHead, bench: Any) -> None:
    cloth = bench.station.cloth
    state = cloth.flat((0.0, -1.1))
    posture = CellPosture(np.zeros(13), np.array([0.0, -0.22, 0.12, -0.22]))
    photographer = CellPhotographer(station_cell, cloth, head, 3)
    first, again, other = (photographer.pair(posture, state, seed)[0] for seed in (1, 1, 2))
    assert (first == again).all() and (first != other).any()


def test_averaging_a_sensor() -> None:
    model = SensorModel()
    assert averaged(model, 1.0) is model
    half = averaged(model, 0.5)
    assert half.read_noise == pytest.approx(0.5 * model.read_noise)
    assert half.shot_gain == pytest.approx(0.25 * model.shot_gain)  # variance of a mean of four


def test_the_noise_alone_is_scaled_and_once_is_the_sensors_own() -> None:
    model = SensorModel()
    assert noisier(model, 1.0) == model
    twice, none = noisier(model, 2.0), noisier(model, 0.0)
    assert twice.read_noise == pytest.approx(2.0 * model.read_noise)
    assert twice.shot_gain == pytest.approx(4.0 * model.shot_gain)  # a variance per grey level
    assert (none.read_noise, none.shot_gain, none.blur) == (0.0, 0.0, model.blur)


def test_without_noise_all_seeds_give_one_picture(
    station_cell: Cell, head: StereoHead, bench: Any
) -> None:
    scenario = dc.replace(
        station_cell.scenario, sensor=dc.replace(station_cell.scenario.sensor, noise=0.0)
    )
    cloth, posture = (
        bench.station.cloth,
        CellPosture(np.zeros(13), np.array([0.0, -0.22, 0.12, -0.22])),
    )
    photographer = CellPhotographer(dc.replace(station_cell, scenario=scenario), cloth, head, 3)
    state = cloth.flat((0.0, -1.1))
    first, other = (photographer.pair(posture, state, seed)[0] for seed in (1, 2))
    assert (first == other).all() and first.std() > 1.0


def test_the_depth_camera_is_the_only_one_then(make_bench: MakeBench, gaze: Gaze) -> None:
    scenario = load_scenario()
    scenario.sensor.kind = "depth"
    bench = make_bench(load_cell(scenario))
    eye = bench.look(gaze)
    image = bench.read("depth_camera.image")
    assert image.number == 1 and image.reason == ""
    assert eye.pixels is None and "not in use" in eye.reason
    rows, columns = (
        slice(length // 2 - 40, length // 2 + 40) for length in image.capture.depth.shape
    )
    depth = image.capture.depth[rows, columns]
    height = 1.80 - np.median(depth[depth > 0.0])
    assert height == pytest.approx(0.70, abs=0.01)


@pytest.mark.slow
def test_heights_of_a_wrinkled_cloth_are_seen_to_the_millimetre(
    bench: Any, head: StereoHead
) -> None:
    scenario = load_scenario()
    scenario.sensor.scale = 0.25
    cell = load_cell(scenario)
    cloth = bench.station.cloth
    state = ridge(cloth, (0.0, -1.1), 1.3)
    gaze = head.gaze_at(np.array([0.0, -1.1, 0.70]))
    posture = CellPosture(np.zeros(13), np.array(dc.astuple(gaze))[:4])
    pair = CellPhotographer(cell, cloth, head, 0).pair(posture, state, 0)
    seen = range_map_from_pair(StereoPair(*pair), head, gaze, table=TABLE)
    truth, origin = height_map(cloth, state, seen.resolution)
    rows, columns = np.nonzero(np.isfinite(truth))
    shift = np.rint((np.array(origin) - seen.origin) / seen.resolution).astype(int)
    measured = seen.height[rows + shift[1], columns + shift[0]]
    valid = seen.valid[rows + shift[1], columns + shift[0]]
    error = measured - truth[rows, columns] - cloth.material.thickness
    assert valid.mean() > 0.95 and truth[rows, columns].max() > 0.012
    assert abs(np.median(error[valid])) < 0.0008
    assert np.sqrt(np.mean(error[valid] ** 2)) < 0.0015
