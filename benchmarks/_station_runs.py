"""One plan run on a station of any simulated form, by hand: its segments and strokes one after the other."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator

from unwrinkle.flattening_run import FlatteningRun
from unwrinkle.flattening_setup import build_loop
from unwrinkle.models.errors import UnwrinkleError
from unwrinkle.models.scenario import Scenario
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.simulation.cloth import Cloth, ClothState
from unwrinkle.systems.execution import steps_of
from unwrinkle.systems.motion_log import Motion
from unwrinkle.systems.ports import (
    FAULT,
    ControllerStatus,
    GripperCommand,
    GripperStatus,
    HeadCommand,
    TrajectoryCommand,
)
from unwrinkle.systems.simulated_world import SimulatedStation

Array = NDArray[np.float64]

#: The station is asked with this period, s; a step that takes so long is given up, s.
_PERIOD, _LONGEST = 0.025, 60.0
#: After the last step the cloth has so long to come to rest, s.
_SETTLING = 3.0


@dataclass(frozen=True, eq=False)
class StationRun:
    """What a plan did on a station.

    Attributes:
        names: of the segments.
        spans: for each segment, when it was commanded and when it was done, s on the station's clock.
        motion: measured, all of it.
        cloth: (n, 3) vertices in the end, m.
        holding: whether both grippers held cloth after closing.
    """

    names: tuple[str, ...]
    spans: tuple[tuple[float, float], ...]
    motion: Motion
    cloth: Array
    holding: bool


class _Enough(Exception):
    """The plan is known."""


class _FirstPlan:
    """A watcher that waits for the first confirmed plan."""

    plan: FlatteningPlan | None = None

    def update(self, before: Any, now: Any, station: Any, seconds: Any) -> None:
        planned = now.action.planned
        if now.steps and planned is not None and planned.result is not None:
            self.plan = planned.result.plan
            raise _Enough


def first_plan(scenario: Scenario, seed: int) -> FlatteningPlan:
    """The first verified plan of a closed loop in simulation.

    Raises:
        UnwrinkleError: the loop ends without one.
    """
    watcher = _FirstPlan()
    try:
        ending = FlatteningRun(build_loop(scenario, seed=seed), (watcher,)).run()
    except _Enough:
        assert watcher.plan is not None
        return watcher.plan
    raise UnwrinkleError(f"seed {seed} gives no plan: {ending.reason}")


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
        phases: for each segment a period, s, and when in it the segment is commanded; as soon as possible where left out.

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
            if status.state == FAULT or waited > _LONGEST:
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
