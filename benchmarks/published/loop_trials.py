"""Run the closed loop in the simulated cell as a trial, in this process, judged by the true cloth."""

import dataclasses as dc
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.analysis import Simulator

from benchmarks.harness.trials import KeptTrial
from unwrinkle.flattening.state import Action, Mode, SupervisorState
from unwrinkle.models.errors import InputError
from unwrinkle.models.io.archive import save_archive
from unwrinkle.models.robot import load_cell
from unwrinkle.models.scenario import Scenario, load_scenario, with_sensor
from unwrinkle.perception.stereo.compile_cache import ensure_compiled
from unwrinkle.simulation.cloth import initial_states
from unwrinkle.simulation.cloth.cloth import Cloth, ClothState
from unwrinkle.simulation.cloth.measures import TruthMeasures, measure
from unwrinkle.systems.diagram import build_flattening_diagram, supervisor_state
from unwrinkle.systems.station.base import Station
from unwrinkle.systems.station.factory import make_station
from unwrinkle.systems.station.world import simulated_cloth

#: A garment whose highest point is no higher than this above flat is flat in truth, m (the
#: published halt, 0.5 cm).
FLAT = 0.005
#: Feedback periods after which a run is given up: hours on the station's clock.
_MOST_PERIODS = 400_000
VERTICES = "vertices.npz"

_STARTS: dict[str, Callable[..., ClothState]] = {
    "ridge": initial_states.ridge,
    "bunched": initial_states.bunched,
    "pinched": initial_states.pinched,
    "dropped": initial_states.dropped,
}


@dataclass(frozen=True)
class Look:
    """One look at the table, and what was done about it.

    Attributes:
        outcome, reason: of it.
        arms: of the motion.
        wrinkle: index of the chosen one.
        asked: arms that were asked for.
        pull: distance of the first hand, m.
        wrinkles: found.
        refusals: motions that were not found or not verified.
        seconds: by stage.
        total: of all stages, s.
    """

    outcome: str
    reason: str
    arms: int
    wrinkle: int | None
    asked: str | None
    pull: float | None
    wrinkles: int
    refusals: tuple[dict[str, Any], ...]
    seconds: dict[str, float]
    total: float


@dataclass(frozen=True, kw_only=True)
class LoopRun:
    """A run of the loop.

    Attributes:
        status, reason: how it ended.
        actions: carried out.
        heights, coverages, overstretch: by true cloth, before the first and after every action; m,
            shares, shares.
        rni_truth: actions until the highest point was below FLAT; None where it never was.
        dual, single, missed: of the actions.
        dual_wanted, dual_found: motions for two arms that were looked for, and that were found and
            verified.
        looks: one after the other.
    """

    status: str
    reason: str
    actions: int
    heights: tuple[float, ...]
    coverages: tuple[float, ...]
    overstretch: tuple[float, ...]
    rni_truth: int | None
    dual: int
    single: int
    missed: int
    dual_wanted: int
    dual_found: int
    looks: tuple[Look, ...]


@dataclass(frozen=True, kw_only=True)
class LoopTrial(KeptTrial, LoopRun):
    """A run that was kept."""


def flattened(settings: dict[str, Any], folder: Path) -> LoopRun:
    """Run the loop to its end.

    Args:
        settings: `scenario` (what differs from the shipped one, nested as in the file), `seed` (of
            every random choice in the loop), `start` (`kind` and the arguments of `initial_states`'
            function of that name) and `material` (values that differ from the scenario's cloth,
            which the start is still made of).
        folder: takes the cloth's vertices before the first and after each action, `vertices.npz`.
    """
    scenario = changed(load_scenario(), settings.get("scenario", {}))
    scenario = with_sensor(scenario, scenario.sensor.kind)
    if scenario.sensor.kind == "stereo":
        ensure_compiled()
    cell, seed = load_cell(scenario), int(settings["seed"])
    cloth = simulated_cloth(cell)
    start = start_of(cloth, scenario, settings["start"])
    if settings.get("material"):
        cloth = Cloth(cloth.outline, cloth.material.changed(**settings["material"]), cloth.table)
        start = cloth.settle(dc.replace(start, asleep=False, quiet=0.0))
    with make_station(cell, form="sim", cloth=cloth, state=start, seed=seed) as station:
        return _to_the_end(station, cloth, folder)


def _to_the_end(station: Station, cloth: Cloth, folder: Path) -> LoopRun:
    cell, seed = station.cell, station.seed
    diagram = build_flattening_diagram(cell, station, station.head, seed=seed)
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    diagram.GetInputPort("interrupt").FixValue(context, [0.0])
    simulator.Initialize()
    record, truth = _Record(cloth), station.GetOutputPort("truth.cloth")
    period = cell.scenario.station.feedback_period
    before = supervisor_state(diagram, context)
    for step in range(1, _MOST_PERIODS):
        clock = time.perf_counter()
        simulator.AdvanceTo(step * period)
        now = supervisor_state(diagram, context)
        spent = time.perf_counter() - clock
        record.note(before, now, spent, truth.Eval(station.GetMyContextFromRoot(context)))
        before = now
        if now.over:
            break
    else:
        raise InputError(f"seed {seed}: the loop does not come to an end")
    record.keep(folder)
    return record.result(before)


