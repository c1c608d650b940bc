"""The diagram: named systems, connected as documented, evaluated on demand."""

import copy
import dataclasses as dc
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import Diagram, LeafSystem

from docs.diagram_figure import draw_diagram
from unwrinkle.flattening import station_messages
from unwrinkle.flattening.policy import PolicyState
from unwrinkle.flattening.state import SupervisorState
from unwrinkle.models.errors import NoGarmentError
from unwrinkle.models.robot import load_cell
from unwrinkle.models.scenario import load_scenario
from unwrinkle.perception.stereo import range_mapping
from unwrinkle.perception.stereo.head import Gaze
from unwrinkle.perception.stereo.head_file import nominal_calibration
from unwrinkle.systems import diagram as flattening_diagram
from unwrinkle.systems.diagram import Link, build_flattening_diagram, links, supervisor_state

INPUTS = {
    "trajectory": station_messages.TrajectoryCommand,
    "gripper.command": station_messages.GripperCommand,
    "head.command": station_messages.HeadCommand,
}
OUTPUTS = {
    "controller.status": station_messages.ControllerStatus,
    "gripper.status": station_messages.GripperStatus,
    "head.left_image": station_messages.HeadImage,
    "head.right_image": station_messages.HeadImage,
    "depth_camera.image": station_messages.DepthImage,
}


class BareStation(LeafSystem):
    """Station with ports and without function."""

    def __init__(self) -> None:
        super().__init__()
        self.images = {
            name: station_messages.HeadImage() for name in ("head.left_image", "head.right_image")
        }
        for name, kind in INPUTS.items():
            self.DeclareAbstractInputPort(name, AbstractValue.Make(kind()))
        self.DeclareVectorInputPort("speed_override", 1)
        for name, kind in OUTPUTS.items():
            self.DeclareAbstractOutputPort(
                name,
                lambda kind=kind: AbstractValue.Make(kind()),
                lambda context, out, name=name, kind=kind: out.set_value(
                    self.images.get(name, kind())
                ),
                {self.time_ticket()},
            )
        for name, size in (("joints.position_measured", 13), ("joints.velocity_measured", 13)):
            self.DeclareVectorOutputPort(name, size, lambda c, out: None, {self.nothing_ticket()})


def built(kind: str, **options: Any) -> tuple[Diagram, BareStation]:
    scenario = load_scenario()
    cell = load_cell(dc.replace(scenario, sensor=dc.replace(scenario.sensor, kind=kind)))
    head = nominal_calibration().stereo_head(cell.limits.head)
    station: Any = BareStation()
    return build_flattening_diagram(cell, station, head, **options), station


@pytest.fixture(scope="module")
def stereo() -> Iterator[tuple[Diagram, BareStation]]:
    yield built("stereo")


def test_systems_and_connections(stereo: tuple[Diagram, BareStation]) -> None:
    found = links(stereo[0])
    wanted = (*flattening_diagram.WIRES, *flattening_diagram.IMAGE_WIRES["stereo"])
    assert {dc.astuple(link) for link in found} == set(wanted) and len(found) == len(wanted)
    names = {system.get_name() for system in stereo[0].GetSystems()}
    assert names == {"station", "perception", "analysis", "planner", "verification", "supervisor"}
    graph = stereo[0].GetGraphvizString()
    assert all(f"name: {name}" in graph or name in graph for name in names)


def test_every_station_input_is_commanded(stereo: tuple[Diagram, BareStation]) -> None:
    commanded = {link.input for link in links(stereo[0]) if link.target == "station"}
    assert commanded == {*INPUTS, "speed_override"}


def test_depth_camera_is_the_other_sensor() -> None:
    found = links(built("depth")[0])
    assert Link("station", "depth_camera.image", "perception", "image") in found
    assert not any(link.output == "head.left_image" for link in found)


def test_figure_in_the_docs_is_this_diagram(
    stereo: tuple[Diagram, BareStation], tmp_path: Path, repository: Path
) -> None:
    draw_diagram(links(stereo[0]), tmp_path / "diagram.svg")

    def words(path: Path) -> list[str]:
        return sorted(re.findall(r"<text[^>]*>([^<]*)</text>", path.read_text(encoding="utf-8")))

    drawn = words(tmp_path / "diagram.svg")
    assert "supervisor" in drawn and "joints.position_measured" in drawn
    assert words(repository / "docs" / "diagram.svg") == drawn


def test_pictures_are_matched_once_per_exposure(
    stereo: tuple[Diagram, BareStation], monkeypatch: pytest.MonkeyPatch
) -> None:
    diagram, station = stereo
    calls = []

    def counted(*args: Any, **kwargs: Any) -> Any:
        calls.append(args)
        raise NoGarmentError("look: no garment found (nothing stands up)")

    monkeypatch.setattr(range_mapping, "range_map_from_pair", counted)
    context = diagram.CreateDefaultContext()
    perception = diagram.GetSubsystemByName("perception")
    own = perception.GetMyContextFromRoot(context)
    output = perception.GetOutputPort("range_map")
    assert output.Eval(own).number == 0 and calls == []
    rng = np.random.default_rng(0)
    pixels = rng.integers(20, 200, (2, 40, 60, 3), dtype=np.uint8)
    looks = {
        number: [
            station_messages.HeadImage(number, image, Gaze(), float(number)) for image in pixels
        ]
        for number in (1, 2)
    }
    for time, number in ((1.0, 1), (2.0, 1), (3.0, 2)):
        # A copy, as Drake makes one, is the image itself.
        station.images.update(zip(station.images, copy.deepcopy(looks[number]), strict=True))
        context.SetTime(time)
        found = output.Eval(own)
        assert found.number == number and found.empty and "no garment" in found.reason
    assert len(calls) == 2


@pytest.mark.parametrize(
    ("left", "right", "reason"),
    [
        (
            station_messages.HeadImage(1),
            station_messages.HeadImage(1, reason="x"),
            "left camera returned no image",
        ),
        (station_messages.HeadImage(2), station_messages.HeadImage(1), "belong to different looks"),
        (
            station_messages.HeadImage(3, np.zeros((40, 60, 3), np.uint8)),
            station_messages.HeadImage(3, np.zeros((40, 60, 3), np.uint8)),
            "is black",
        ),
    ],
)
def test_camera_faults_are_reasons(
    stereo: tuple[Diagram, BareStation],
    left: station_messages.HeadImage,
    right: station_messages.HeadImage,
    reason: str,
) -> None:
    diagram, station = stereo
    station.images.update({"head.left_image": left, "head.right_image": right})
    context = diagram.CreateDefaultContext()
    analysis = diagram.GetSubsystemByName("analysis")
    found = analysis.GetOutputPort("analysis").Eval(analysis.GetMyContextFromRoot(context))
    assert found.observation is None and reason in found.reason


def test_a_run_that_goes_on_counts_its_looks_on() -> None:
    diagram, _ = built("stereo", policy_state=PolicyState(looks=4, actions=3))
    context = diagram.CreateDefaultContext()
    now: SupervisorState = supervisor_state(diagram, context)
    assert (now.head.number, now.action.look, now.policy_state.actions) == (4, 5, 3)
    supervisor = diagram.GetSubsystemByName("supervisor")
    head = supervisor.GetOutputPort("head.command").Eval(supervisor.GetMyContextFromRoot(context))
    assert head.number == 0
