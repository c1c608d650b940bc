"""The supervisor with a fake station and scripted observations, plans and verdicts."""

import dataclasses as dc
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from pydrake.common.value import AbstractValue
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem

from unwrinkle.flattening import station_messages
from unwrinkle.flattening.execution.state import Phase
from unwrinkle.flattening.messages import Analysed, Perceived, Planned, PlanRequest, Verified
from unwrinkle.flattening.state import SupervisorState
from unwrinkle.models.robot import Cell, load_cell
from unwrinkle.models.scenario import LoopSettings, load_scenario
from unwrinkle.perception.stereo.head_file import nominal_calibration
from unwrinkle.perception.target import NoTarget
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.systems.supervisor import FlatteningSupervisorSystem
from unwrinkle.testing.observations import TOWEL_CENTRE, SeenWrinkle, flat_towel_map, observation_of
from unwrinkle.testing.plans import result_of, short_plan, verdict_of

HOME = np.linspace(-0.3, 0.4, 13)
BIG = SeenWrinkle(0.10, 12.0, 0.020, 0.012)
SMALL = SeenWrinkle(-0.10, 10.0, 0.008, 0.006)
GONE = SeenWrinkle(0.10, 6.0, 0.001, 0.001)


def plan_of(number: int) -> FlatteningPlan:
    """Return the plan for a request of that number."""
    return short_plan(HOME, f"plan {number}")


@dc.dataclass
class Script:
    """Script: observations look by look (a text is a failure), and faults."""

    sights: tuple[Any, ...]
    planless: frozenset[tuple[int, str]] = frozenset()
    unsafe: frozenset[tuple[int, str]] = frozenset()
    misses: frozenset[int] = frozenset()
    refuses: int = 0
    stuck: bool = False
    dark: frozenset[int] = frozenset()
    verdict_of: str = ""
    asked: list[tuple[int, str]] = dc.field(default_factory=list)
    sent: list[tuple[str, float]] = dc.field(default_factory=list)


@dc.dataclass(frozen=True)
class World:
    """State of the station."""

    status: station_messages.ControllerStatus = dc.field(
        default_factory=station_messages.ControllerStatus
    )
    running: station_messages.TrajectoryCommand = dc.field(
        default_factory=station_messages.TrajectoryCommand
    )
    began: float = 0.0
    q: Any = dc.field(default_factory=lambda: HOME)
    v: Any = dc.field(default_factory=lambda: np.zeros(13))
    grip: station_messages.GripperStatus = dc.field(default_factory=station_messages.GripperStatus)
    exposed: int = 0