def start_of(cloth: Cloth, scenario: Scenario, start: dict[str, Any]) -> ClothState:
    """How a cloth lies at first, its clock at 0.

    Args:
        cloth: the cloth.
        scenario: says where on the table.
        start: `kind`, and the arguments of `initial_states`' function of that name.

    Raises:
        InputError: an unknown kind, or values that its maker refuses.
    """
    values = dict(start)
    kind = values.pop("kind", None)
    x, y = scenario.garment_centre
    if kind == "flat":
        return cloth.flat((x, y), **values)
    if kind not in _STARTS:
        raise InputError(f"start {kind!r}: unknown; known are flat, {', '.join(_STARTS)}")
    return dc.replace(_STARTS[kind](cloth, (x, y), **values), time=0.0)


def changed(value: Any, changes: dict[str, Any]) -> Any:
    """A dataclass with other values, nested ones changed in turn.

    Raises:
        InputError: it has no such field.
    """
    known = {field.name for field in dc.fields(value)}
    unknown = sorted(set(changes) - known)
    if unknown:
        raise InputError(f"{type(value).__name__} has no {', '.join(unknown)}")
    return dc.replace(
        value,
        **{
            name: changed(getattr(value, name), new) if isinstance(new, dict) else new
            for name, new in changes.items()
        },
    )


class _Record:
    """What is noted of a run, period by period."""

    def __init__(self, cloth: Cloth) -> None:
        self._cloth = cloth
        self._truth: list[TruthMeasures] = []
        self._vertices: list[NDArray[np.float32]] = []
        self._looks: list[Look] = []
        self._seconds: dict[str, float] = {}

    def note(
        self, before: SupervisorState, now: SupervisorState, spent: float, cloth: ClothState
    ) -> None:
        mode = before.mode
        self._seconds[mode] = self._seconds.get(mode, 0.0) + spent
        if before.mode == Mode.LOOK and now.mode == Mode.PERCEIVE:
            self._measure(now.policy_state.actions, cloth)
        if now.finished is not before.finished:
            assert now.finished is not None
            self._end(now.finished)
        elif now.over:
            self._end(now.action)
            self._measure(now.policy_state.actions, cloth)

    def _measure(self, actions: int, cloth: ClothState) -> None:
        """The cloth at rest after so many actions.

        Of several looks without an action between, the last.
        """
        truth, vertices = measure(self._cloth, cloth), self._cloth.vertices(cloth)
        del self._truth[actions:], self._vertices[actions:]
        self._truth.append(truth)
        self._vertices.append(vertices.astype(np.float32))

    def _end(self, action: Action) -> None:
        plan = None
        if action.planned is not None and action.planned.result is not None:
            plan = action.planned.result.plan
        seconds = {
            "look": self._seconds.get(Mode.LOOK, 0.0),
            "perception": 0.0 if action.perceived is None else action.perceived.seconds,
            "analysis": 0.0 if action.analysed is None else action.analysed.seconds,
            "planning": self._seconds.get(Mode.PLAN, 0.0),
            "verification": self._seconds.get(Mode.CONFIRM, 0.0),
            "motion": sum(self._seconds.get(m, 0.0) for m in (Mode.MOVE, Mode.GRIP, Mode.RETREAT)),
        }
        arms = [] if plan is None else [arm is not None for arm in plan.arms]
        self._looks.append(
            Look(
                outcome=action.outcome,
                reason=action.reason,
                arms=sum(arms),
                wrinkle=None if action.pull is None else action.pull.wrinkle.index,
                asked=None if action.pull is None else action.pull.arms,
                pull=None if plan is None else plan.target.hands[0].pull_distance,
                wrinkles=(
                    0 if action.observation is None else len(action.observation.features.wrinkles)
                ),
                refusals=tuple(dc.asdict(refusal) for refusal in action.refusals),
                seconds=seconds,
                total=sum(self._seconds.values()),
            )
        )
        self._seconds = {}

    def keep(self, folder: Path) -> None:
        arrays: dict[str, NDArray[Any]] = {f"v{n}": v for n, v in enumerate(self._vertices)}
        arrays["triangles"] = self._cloth.triangles
        header = {"format": "unwrinkle.vertices", "flat_height": self._cloth.flat_height}
        save_archive(folder / VERTICES, header, arrays)

    def result(self, last: SupervisorState) -> LoopRun:
        pulls = [look for look in self._looks if look.outcome in ("done", "missed")]
        refused = [r for look in self._looks for r in look.refusals if r["arms"] == "dual"]
        dual = sum(look.asked == "dual" for look in pulls)
        heights = [truth.height for truth in self._truth]
        return LoopRun(
            status=last.status,
            reason=last.reason,
            actions=last.policy_state.actions,
            heights=tuple(heights),
            coverages=tuple(truth.coverage for truth in self._truth),
            overstretch=tuple(truth.overstretch for truth in self._truth),
            rni_truth=next((n for n, height in enumerate(heights) if height <= FLAT), None),
            dual=sum(look.arms == 2 for look in pulls),
            single=sum(look.arms == 1 for look in pulls),
            missed=sum(look.outcome == "missed" for look in pulls),
            dual_wanted=dual + len(refused),
            dual_found=dual,
            looks=tuple(self._looks),
        )
