"""One pipeline: the command line, the library and the diagram make the same of one capture."""

import dataclasses as dc
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import unwrinkle as uw
from unwrinkle import cli
from unwrinkle.flattening.execution import executor
from unwrinkle.flattening.flattener import Choice, NoChoice, choose
from unwrinkle.flattening.observation import GarmentFeatures, WrinkleFeatures
from unwrinkle.flattening.policy import PolicyState
from unwrinkle.models.robot import load_cell
from unwrinkle.models.scenario import LoopSettings, load_scenario
from unwrinkle.perception.folds.garment_state import GarmentState
from unwrinkle.perception.target import NoTarget
from unwrinkle.testing.scripted_station import Script, run_loop

TOWEL = uw.model_file("captures/towel.npz")


@pytest.fixture(scope="module")
def flattener() -> uw.Flattener:
    return uw.Flattener(uw.load_cell())


@pytest.fixture(scope="module")
def seen(flattener: uw.Flattener) -> uw.Observation:
    return flattener.observe(uw.load_capture(TOWEL))


@pytest.fixture(scope="module")
def proposal(flattener: uw.Flattener, seen: uw.Observation) -> uw.Proposal:
    return flattener.propose(seen)


def test_command_line_library_and_diagram_agree(
    proposal: uw.Proposal, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert proposal.plan is not None and proposal.choice is not None
    words = ["unwrinkle", "plan", str(TOWEL), "--no-pictures", "--out", str(tmp_path)]
    monkeypatch.setattr(sys, "argv", words)
    with pytest.raises(SystemExit) as stop:
        cli.main()
    assert stop.value.code == 0
    at_the_command_line = uw.FlatteningPlan.load(tmp_path / "plan.npz")

    scenario = load_scenario()
    cell = load_cell(dc.replace(scenario, sensor=dc.replace(scenario.sensor, kind="depth")))
    looks = [uw.load_capture(TOWEL)]

    def look(number: int) -> uw.Capture:
        if number > len(looks):
            raise OSError("the camera is gone")
        return looks[number - 1]

    executed: list[uw.FlatteningPlan] = []
    begin = executor.begin

    def recorded(before: Any, plan: uw.FlatteningPlan, time: float) -> Any:
        executed.append(plan)
        return begin(before, plan, time)

    monkeypatch.setattr(executor, "begin", recorded)
    run_loop(Script(look), cell=cell)
    (in_the_diagram,) = executed
    assert in_the_diagram.target.to_json() == proposal.plan.target.to_json()
    assert at_the_command_line.target.to_json() == proposal.plan.target.to_json()
    saved = json.loads((tmp_path / "analysis.json").read_text())["target"]
    assert saved["wrinkle"] == proposal.choice.decision.wrinkle.index
    assert at_the_command_line.content_hash == proposal.plan.content_hash
    assert in_the_diagram.content_hash == proposal.plan.content_hash
    assert proposal.verdict is not None and proposal.verdict.passed


def test_pull_gain_and_extra_of_the_scenario_are_applied(
    seen: uw.Observation, proposal: uw.Proposal
) -> None:
    assert proposal.choice is not None
    bare = seen.analysis.target_for(proposal.choice.decision.wrinkle.index)
    assert isinstance(bare, uw.FlatteningTarget)
    rules = LoopSettings()
    for asked, hand in zip(bare.hands, proposal.choice.target.hands, strict=True):
        wanted = rules.pull_gain * asked.pull_distance + rules.pull_extra
        assert hand.pull_distance == pytest.approx(wanted)


def test_a_proposal_says_why_there_is_none(seen: uw.Observation) -> None:
    cell = uw.load_cell()
    flat = uw.Flattener(cell, rules=dc.replace(cell.scenario.loop, halting_height=1.0))
    profile = dc.replace(seen.analysis.profile, halting_pull=1.0)
    features = dc.replace(seen.features, halting_pull=profile.halting_pull)
    proposal = flat.propose(dc.replace(seen, features=features))
    assert proposal.plan is None and not proposal.flat
    assert proposal.reason.startswith("wrinkled: stands")
    level = dc.replace(features, state=GarmentState.FLAT)
    proposal = flat.propose(dc.replace(seen, features=level))
    assert proposal.plan is None and proposal.flat and proposal.reason.startswith("flat")
    with pytest.raises(uw.InputError, match="any, dual, single"):
        flat.propose(seen, arms="both")


def test_wrinkles_without_a_target_are_passed_over() -> None:
    class Analysis:
        def target_for(self, index: int) -> NoTarget:
            return NoTarget(f"no target {index}")

    wrinkles = tuple(
        WrinkleFeatures(k, (0.2 * k, -1.1), 0.0, 100.0 - k, 0.02, 0.01) for k in range(2)
    )

    class Seen:
        analysis = Analysis()
        features = GarmentFeatures(wrinkles)

    chosen = choose(Seen(), PolicyState(), LoopSettings())
    assert isinstance(chosen, NoChoice) and not chosen.stop.flat
    assert [(r.wrinkle, r.arms) for r in chosen.refusals] == [
        (0, "dual"),
        (1, "dual"),
        (0, "single"),
        (1, "single"),
    ]
    assert "no target 1" in chosen.stop.reason


def test_the_state_of_the_policy_decides_what_is_next(
    flattener: uw.Flattener, seen: uw.Observation, proposal: uw.Proposal
) -> None:
    first = flattener.choose(seen)
    assert isinstance(first, Choice)
    second = flattener.choose(seen, PolicyState(idle=flattener.rules.idle_one_arm))
    assert isinstance(second, Choice)
    assert (first.decision.arms, second.decision.arms) == ("dual", "single")
    assert np.isfinite(first.target.p_WC).all()


def test_arms_of_the_scenario_and_start_by_name(seen: uw.Observation) -> None:
    cell = uw.load_cell()
    single = uw.Flattener(cell, rules=dc.replace(cell.scenario.loop, arms="single"))
    proposal = single.propose(seen, start="home")
    assert proposal.plan is not None and not proposal.plan.dual
    with pytest.raises(uw.InputError, match="no state of the robot"):
        single.propose(seen, start="nowhere")


@pytest.mark.parametrize("wrong", ["depth.png", np.zeros((4, 4)), None])
def test_what_is_no_capture_is_refused(flattener: uw.Flattener, wrong: Any) -> None:
    with pytest.raises(uw.InputError, match="load_capture"):
        flattener.observe(wrong)
    with pytest.raises(uw.InputError, match="observe"):
        flattener.propose(wrong)
    with pytest.raises(uw.InputError, match="FlatteningTarget"):
        flattener.plan(wrong)