class FakeStation(LeafSystem):
    """Fake station, perception, planner and verification that follow a script."""

    def __init__(self, script: Script) -> None:
        super().__init__()
        self.script = script
        self.state = self.DeclareAbstractState(AbstractValue.Make(World()))
        self.DeclarePeriodicUnrestrictedUpdateEvent(0.02, 0.01, self.update)
        for name, kind in {
            "trajectory": station_messages.TrajectoryCommand,
            "gripper.command": station_messages.GripperCommand,
            "head.command": station_messages.HeadCommand,
            "request": PlanRequest,
        }.items():
            self.DeclareAbstractInputPort(name, AbstractValue.Make(kind()))
        ticket = {self.abstract_state_ticket(self.state)}
        request = {self.GetInputPort("request").ticket()} | ticket
        self.vector("joints.position_measured", 13, lambda w: w.q, ticket)
        self.vector("joints.velocity_measured", 13, lambda w: w.v, ticket)
        self.vector("exposed", 1, lambda w: [w.exposed], ticket)
        self.value(
            "controller.status", station_messages.ControllerStatus, lambda w, _: w.status, ticket
        )
        self.value("gripper.status", station_messages.GripperStatus, lambda w, _: w.grip, ticket)
        self.value("range_map", Perceived, lambda w, _: self.perceive(w), ticket)
        self.value("analysis", Analysed, lambda w, _: self.analyse(w), ticket)
        self.value("plan", Planned, lambda _, c: self.plan(c), request)
        self.value("verdict", Verified, lambda _, c: self.verify(c), request)

    def world(self, context: Any) -> World:
        found: World = context.get_abstract_state(self.state).get_value()
        return found

    def vector(self, name: str, size: int, part: Callable[[World], Any], ticket: Any) -> None:
        self.DeclareVectorOutputPort(
            name, size, lambda c, out: out.SetFromVector(part(self.world(c))), ticket
        )

    def value(self, name: str, kind: Any, part: Callable[..., Any], ticket: Any) -> None:
        self.DeclareAbstractOutputPort(
            name,
            lambda: AbstractValue.Make(kind()),
            lambda c, out: out.set_value(part(self.world(c), c)),
            ticket,
        )

    def update(self, context: Any, state: Any) -> None:
        world, script, time = self.world(context), self.script, context.get_time()
        command = self.GetInputPort("trajectory").Eval(context)
        if command.number > world.status.command:
            script.sent.append((command.name, time))
            status = station_messages.ControllerStatus(
                "running", command.number, world.status.completed
            )
            if command.number == script.refuses:
                status = dc.replace(status, state="idle", reason="it does not like it")
            if command.trajectory is None:
                status = station_messages.ControllerStatus("idle", command.number, command.number)
                world = dc.replace(world, v=np.zeros(13))
            world = dc.replace(world, status=status, running=command, began=time)
        moving = world.running.trajectory
        if world.status.state == "running" and moving is not None:
            t = min(time - world.began, moving.duration)
            motion = moving.interpolant()
            world = dc.replace(world, q=motion(t), v=motion(t, 1))
            if t == moving.duration:
                done = station_messages.ControllerStatus("idle", command.number, command.number)
                world = dc.replace(world, status=done)
        grip = self.GetInputPort("gripper.command").Eval(context)
        if grip.number > world.grip.command and not script.stuck:
            script.sent.append((f"gripper {grip.closed[0]:d}{grip.closed[1]:d}", time))
            holding = (grip.closed[0] and grip.number not in script.misses, grip.closed[1])
            world = dc.replace(
                world,
                grip=station_messages.GripperStatus(grip.number, (0.0, 0.0), grip.closed, holding),
            )
        head = self.GetInputPort("head.command").Eval(context)
        if head.number > world.exposed and head.number not in script.dark:
            world = dc.replace(world, exposed=head.number)
        state.get_mutable_abstract_state(self.state).set_value(world)

    def sight(self, world: World) -> Any:
        return self.script.sights[min(world.exposed, len(self.script.sights)) - 1]

    def wrinkle(self, request: PlanRequest) -> int:
        """Return the index of the requested wrinkle; -1 before the first request."""
        if isinstance(request.target, NoTarget):
            return -1
        places = [float(each.target.p_WC[0]) for each in (BIG, SMALL)]
        return places.index(float(request.target.p_WC[0]))

    def perceive(self, world: World) -> Perceived:
        sight = self.sight(world)
        if isinstance(sight, str):
            return Perceived(world.exposed, None, sight, empty="empty" in sight)
        return Perceived(world.exposed, flat_towel_map())

    def analyse(self, world: World) -> Analysed:
        return Analysed(world.exposed, observation_of(self.sight(world)))

    def plan(self, context: Any) -> Planned:
        request = self.GetInputPort("request").Eval(context)
        key = (self.wrinkle(request), request.arms)
        if not self.script.asked or self.script.asked[-1] != key:
            self.script.asked.append(key)
        if key in self.script.planless:
            return Planned(request.number, None, f"no {request.arms}-arm motion", request=request)
        return Planned(request.number, result_of(plan_of(request.number)), request=request)

    def verify(self, context: Any) -> Verified:
        request = self.GetInputPort("request").Eval(context)
        of = self.script.verdict_of or plan_of(request.number).content_hash
        unsafe = (self.wrinkle(request), request.arms) in self.script.unsafe
        problems = ("too near",) if unsafe else ()
        return Verified(request.number, of, verdict_of(of, *problems))


