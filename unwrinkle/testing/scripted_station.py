"""A scripted station for the closed loop.

Real supervisor, perception, planner and verification around fake devices.
"""

import dataclasses as dc
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import BasicVector, Context, Diagram, LeafSystem, State

from unwrinkle.flattening import station_messages
from unwrinkle.flattening.state import SupervisorState
from unwrinkle.models.arrays import Array
from unwrinkle.models.robot import Cell, load_cell
from unwrinkle.models.scenario import load_scenario
from unwrinkle.models.shared import Shared
from unwrinkle.perception.camera import Camera
from unwrinkle.perception.depth.capture import Capture
from unwrinkle.perception.stereo.head_file import nominal_calibration
from unwrinkle.planning.motion_mode import MotionMode
from unwrinkle.simulation.rendering.synthetic_towel import Towel, capture_of, overhead_pose
from unwrinkle.systems.abstract_state import set_state_value, state_value
from unwrinkle.systems.diagram import build_flattening_diagram, supervisor_state

#: What the depth camera gives at the n-th exposure (from 1); an exception's text becomes the
#: reason.
DepthPictures = Callable[[int], Capture]

_PERIOD = 0.025
_OFF_BEAT = 0.010
#: A depth camera straight above the garment's usual place.
CAMERA = Camera("overhead", 400, 300, 437.5, 437.5, 199.5, 149.5, sensor="stereo")


@cache
def towel_capture(
    towel: Towel, *, sigma: float = 0.0001, seed: int = 0, x: float | None = None
) -> Capture:
    """Return what a camera 1.6 m above the floor sees of a towel, without colour.

    Args:
        towel: that is seen.
        sigma: standard deviation of the depths, m.
        seed: of their noise.
        x: of the camera, m; over the towel if left out.
    """
    pose = overhead_pose(towel.centre[0] if x is None else x, towel.centre[1], 1.6)
    taken = capture_of(towel, CAMERA, pose, sigma=sigma, seed=seed)
    return dc.replace(taken, colour=None, colour_registered=False)


@dataclass
class Script:
    """What the devices do, and what they were told.

    Attributes:
        look: gives the picture of the n-th exposure.
        no_close: exposures of grippers (n-th closing command) at which these hands hold nothing:
            (right, left).
        lost_at: segment during which the cloth slips out of both hands.
        deaf: numbers of gripper commands that get lost.
        dark: exposures that never come.
        sent: names of commands that arrived, in order.
        posture: where the arms stood when each came, (13,) rad.
    """

    look: DepthPictures
    no_close: dict[int, tuple[bool, bool]] = field(default_factory=dict)
    lost_at: str = ""
    deaf: frozenset[int] = frozenset()
    dark: frozenset[int] = frozenset()
    sent: list[str] = field(default_factory=list)
    posture: list[Array] = field(default_factory=list)


def _no_camera(number: int) -> Capture:
    raise OSError("there is no camera")


@dataclass(frozen=True, eq=False)
class _World(Shared):
    q: Array
    v: Array
    status: station_messages.ControllerStatus = field(
        default_factory=station_messages.ControllerStatus
    )
    running: station_messages.TrajectoryCommand = field(
        default_factory=station_messages.TrajectoryCommand
    )
    began: float = 0.0
    grip: station_messages.GripperStatus = field(default_factory=station_messages.GripperStatus)
    closings: int = 0
    picture: station_messages.DepthImage = field(default_factory=station_messages.DepthImage)


