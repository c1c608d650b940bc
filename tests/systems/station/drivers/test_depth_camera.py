"""Depth camera behind the station's ports: one exposure per command, at rest, and faults."""

import dataclasses as dc
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator

from unwrinkle.flattening.station_messages import (
    DepthImage,
    GripperCommand,
    HeadCommand,
    TrajectoryCommand,
)
from unwrinkle.hardware.cameras.factory import CAMERAS, CameraKind
from unwrinkle.hardware.cameras.openni import DepthFrame, OpenNi2Camera
from unwrinkle.models.errors import HardwareError, InputError
from unwrinkle.models.robot import Cell, load_cell
from unwrinkle.models.scenario import load_scenario, with_sensor
from unwrinkle.models.site import CameraSite, PanTiltSite, Site, loopback_site
from unwrinkle.planning.motion_mode import MotionMode
from unwrinkle.site.virtual_equipment import VirtualEquipment
from unwrinkle.systems.station.drivers.depth_camera import DepthCameraDriverSystem
from unwrinkle.systems.station.factory import make_station

pytestmark = pytest.mark.alone

Frame = NDArray[Any]
SITE = CameraSite("openni2", timeout=5.0, attempts=1)


@pytest.fixture(scope="module")
def depth_cell() -> Cell:
    return load_cell(with_sensor(load_scenario(), "depth"))


class Table:
    """Fake device: an image of the table with a fold, or a scripted image."""

    def __init__(self) -> None:
        self.frame: Frame = np.full((480, 640), 1100, np.uint16)
        self.frame[200:220, 100:300] -= 20
        self.colour: Frame | None = None
        self.problem = ""
        self.grabs = 0
        self.free = threading.Event()
        self.free.set()

    def __call__(self) -> DepthFrame:
        self.grabs += 1
        assert self.free.wait(20.0)
        if self.problem:
            raise HardwareError(self.problem)
        return DepthFrame(self.frame, self.colour)


class Bench:
    """The driver's system alone, on a clock that the test advances."""

    def __init__(self, cell: Cell, table: Table) -> None:
        self.system = DepthCameraDriverSystem(cell, OpenNi2Camera(SITE, table), period=0.025)
        self.simulator = Simulator(self.system)
        self.context = self.simulator.get_mutable_context()
        self.look(0)
        self.speed(0.0)

    def look(self, number: int) -> None:
        self.system.GetInputPort("command").FixValue(self.context, Value(HeadCommand(number)))

    def speed(self, value: float) -> None:
        self.system.GetInputPort("velocity").FixValue(self.context, np.full(13, value))

    def go(self) -> None:
        self.simulator.AdvanceTo(self.context.get_time() + 0.025)

    def image(self, number: int) -> DepthImage:
        end = time.monotonic() + 20.0
        while time.monotonic() < end:
            self.go()
            image: DepthImage = self.system.GetOutputPort("depth_image").Eval(self.context)
            if image.number == number:
                return image
            time.sleep(0.002)
        raise AssertionError(f"no exposure {number}")


@pytest.fixture
def table() -> Table:
    return Table()


def test_one_exposure_for_one_command(depth_cell: Cell, table: Table) -> None:
    bench = Bench(depth_cell, table)
    for _ in range(4):
        bench.go()
    assert table.grabs == 0
    bench.look(3)
    image = bench.image(3)
    assert image.reason == "" and image.capture is not None and table.grabs == 1
    capture = image.capture
    assert capture.depth[0, 0] == pytest.approx(1.1) and capture.depth[210, 200] == pytest.approx(
        1.08
    )
    assert capture.camera.name == "xtion-pro-live" and capture.X_WC is not None
    np.testing.assert_allclose(capture.X_WC[:3, 3], depth_cell.scenario.sensor.depth_camera_place)
    for _ in range(4):
        bench.go()
    assert bench.system.GetOutputPort("depth_image").Eval(bench.context) is image
    eye = bench.system.GetOutputPort("left_image").Eval(bench.context)
    assert eye.number == 3 and eye.pixels is None and "not in use" in eye.reason
    assert capture.colour is None
    table.colour = np.full((480, 640, 3), 90, np.uint8)
    bench.look(4)
    again = bench.image(4).capture
    assert again is not None and again.colour is not None and again.colour_registered
    assert table.grabs == 2


