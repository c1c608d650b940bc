"""A connected robot for programs: the virtual controller, confirmation, the operator's stop."""

import os
import signal
import threading
import time
from pathlib import Path

import pytest

import unwrinkle as uw
from unwrinkle.execution.robot import Robot
from unwrinkle.hardware.controller_state import DriverState
from unwrinkle.models.site import Site
from unwrinkle.testing.targets import flattening_task

pytestmark = [pytest.mark.alone, pytest.mark.end_to_end]


@pytest.fixture(scope="module")
def plan() -> uw.FlatteningPlan:
    found = uw.Flattener(uw.load_cell()).plan(flattening_task((0.0, -1.10), 0.2))
    assert found.plan is not None
    return found.plan


def test_plans_run_one_after_the_other_until_ctrl_c(
    plan: uw.FlatteningPlan, tmp_path: Path
) -> None:
    log = tmp_path / "run.jsonl"
    with uw.connect("loopback", log=log) as robot:
        with pytest.raises(uw.InputError, match="speed"):
            robot.execute(plan, speed=2.0)
        with pytest.raises(uw.InputError, match="FlatteningPlan"):
            robot.execute(None)  # type: ignore[arg-type]
        result = robot.execute(plan)
        assert result.finished == ("approach", "pull", "release")
        grippers = robot.equipment.grippers
        assert grippers is not None and grippers.status.closed == (False, False)

        def press() -> None:  # once the second execution has closed the grippers again
            while not all(grippers.status.closed):
                time.sleep(0.01)
            while robot.equipment.driver.status.state != DriverState.RUNNING:
                time.sleep(0.01)
            os.kill(os.getpid(), signal.SIGINT)

        operator = threading.Thread(target=press, daemon=True)
        operator.start()
        with pytest.raises(KeyboardInterrupt, match="stopped after approach: SIGINT"):
            robot.execute(plan)
        operator.join()
        assert robot.equipment.driver.status.state != DriverState.RUNNING
    assert "commanded" in log.read_text(encoding="utf-8")


def test_a_real_site_needs_the_plans_hash(plan: uw.FlatteningPlan) -> None:
    class Virtual:
        """Stands for everything that must not be asked before the confirmation."""

    for site, match in (
        (Site(name="lab", commissioning=False), "does not confirm"),
        (Site(name="lab"), "commissioning"),
    ):
        robot = Robot(site, uw.load_cell(), Virtual(), Virtual())  # type: ignore[arg-type]
        with pytest.raises(uw.InputError, match=match):
            robot.execute(plan, confirm="000000")


def test_a_site_that_does_not_answer_leaves_no_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*args: object, **named: object) -> None:
        raise uw.HardwareError("nobody answers")

    monkeypatch.setattr("unwrinkle.execution.robot.connected", refuse)
    log = tmp_path / "run.jsonl"
    with pytest.raises(uw.HardwareError, match="nobody answers"), uw.connect("loopback", log=log):
        pass
    assert not log.exists()