class ScriptedStation(LeafSystem):
    """A station with ideal arms, whose camera and grippers follow a script."""

    def __init__(self, start: Array) -> None:
        """Stand at `start` (13,), rad; `script` has to be set before anything runs."""
        super().__init__()
        self.script = Script(_no_camera)
        self._state = self.DeclareAbstractState(Value(_World(start, np.zeros_like(start))))
        self.DeclarePeriodicUnrestrictedUpdateEvent(_PERIOD, _OFF_BEAT, self._update)
        for name, example in (
            ("trajectory", station_messages.TrajectoryCommand()),
            ("gripper.command", station_messages.GripperCommand()),
            ("head.command", station_messages.HeadCommand()),
        ):
            self.DeclareAbstractInputPort(name, Value(example))
        self.DeclareVectorInputPort("speed_override", 1)
        ticket = {self.abstract_state_ticket(self._state)}
        values: tuple[tuple[str, Any, Callable[[_World], Any]], ...] = (
            ("controller.status", station_messages.ControllerStatus(), lambda w: w.status),
            ("gripper.status", station_messages.GripperStatus(), lambda w: w.grip),
            (
                "head.left_image",
                station_messages.HeadImage(),
                lambda w: station_messages.HeadImage(),
            ),
            (
                "head.right_image",
                station_messages.HeadImage(),
                lambda w: station_messages.HeadImage(),
            ),
            ("depth_camera.image", station_messages.DepthImage(), lambda w: w.picture),
        )
        for name, example, part in values:
            self.DeclareAbstractOutputPort(
                name, lambda example=example: Value(example), self._value(part), ticket
            )
        vectors: tuple[tuple[str, int, Callable[[_World], Array]], ...] = (
            ("joints.position_measured", 13, lambda w: w.q),
            ("joints.velocity_measured", 13, lambda w: w.v),
            ("head.position_measured", 4, lambda w: np.zeros(4)),
        )
        for name, size, read in vectors:
            self.DeclareVectorOutputPort(name, size, self._vector(read), ticket)

    def _value(self, part: Callable[[_World], Any]) -> Callable[[Context, Any], None]:
        return lambda context, output: output.set_value(part(state_value(context, self._state)))

    def _vector(self, part: Callable[[_World], Array]) -> Callable[[Context, BasicVector], None]:
        return lambda context, output: output.SetFromVector(part(state_value(context, self._state)))

    def _update(self, context: Context, state: State) -> None:
        world: _World = state_value(context, self._state)
        now = context.get_time()
        world = self._moved(world, self.GetInputPort("trajectory").Eval(context), now)
        world = self._gripped(world, self.GetInputPort("gripper.command").Eval(context))
        head: station_messages.HeadCommand = self.GetInputPort("head.command").Eval(context)
        if head.number > world.picture.number and head.number not in self.script.dark:
            world = dc.replace(world, picture=self._exposed(head.number, now))
        set_state_value(state, self._state, world)

    def _moved(
        self, world: _World, command: station_messages.TrajectoryCommand, now: float
    ) -> _World:
        script = self.script
        if command.number > world.status.command:
            script.sent.append(command.name)
            script.posture.append(world.q)
            status = station_messages.ControllerStatus(
                MotionMode.RUNNING, command.number, world.status.completed
            )
            if command.trajectory is None:  # it is at rest at once
                status = station_messages.ControllerStatus(
                    MotionMode.IDLE, command.number, command.number
                )
            world = dc.replace(world, status=status, running=command, began=now)
        moving = world.running.trajectory
        if world.status.state != MotionMode.RUNNING or moving is None:
            return dc.replace(world, v=np.zeros(13))
        t = min(now - world.began, moving.duration)
        motion = moving.interpolant()
        world = dc.replace(world, q=motion(t), v=motion(t, 1))
        if t >= moving.duration:
            number = world.running.number
            done = station_messages.ControllerStatus(MotionMode.IDLE, number, number)
            return dc.replace(world, status=done, v=np.zeros(13))
        if script.lost_at and world.running.name == script.lost_at and t > 0.5 * moving.duration:
            world = dc.replace(world, grip=dc.replace(world.grip, holding=(False, False)))
        return world

    def _gripped(self, world: _World, command: station_messages.GripperCommand) -> _World:
        script = self.script
        if command.number <= world.grip.command or command.number in script.deaf:
            return world
        word = "close" if any(command.closed) else "open"
        script.sent.append(word)
        script.posture.append(world.q)
        closings = world.closings + any(command.closed)
        empty = (
            script.no_close.get(closings, (False, False)) if any(command.closed) else (True,) * 2
        )
        holding = tuple(c and not e for c, e in zip(command.closed, empty, strict=True))
        grip = station_messages.GripperStatus(
            command.number, (0.0, 0.0), command.closed, (holding[0], holding[1])
        )
        return dc.replace(world, grip=grip, closings=closings)

    def _exposed(self, number: int, now: float) -> station_messages.DepthImage:
        try:
            return station_messages.DepthImage(number, self.script.look(number), now)
        except Exception as error:  # noqa: BLE001  what a camera's driver may raise
            return station_messages.DepthImage(
                number, None, now, f"{type(error).__name__}: {error}"
            )


@dataclass(frozen=True, eq=False)
class LoopRun:
    """A closed loop that has ended.

    Attributes:
        end: the supervisor's last supervisor_state.
        outcomes: of the actions, in order, each with its reason.
        sent: commands that reached the devices.
        start, stands: where the arms stood first and last, (13,) rad.
        duration: on the station's clock, s.
    """

    end: SupervisorState
    outcomes: tuple[tuple[str, str], ...]
    sent: tuple[str, ...]
    start: Array
    stands: Array
    duration: float


@cache
def depth_cell() -> Cell:
    """Return the shipped cell with the depth camera as its sensor."""
    scenario = load_scenario()
    return load_cell(dc.replace(scenario, sensor=dc.replace(scenario.sensor, kind="depth")))


@cache
def _loop(cell: Cell) -> tuple[Diagram, ScriptedStation]:
    """Build the loop around a scripted station; its models take a second to build."""
    head = nominal_calibration().stereo_head(cell.limits.head)
    station: Any = ScriptedStation(_home(cell))
    return build_flattening_diagram(cell, station, head), station


def _home(cell: Cell) -> Array:
    return np.array(cell.robot.named_states["home"], dtype=float)


def run_loop(script: Script, *, cell: Cell | None = None, most: float = 200.0) -> LoopRun:
    """Run the whole loop around a scripted station until it ends.

    Args:
        script: of the devices.
        cell: whose sensor is the depth camera.
        most: s on the station's clock.

    Raises:
        TimeoutError: it did not end in that time.
    """
    cell = cell or depth_cell()
    diagram, station = _loop(cell)
    station.script = script
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    outcomes: list[tuple[str, str]] = []
    last = None
    while True:
        now = supervisor_state(diagram, context)
        if now.finished is not None and now.finished is not last:
            last = now.finished
            outcomes.append((last.outcome, last.reason))
        if now.over:
            break
        if context.get_time() > most:
            raise TimeoutError(f"the loop is in {now.mode} after {most:g} s")
        simulator.AdvanceTo(context.get_time() + 4 * _PERIOD)
    outcomes.append((now.action.outcome, now.action.reason))
    own = station.GetMyContextFromRoot(context)
    stands = np.array(station.GetOutputPort("joints.position_measured").Eval(own))
    return LoopRun(
        now, tuple(outcomes), tuple(script.sent), _home(cell), stands, context.get_time()
    )
