"""The closed loop through the drivers, against virtual devices in lockstep."""

from pathlib import Path

import numpy as np
import pytest

from unwrinkle.closed_loop.session import Choices, begin_run
from unwrinkle.hardware.run_log.reader import read_run_log
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.sent_samples import as_sent
from unwrinkle.runs.folder import RunFolder


@pytest.mark.slow
@pytest.mark.end_to_end
def test_an_action_through_the_drivers_in_lockstep(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    session = begin_run(
        Choices(start="ridge", station="loopback", sensor="truth", actions=1), None, folder
    )
    ending = session.run()
    assert ending.status in ("stopped", "flat")
    run = RunFolder.open(folder)
    action = run.look(0).action()
    assert action.outcome == "done" and len(action.arms) == 2
    assert action.violations == ()
    assert action.following_error is not None and action.following_error < 1e-3
    records = read_run_log(folder / "controller-1.jsonl")
    assert not records.cut
    assert len(records.commanded.times) > 200 and len(records.measured.times) > 200
    plan = FlatteningPlan.load(run.look(0).path / "plan.npz")
    # What was sent at full speed is the plan as it was verified, sample by sample, after a point of
    # rest.
    sent, samples = records.commanded, as_sent(plan.segments[0].trajectory)
    first = np.flatnonzero(sent.numbers == sent.numbers[0])[-len(samples.times) :]
    np.testing.assert_array_equal(sent.positions[first], samples.positions)
    np.testing.assert_array_equal(sent.velocities[first], samples.velocities)
    since = sent.point_times[first] - sent.point_times[first[0]]
    np.testing.assert_allclose(since, samples.times, atol=1e-9)