def test_it_waits_for_the_arms_and_throws_away_what_they_spoil(
    depth_cell: Cell, table: Table
) -> None:
    bench = Bench(depth_cell, table)
    bench.speed(0.1)
    bench.look(1)
    for _ in range(4):
        bench.go()
    assert table.grabs == 0
    table.free.clear()
    bench.speed(0.0)
    bench.go()
    bench.speed(0.1)
    table.free.set()
    image = bench.image(1)
    assert image.capture is None and image.reason == "the robot moved during the exposure"


@pytest.mark.parametrize(
    ("frame", "problem", "words"),
    [
        (None, "it is unplugged", "it is unplugged"),
        (np.zeros((480, 640), np.uint16), "", "no depth at all"),
        (np.full((240, 320), 1100, np.uint16), "", r"shape (240, 320)"),
        (np.eye(480, 640, dtype=np.uint16) * 1100, "", "insufficient view"),
    ],
)
def test_without_a_picture_there_is_a_reason(
    depth_cell: Cell, table: Table, frame: Frame | None, problem: str, words: str
) -> None:
    table.problem = problem
    if frame is not None:
        table.frame = frame
    bench = Bench(depth_cell, table)
    bench.look(1)
    image = bench.image(1)
    assert image.capture is None and words in image.reason
    table.frame, table.problem = Table().frame, ""
    bench.look(2)
    assert bench.image(2).capture is not None  # the next look is a new one


@pytest.fixture
def site(depth_cell: Cell) -> Iterator[Site]:
    """A virtual controller in real time; no pan-tilt units."""
    site = loopback_site()
    equipment = VirtualEquipment(
        site, depth_cell.limits, depth_cell.robot.named_states["home"], ports=(0, 0, 0)
    )
    over = threading.Event()

    def run() -> None:
        while not over.wait(0.002):
            equipment.step(time.monotonic())

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    ports = dict(zip(("motion_port", "state_port", "io_port"), equipment.server.ports, strict=True))
    yield dc.replace(
        site,
        controller=dc.replace(site.controller, **ports),
        pan_tilt=PanTiltSite(),
        cameras=SITE,
    )
    over.set()
    thread.join(5.0)
    equipment.close()


def _go_until(simulator: Any, done: Callable[[], bool]) -> None:
    """Run in real time until a condition holds."""
    for _ in range(400):
        begin = time.monotonic()
        simulator.AdvanceTo(simulator.get_context().get_time() + 0.025)
        if done():
            return
        time.sleep(max(0.0, 0.025 - (time.monotonic() - begin)))
    raise AssertionError("it does not happen")


def test_the_hardware_station_sees_with_it(
    depth_cell: Cell, site: Site, table: Table, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(
        CAMERAS, "openni2", CameraKind(lambda site: OpenNi2Camera(site, table), depth=True)
    )
    with make_station(depth_cell, form="hardware", site=site, go=True) as station:
        simulator = Simulator(station)
        context = simulator.get_mutable_context()
        for port, command in (
            ("trajectory", TrajectoryCommand()),
            ("gripper.command", GripperCommand()),
            ("head.command", HeadCommand(1)),
        ):
            station.GetInputPort(port).FixValue(context, Value(command))
        station.GetInputPort("speed_override").FixValue(context, [1.0])
        seen = station.GetOutputPort("depth_camera.image")
        _go_until(simulator, lambda: seen.Eval(context).number == 1)
        assert seen.Eval(context).reason == "" and table.grabs == 1
        assert station.GetOutputPort("controller.status").Eval(context).state == MotionMode.IDLE
        assert "not in use" in station.GetOutputPort("head.right_image").Eval(context).reason
        np.testing.assert_array_equal(
            station.GetOutputPort("head.position_measured").Eval(context), np.zeros(4)
        )


def test_camera_and_sensor_have_to_fit(depth_cell: Cell, station_cell: Cell, site: Site) -> None:
    def opened(cell: Cell, site: Site) -> None:
        with make_station(cell, form="hardware", site=site, go=True):
            raise AssertionError("it was opened")

    pairs = dc.replace(site, cameras=CameraSite("folder", folder="."))
    with pytest.raises(InputError, match="is 'folder'; give openni2, or use --sensor stereo"):
        opened(depth_cell, pairs)
    turned = dc.replace(site, pan_tilt=PanTiltSite("/dev/one", "/dev/two"))
    with pytest.raises(InputError, match="use --sensor xtion"):
        opened(station_cell, turned)
    with pytest.raises(InputError, match=r"needs cameras.kind, grippers.kind$"):
        opened(
            depth_cell,
            dc.replace(site, cameras=CameraSite(), grippers=dc.replace(site.grippers, kind="none")),
        )
