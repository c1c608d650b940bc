"""Trials of the benchmark `garments`.

Ours, and bare hands that follow a simple policy from the very same start.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.harness.trials import Trial
from benchmarks.published.garments.baseline_policies import POLICIES, Pull, carried_out
from benchmarks.published.garments.results import PolicyRun, StartMade
from benchmarks.published.loop_trials import VERTICES, changed, start_of
from unwrinkle.models.errors import InputError
from unwrinkle.models.io.archive import save_archive
from unwrinkle.models.robot import load_cell
from unwrinkle.models.scenario import Scenario, load_scenario
from unwrinkle.simulation.cloth.cloth import Cloth, ClothError, ClothState
from unwrinkle.simulation.cloth.measures import measure
from unwrinkle.systems.perception.true_range_map import true_range_map
from unwrinkle.systems.station.world import simulated_cloth

OURS, TOGETHER = "ours", "together"
#: Ways of the closed loop: what they change in its rules.
LOOPS: dict[str, dict[str, Any]] = {
    OURS: {"order": "volume", "pull": "wrinkle"},
    TOGETHER: {"order": "together", "pull": "section"},
}
METHODS = (*LOOPS, *POLICIES)
STARTS = ("bunched", "pinched")
#: Each of the cloth that it is usually made of, on a grid that lets the benchmark end within hours.
NODES = 50
GARMENTS: dict[str, dict[str, Any]] = {
    "towel": {"outline": "towel", "material": "terry", "texture": "terry", "nodes": NODES},
    "tshirt": {"outline": "tshirt", "material": "jersey", "texture": "print", "nodes": NODES},
    "trousers": {"outline": "trousers", "material": "cotton", "texture": "plain", "nodes": NODES},
    "dishcloth": {"outline": "dishcloth", "material": "cotton", "texture": "print", "nodes": NODES},
}
#: After every so many actions of a baseline its cloth is kept.
KEPT = 5
# What the cloth's solver raises where it cannot follow: its own error, or that of an array for
# cloth that flew apart.
_UNSOLVED = (ClothError, ValueError)
_LOOKS = 1000  # a run's looks have seeds of their own


def start_trial(start: str, garment: str, seed: int) -> Trial:
    """Return the trial that makes a start, and says whether the cloth's solver could."""
    return Trial(
        f"{start}-{garment}-{seed}-start",
        "benchmarks.published.garments.trials:made",
        {
            "scenario": {"station": {"garment": GARMENTS[garment]}},
            "start": {"kind": start, "seed": seed},
        },
    )


def wanted(seeds: Mapping[tuple[str, str], Sequence[int]], *, actions: int) -> list[Trial]:
    """Return a trial per start kind, garment, seed and method; those of one start stand together.

    Args:
        seeds: by start kind (of STARTS) and garment (of GARMENTS): of the starts, and of all else
            that is random in a trial.
        actions: that each method may use.
    """
    trials = []
    for (start, garment), chosen in seeds.items():
        for seed in chosen:
            for method in METHODS:
                settings = _settings(garment, start, seed, method, actions)
                work = (
                    "benchmarks.published.loop_trials:flattened"
                    if method in LOOPS
                    else "benchmarks.published.garments.trials:by_policy"
                )
                name = f"{start}-{garment}-{seed}-{method}"
                trials.append(Trial(name, work, settings))
    return trials


def _settings(garment: str, start: str, seed: int, method: str, actions: int) -> dict[str, Any]:
    scenario: dict[str, Any] = {"station": {"garment": GARMENTS[garment]}}
    common = {"scenario": scenario, "seed": seed, "start": {"kind": start, "seed": seed}}
    if method in LOOPS:
        scenario["loop"] = {"actions": actions, **LOOPS[method]}
        scenario["sensor"] = {"kind": "truth"}
        return common
    return {**common, "policy": method, "actions": actions}


def made(settings: dict[str, Any], folder: Path) -> StartMade:
    """Make a start and keep it for the trials of the policies.

    Args:
        settings: `scenario` and `start`, as of `by_policy`.
        folder: of the trial; the folder above it keeps the starts.

    Raises:
        InputError: settings that the scenario or the start's maker refuses.
    """
    scenario = changed(load_scenario(), settings["scenario"])
    cloth = simulated_cloth(load_cell(scenario))
    try:
        _start(cloth, scenario, settings["start"], folder.parent)
    except _UNSOLVED as error:
        return StartMade(made=False, reason=str(error))
    return StartMade(made=True, reason="")


def by_policy(settings: dict[str, Any], folder: Path) -> PolicyRun:
    """Let bare hands follow a policy for all actions that they have.

    Args:
        settings: `policy` (of POLICIES), `actions`, and as of `loop_trials.flattened` `scenario`,
            `seed`, `start`.
        folder: takes the cloth's vertices at first and after every KEPT actions, `vertices.npz`;
            the folder above it keeps the starts.

    Raises:
        InputError: an unknown policy, or settings that the scenario refuses.
    """
    if settings["policy"] not in POLICIES:
        raise InputError(
            f"policy {settings['policy']!r}: unknown; known are {', '.join(sorted(POLICIES))}"
        )
    policy, seed = POLICIES[settings["policy"]], int(settings["seed"])
    scenario = changed(load_scenario(), settings.get("scenario", {}))
    cell = load_cell(scenario)
    cloth = simulated_cloth(cell)
    rng = np.random.default_rng(seed)
    state = _start(cloth, scenario, settings["start"], folder.parent)
    truth, kept = [measure(cloth, state)], [cloth.vertices(state)]
    pulls: list[Pull] = []
    count = {"idle": 0, "empty": 0, "broken": 0}
    for action in range(int(settings["actions"])):
        seen = true_range_map(cloth, state, _LOOKS * seed + action)
        pull = policy(seen, cell.table, rng, pulls)
        if pull is None:
            count["idle"] += 1
        else:
            pulls.append(pull)
            try:
                after = carried_out(cloth, state, pull)
            except _UNSOLVED:
                count["broken"] += 1
                cloth = simulated_cloth(cell)  # nothing of the failure stays in scratch memory
            else:
                count["empty"] += after is state
                state = after
        truth.append(measure(cloth, state))
        if (action + 1) % KEPT == 0:
            kept.append(cloth.vertices(state))
    _keep(folder, cloth, [*kept, cloth.vertices(state)])
    return PolicyRun(
        status="used all actions",
        reason="",
        actions=int(settings["actions"]),
        coverages=tuple(one.coverage for one in truth),
        heights=tuple(one.height for one in truth),
        overstretch=tuple(one.overstretch for one in truth),
        idle=count["idle"],
        empty=count["empty"],
        broken=count["broken"],
    )


def _start(cloth: Cloth, scenario: Scenario, start: dict[str, Any], benchmark: Path) -> ClothState:
    """The start, made once for all policies: folds take the processor 10 to 20 s."""
    garment = scenario.station.garment.outline
    words = "-".join(str(value) for value in start.values())
    path = benchmark / "starts" / f"{garment}-{words}.npz"
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        start_of(cloth, scenario, start).save(path)
    return ClothState.load(path)


def _keep(folder: Path, cloth: Cloth, vertices: list[NDArray[np.float64]]) -> None:
    arrays: dict[str, NDArray[Any]] = {
        f"v{k}": places.astype(np.float32) for k, places in enumerate(vertices)
    }
    arrays["triangles"] = cloth.triangles
    header = {"format": "unwrinkle.vertices", "flat_height": cloth.flat_height}
    save_archive(folder / VERTICES, header, arrays)
