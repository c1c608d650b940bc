"""Build the flattening diagram.

It contains station, perception, analysis, planner, verification and supervisor.
"""

from dataclasses import dataclass

from pydrake.systems.framework import Context, Diagram, DiagramBuilder, LeafSystem

from unwrinkle.flattening.policy import PolicyState
from unwrinkle.flattening.state import SupervisorSettings, SupervisorState
from unwrinkle.flattening.state_machine import Approve
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell
from unwrinkle.perception.stereo.head import StereoHead
from unwrinkle.planning.search.settings import PlannerSettings
from unwrinkle.systems.perception.analysis import AnalysisSystem
from unwrinkle.systems.perception.depth import DepthPerceptionSystem
from unwrinkle.systems.perception.ground_truth import TruePerceptionSystem
from unwrinkle.systems.perception.stereo import StereoPerceptionSystem
from unwrinkle.systems.planning.planner import PlannerSystem
from unwrinkle.systems.planning.verification import VerificationSystem
from unwrinkle.systems.station.world import SimulatedStation
from unwrinkle.systems.supervisor import FlatteningSupervisorSystem

#: Names of the subsystems.
STATION = "station"
PERCEPTION = "perception"
ANALYSIS = "analysis"
PLANNER = "planner"
VERIFICATION = "verification"
SUPERVISOR = "supervisor"

#: Connections as (system, output port, system, input port), except for the images, which depend on
#: the sensor.
WIRES = (
    (PERCEPTION, "range_map", ANALYSIS, "range_map"),
    (PERCEPTION, "exposed", SUPERVISOR, "exposed"),
    (PERCEPTION, "range_map", SUPERVISOR, "range_map"),
    (ANALYSIS, "analysis", SUPERVISOR, "analysis"),
    (SUPERVISOR, "request", PLANNER, "request"),
    (PLANNER, "plan", VERIFICATION, "plan"),
    (PLANNER, "plan", SUPERVISOR, "plan"),
    (VERIFICATION, "verdict", SUPERVISOR, "verdict"),
    (STATION, "joints.position_measured", SUPERVISOR, "joints.position_measured"),
    (STATION, "joints.velocity_measured", SUPERVISOR, "joints.velocity_measured"),
    (STATION, "controller.status", SUPERVISOR, "controller.status"),
    (STATION, "gripper.status", SUPERVISOR, "gripper.status"),
    (SUPERVISOR, "trajectory", STATION, "trajectory"),
    (SUPERVISOR, "gripper.command", STATION, "gripper.command"),
    (SUPERVISOR, "head.command", STATION, "head.command"),
    (SUPERVISOR, "speed_override", STATION, "speed_override"),
)
#: Connections of the images, by the scenario's sensor.
IMAGE_WIRES = {
    "stereo": (
        (STATION, "head.left_image", PERCEPTION, "left_image"),
        (STATION, "head.right_image", PERCEPTION, "right_image"),
    ),
    "depth": ((STATION, "depth_camera.image", PERCEPTION, "image"),),
    "truth": (
        (STATION, "depth_camera.image", PERCEPTION, "image"),
        (STATION, "truth.cloth", PERCEPTION, "cloth"),
    ),
}


@dataclass(frozen=True)
class Link:
    """One connection of a diagram, from an output port to an input port."""

    source: str
    output: str
    target: str
    input: str


def build_flattening_diagram(
    cell: Cell,
    station: Diagram,
    head: StereoHead,
    *,
    settings: SupervisorSettings | None = None,
    planner: PlannerSettings | None = None,
    policy_state: PolicyState | None = None,
    approve: Approve | None = None,
    seed: int = 0,
) -> Diagram:
    """Build the closed loop around a station.

    Args:
        cell: robot and cell; its scenario selects the sensor and the rules of the loop.
        station: system with the ports named in `WIRES`, in any of its three forms.
        head: calibrated stereo head, as perception uses it.
        settings: settings of the supervisor; the defaults if left out.
        planner: settings of the planner; the defaults if left out.
        policy_state: state of the policy of a resumed run.
        approve: callback that asks the operator about each verified plan; None approves every plan.
        seed: seed of perception's random numbers.

    Raises:
        InputError: the sensor is `truth`, and the station is not simulated.

    Returns:
        Diagram with the input `interrupt`, vector (1,), which may be left unconnected, and
        subsystems of the names above.
    """
    builder = DiagramBuilder()
    kind = cell.scenario.sensor.kind
    perception = _perception(cell, station, head, seed)
    supervisor = FlatteningSupervisorSystem(
        cell, head, settings=settings, policy_state=policy_state, approve=approve
    )
    systems = {
        STATION: station,
        PERCEPTION: perception,
        ANALYSIS: AnalysisSystem(cell),
        PLANNER: PlannerSystem(cell, planner),
        VERIFICATION: VerificationSystem(cell),
        SUPERVISOR: supervisor,
    }
    for name, system in systems.items():
        system.set_name(name)
        builder.AddSystem(system)
    for source, output, target, input_port in (*WIRES, *IMAGE_WIRES[kind]):
        builder.Connect(
            systems[source].GetOutputPort(output), systems[target].GetInputPort(input_port)
        )
    builder.ExportInput(supervisor.GetInputPort("interrupt"), "interrupt")
    diagram = builder.Build()
    diagram.set_name("flattening")
    return diagram


def _perception(cell: Cell, station: Diagram, head: StereoHead, seed: int) -> LeafSystem:
    kind = cell.scenario.sensor.kind
    if kind == "stereo":
        return StereoPerceptionSystem(cell, head, seed=seed)
    if kind == "depth":
        return DepthPerceptionSystem(cell, seed=seed)
    if not isinstance(station, SimulatedStation):
        raise InputError("sensor truth: only a simulated cloth is known; choose stereo or depth")
    state = station.GetOutputPort("truth.cloth").Allocate().get_value()
    return TruePerceptionSystem(station.cloth, state, seed=seed)


def supervisor_state(diagram: Diagram, context: Context) -> SupervisorState:
    """Return the state of a diagram's supervisor; `context` is that of the diagram."""
    supervisor = diagram.GetSubsystemByName(SUPERVISOR)
    assert isinstance(supervisor, FlatteningSupervisorSystem)
    return supervisor.supervisor_state(supervisor.GetMyContextFromRoot(context))


def links(diagram: Diagram) -> tuple[Link, ...]:
    """Return the connections of a diagram, in order of the receiving systems and ports."""
    systems = diagram.GetSystems()
    order = {system: index for index, system in enumerate(systems)}
    found = [
        (
            order[receiver],
            int(to),
            Link(
                sender.get_name(),
                sender.get_output_port(of).get_name(),
                receiver.get_name(),
                receiver.get_input_port(to).get_name(),
            ),
        )
        for (receiver, to), (sender, of) in diagram.connection_map().items()
    ]
    return tuple(link for _, _, link in sorted(found, key=lambda item: item[:2]))