class Run:
    """The supervisor in the fake station."""

    def __init__(self, script: Script, **rules: Any) -> None:
        scenario = dc.replace(load_scenario(), loop=LoopSettings(**rules))
        cell: Cell = load_cell(scenario)
        head = nominal_calibration().stereo_head(cell.limits.head)
        builder = DiagramBuilder()
        self.supervisor = builder.AddNamedSystem(
            "supervisor", FlatteningSupervisorSystem(cell, head)
        )
        station = builder.AddNamedSystem("station", FakeStation(script))
        for port in (station.get_output_port(i) for i in range(station.num_output_ports())):
            builder.Connect(port, self.supervisor.GetInputPort(port.get_name()))
        for port in (station.get_input_port(i) for i in range(station.num_input_ports())):
            builder.Connect(self.supervisor.GetOutputPort(port.get_name()), port)
        self.interrupt = builder.ExportInput(self.supervisor.GetInputPort("interrupt"))
        self.diagram = builder.Build()
        self.simulator = Simulator(self.diagram)
        self.modes: list[str] = []
        self.script = script

    def now(self) -> SupervisorState:
        context = self.simulator.get_context()
        return self.supervisor.supervisor_state(self.supervisor.GetMyContextFromRoot(context))

    def until(
        self, over: Callable[[SupervisorState], bool] = lambda now: now.over
    ) -> SupervisorState:
        """Advance until a condition holds; record every mode on the way."""
        step = 0
        while not over(self.now()):
            step += 1
            assert step < 8000, f"no end, last in {self.now().mode}"
            self.simulator.AdvanceTo(self.simulator.get_context().get_time() + 0.025)
            if not self.modes or self.modes[-1] != self.now().mode:
                self.modes.append(self.now().mode)
        return self.now()


def sent(script: Script) -> list[str]:
    return [name for name, _ in script.sent]


def test_one_action_makes_it_flat() -> None:
    run = Run(Script(((BIG,), (GONE,))))
    end = run.until()
    assert end.status == "flat" and end.policy_state.actions == 1
    action = "look perceive decide plan confirm move grip move grip move"
    assert " ".join(run.modes) == f"{action} look perceive decide done"
    assert sent(run.script) == ["approach", "gripper 11", "pull", "gripper 00", "release"]
    assert end.finished is not None and end.finished.outcome == "done"
    steps = end.finished.steps
    assert [step.name for step in steps] == ["approach", "close", "pull", "open", "release"]
    assert all(step.finished - step.sent >= 0.2 for step in steps)
    assert end.finished.verified is not None and end.finished.planned is not None
    assert end.centre == pytest.approx((*TOWEL_CENTRE, 0.7), abs=1e-3)


def test_flat_at_once_moves_nothing() -> None:
    run = Run(Script(((GONE,),)))
    end = run.until()
    assert (end.status, end.policy_state.actions, sent(run.script)) == ("flat", 0, [])
    assert "flat" in end.reason and end.action.outcome == "flat"


def test_a_high_wrinkle_with_a_small_pull_is_pulled() -> None:
    high = SeenWrinkle(0.1, 8.0, 0.002, 0.006)
    run = Run(Script(((high,), (GONE,))))
    assert run.until().policy_state.actions == 1


def test_missed_grasp_goes_back_and_tries_again_then_the_next_wrinkle() -> None:
    script = Script(((BIG, SMALL),) * 3 + ((GONE,),), misses=frozenset({1, 3}))
    run = Run(script)
    end = run.until()
    assert end.status == "flat" and end.policy_state.actions == 3
    missed = ["approach", "gripper 11", "gripper 00", "retreat"]
    assert sent(script) == [
        *missed,
        *missed,
        "approach",
        "gripper 11",
        "pull",
        "gripper 00",
        "release",
    ]
    assert script.asked == [(0, "dual"), (1, "dual")]
    assert "retreat" in run.modes


