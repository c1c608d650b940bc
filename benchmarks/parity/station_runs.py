"""One plan run on a station of any simulated form, by hand.

And the closed loop, period by period.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator

from unwrinkle.flattening.execution.steps import steps_of
from unwrinkle.flattening.state import SupervisorSettings, SupervisorState
from unwrinkle.flattening.station_messages import (
    ControllerStatus,
    GripperCommand,
    GripperStatus,
    HeadCommand,
    TrajectoryCommand,
)
from unwrinkle.hardware.run_log.writer import RunLog
from unwrinkle.models.arrays import Array
from unwrinkle.models.errors import UnwrinkleError
from unwrinkle.models.robot import Cell, load_cell
from unwrinkle.models.scenario import Scenario
from unwrinkle.perception.stereo.head import StereoHead
from unwrinkle.perception.stereo.head_file import nominal_calibration
from unwrinkle.planning.motion_mode import MotionMode
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.simulation.cloth.cloth import Cloth, ClothState
from unwrinkle.simulation.cloth.initial_states import start_state
from unwrinkle.systems.diagram import build_flattening_diagram, supervisor_state
from unwrinkle.systems.station.factory import make_station
from unwrinkle.systems.station.motion_log import StationMotion
from unwrinkle.systems.station.world import SimulatedStation, simulated_cloth

#: The station is asked with this period, s; a step that takes so long is given up, s.
_PERIOD, _LONGEST = 0.025, 60.0
#: After the last step the cloth has so long to come to rest, s.
_SETTLING = 3.0


@dataclass(frozen=True, eq=False)
class StationRun:
    """What a plan did on a station.

    Attributes:
        names: of the segments.
        spans: for each segment, when it was commanded and when it was done, s on the station's
            clock.
        motion: measured, all of it.
        cloth: (n, 3) vertices in the end, m.
        holding: whether both grippers held cloth after closing.
    """

    names: tuple[str, ...]
    spans: tuple[tuple[float, float], ...]
    motion: StationMotion
    cloth: Array
    holding: bool


@dataclass(frozen=True, eq=False)
class Setting:
    """What a station is built of.

    Attributes:
        cell: the robot in its cell.
        head: the true stereo head.
        cloth: the garment's solver.
        start: how it lies.
        seed: of every random choice.
    """

    cell: Cell
    head: StereoHead
    cloth: Cloth
    start: ClothState
    seed: int

    @classmethod
    def of(cls, scenario: Scenario, seed: int) -> "Setting":
        """Of a scenario."""
        cell = load_cell(scenario)
        cloth = simulated_cloth(cell)
        x, y = scenario.garment_centre
        start = start_state(cloth, scenario.station.garment.start, (x, y), seed)
        return cls(cell, nominal_calibration().stereo_head(cell.limits.head), cloth, start, seed)

    @contextmanager
    def station(self, form: str, log: RunLog | None = None) -> Iterator[SimulatedStation]:
        """Make a fresh station of a simulated form."""
        with make_station(
            self.cell,
            form=form,
            seed=self.seed,
            cloth=self.cloth,
            state=self.start,
            head=self.head,
            log=log,
        ) as station:
            assert isinstance(station, SimulatedStation)
            yield station

    def situations(
        self, station: SimulatedStation, settings: SupervisorSettings | None = None
    ) -> Iterator[tuple[SupervisorState, ClothState]]:
        """Run the closed loop on a station, and yield the supervisor's state and the cloth, period
        by period.
        """
        diagram = build_flattening_diagram(
            self.cell, station, self.head, settings=settings, seed=self.seed
        )
        simulator = Simulator(diagram)
        context = simulator.get_mutable_context()
        diagram.GetInputPort("interrupt").FixValue(context, [0.0])
        truth = station.GetOutputPort("truth.cloth")
        simulator.Initialize()
        steps = 0
        while not supervisor_state(diagram, context).over:
            steps += 1
            simulator.AdvanceTo(steps * _PERIOD)
            yield (
                supervisor_state(diagram, context),
                truth.Eval(station.GetMyContextFromRoot(context)),
            )


def first_plan(setting: Setting) -> FlatteningPlan:
    """The first verified plan of the closed loop in simulation.

    Raises:
        UnwrinkleError: the loop ends without one.
    """
    now = None
    with setting.station("sim") as station:
        for now, _ in setting.situations(station):
            planned = now.action.planned
            if now.steps and planned is not None and planned.result is not None:
                assert planned.result.plan is not None
                return planned.result.plan
    raise UnwrinkleError(
        f"seed {setting.seed} gives no plan: {now.reason if now is not None else 'it never began'}"
    )


def run_on_station(
    station: SimulatedStation,
    cloth: Cloth,
    plan: FlatteningPlan,
    phases: Mapping[str, tuple[float, float]] | None = None,
) -> StationRun:
    """Run a plan, from home and with open grippers, to the end.

    Args:
        station: fresh.
        cloth: of the station.
        plan: to run.
        phases: for each segment a period, s, and when in it the segment is commanded; as soon as
            possible where left out.

    Raises:
        UnwrinkleError: the controller is in fault, or a step does not end.
    """
    simulator = Simulator(station)
    context = simulator.get_mutable_context()

    def send(port: str, command: Any) -> None:
        station.GetInputPort(port).FixValue(context, Value(command))

    def read(port: str) -> Any:
        return station.GetOutputPort(port).Eval(context)

    def on(duration: float) -> None:
        simulator.AdvanceTo(context.get_time() + duration)

    send("trajectory", TrajectoryCommand())
    send("gripper.command", GripperCommand())
    send("head.command", HeadCommand())
    station.GetInputPort("speed_override").FixValue(context, [1.0])
    simulator.Initialize()
    on(0.2)
    names, spans, holding = [], [], False
    for number, step in enumerate(steps_of(plan), start=1):
        if phases and step.name in phases:
            period, phase = phases[step.name]
            on((phase - context.get_time()) % period)
        begin = context.get_time()
        if step.trajectory is not None:
            send("trajectory", TrajectoryCommand(number, step.trajectory, step.name))
        else:
            send("gripper.command", GripperCommand(number, step.closed))
        while True:
            on(_PERIOD)
            waited = context.get_time() - begin
            status: ControllerStatus = read("controller.status")
            if status.state == MotionMode.FAULT or waited > _LONGEST:
                raise UnwrinkleError(f"{step.name}: {status.reason or 'it does not end'}")
            if step.trajectory is not None:
                if status.completed == number:
                    break
                continue
            jaws: GripperStatus = read("gripper.status")
            if jaws.command == number and waited >= step.dwell:
                holding = holding or all(jaws.holding)
                break
        if step.trajectory is not None:
            names.append(step.name)
            spans.append((begin, context.get_time()))
    on(_SETTLING)
    state: ClothState = read("truth.cloth")
    motion = station.motion_log.between(context, 0.0)
    return StationRun(tuple(names), tuple(spans), motion, cloth.vertices(state), holding)