def test_unplannable_next_then_one_arm_then_give_up() -> None:
    dual, single = frozenset({(0, "dual"), (1, "dual")}), frozenset({(0, "single"), (1, "single")})
    script = Script(((BIG, SMALL), (GONE,)), planless=dual)
    end = Run(script).until()
    assert end.status == "flat" and script.asked == [(0, "dual"), (1, "dual"), (0, "single")]
    assert end.finished is not None and len(end.finished.refusals) == 2
    script = Script(((BIG, SMALL),), planless=dual | single)
    end = Run(script).until()
    assert end.status == "stopped" and sent(script) == []
    assert "no motion" in end.reason and "single" in end.reason


def test_a_verdict_that_fails_is_never_sent() -> None:
    script = Script(((BIG,),), unsafe=frozenset({(0, "dual"), (0, "single")}))
    end = Run(script).until()
    assert end.status == "stopped" and sent(script) == [] and "too near" in end.reason


def test_a_verdict_of_another_plan_is_never_sent() -> None:
    script = Script(((BIG,),), verdict_of="plan of yesterday")
    end = Run(script).until()
    assert end.status == "fault" and sent(script) == [] and "verdict is of plan" in end.reason


@pytest.mark.parametrize(
    ("script", "reason"),
    [
        (Script(((BIG,),), refuses=2), "refused the motion: it does not like it"),
        (Script(((BIG,),), stuck=True), "the grippers did not close"),
    ],
)
def test_a_failed_execution_latches_the_fault(script: Script, reason: str) -> None:
    run = Run(script)
    end = run.until()
    assert end.mode == "fault" and end.status == "fault" and reason in end.reason
    assert end.action.outcome == "fault" and end.execution.result is not None
    assert run.modes[-2:] == ["hold", "fault"]
    count = len(script.sent)
    run.simulator.AdvanceTo(run.simulator.get_context().get_time() + 1.0)
    assert run.now().mode == "fault" and len(script.sent) == count


def test_actions_that_change_nothing_escalate_and_end() -> None:
    script = Script(((BIG, SMALL),))
    end = Run(script).until()
    assert end.status == "stopped" and "4 actions in a row changed nothing" in end.reason
    assert script.asked == [(0, "dual"), (1, "dual"), (0, "single")]
    assert end.policy_state.actions == 4


def test_action_limit() -> None:
    sights = tuple((SeenWrinkle(0.1, 12.0 - k, 0.02, 0.01),) for k in range(5))
    end = Run(Script(sights), actions=3).until()
    assert end.status == "stopped" and end.policy_state.actions == 3
    assert "not flat after 3 actions" in end.reason


@pytest.mark.parametrize("fault", ["the camera returned nothing", "table is empty"])
def test_nothing_seen_stops_after_a_second_look(fault: str) -> None:
    end = Run(Script((fault, fault))).until()
    assert end.status == "stopped" and fault in end.reason and end.head.number == 2
    again = Run(Script((fault, (GONE,)))).until()
    assert again.status == "flat" and again.head.number == 2


def test_cameras_that_never_answer() -> None:
    end = Run(Script(((GONE,),), dark=frozenset({1, 2}))).until()
    assert end.status == "stopped" and "no camera answered" in end.reason


@pytest.mark.parametrize("mode", ["look", "plan", "move", "grip"])
def test_interrupt_ends_at_rest(mode: str) -> None:
    run = Run(Script(((BIG,), (GONE,))))
    moving = {"move": Phase.MOVING, "grip": Phase.GRIPPING}
    run.until(lambda now: now.mode == mode and now.execution.phase == moving.get(mode, "idle"))
    context = run.simulator.get_mutable_context()
    run.diagram.get_input_port(0).FixValue(context, [1.0])
    end = run.until()
    assert end.status == "interrupted" and end.action.outcome == "interrupted"
    assert (sent(run.script)[-1:] == ["hold"]) == (mode == "move")
    station = run.diagram.GetSubsystemByName("station")
    speeds = station.GetOutputPort("joints.velocity_measured").Eval(
        station.GetMyContextFromRoot(run.simulator.get_context())
    )
    assert np.abs(speeds).max() == 0.0
