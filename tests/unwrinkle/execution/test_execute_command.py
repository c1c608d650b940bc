"""`unwrinkle execute` as a user runs it, in real time, against a virtual controller in another
process.
"""

import dataclasses as dc
import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from unwrinkle.execution.session import ExecutionOptions, ExecutionSession
from unwrinkle.hardware.run_log.reader import RunLogRecords, read_run_log
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell, load_cell
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.search.planner import FlatteningPlanner
from unwrinkle.planning.sent_samples import as_sent
from unwrinkle.site.sites import find_site

pytestmark = [pytest.mark.end_to_end, pytest.mark.slow, pytest.mark.alone]

ROBOT = Path(__file__).with_name("virtual_robot.py")
LONGEST = 60.0


@pytest.fixture(scope="module")
def plan_file(cell: Cell, tmp_path_factory: pytest.TempPathFactory) -> Path:
    from unwrinkle.testing.targets import flattening_task

    result = FlatteningPlanner(cell).plan(flattening_task((0.0, -1.10), 0.2))
    assert result.plan is not None
    path = tmp_path_factory.mktemp("plan") / "plan.npz"
    result.plan.save(path)
    return path


class Robot:
    """The process of a virtual controller."""

    def __init__(self, options: dict[str, Any]) -> None:
        pipe = subprocess.PIPE
        command = [sys.executable, str(ROBOT), json.dumps(options)]
        self._process = subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True)
        assert self._process.stdout is not None
        self.ports: list[int] = json.loads(self._process.stdout.readline())

    def say(self, word: str) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(word + "\n")
        self._process.stdin.flush()

    def end(self) -> dict[str, Any]:
        """End the process; return its report."""
        out, _ = self._process.communicate("end\n", timeout=LONGEST)
        found: dict[str, Any] = json.loads(out)
        return found

    def kill(self) -> None:
        self._process.kill()
        self._process.communicate()


@dc.dataclass
class Bench:
    """A virtual robot, a site file for it, and the command to run against it."""

    robot: Robot
    site: Path
    plan: Path
    folder: Path

    @property
    def hash(self) -> str:
        return FlatteningPlan.load(self.plan).content_hash

    @property
    def log(self) -> Path:
        return self.folder / "run.jsonl"

    def records(self) -> RunLogRecords:
        return read_run_log(self.log)

    def begin(self, *arguments: str) -> subprocess.Popen[str]:
        script = "from unwrinkle.cli import main; main()"
        command = [sys.executable, "-c", script, "execute", str(self.plan)]
        pipe = subprocess.PIPE
        return subprocess.Popen(
            [*command, "--site", str(self.site), *arguments],
            cwd=self.folder,
            env={**os.environ, "XDG_STATE_HOME": str(self.folder / "state")},
            stdin=subprocess.DEVNULL,
            stdout=pipe,
            stderr=pipe,
            text=True,
        )

    def execute(self, *arguments: str) -> tuple[int, str, str]:
        """Run the command to its end; return exit code, output, errors."""
        process = self.begin(*arguments)
        out, err = process.communicate(timeout=LONGEST)
        return process.returncode, out, err

    def go(self, *arguments: str) -> tuple[int, str, str]:
        return self.execute("--go", "--yes", self.hash[:8], "--log", str(self.log), *arguments)


@pytest.fixture
def bench_with(plan_file: Path, tmp_path: Path) -> Iterator[Callable[..., Bench]]:
    robots: list[Robot] = []

    def make(site: dict[str, Any] | None = None, **options: Any) -> Bench:
        robot = Robot(options)
        robots.append(robot)
        motion, state, io = robot.ports
        content = dc.asdict(find_site("loopback"))
        content["controller"].update(motion_port=motion, state_port=state, io_port=io)
        # Generous timeouts for a busy machine: milliseconds are not tested here.
        content["controller"].update(lead=0.4, late=0.3, hold_after=0.4, fault_after=0.9)
        content.update(site or {})
        path = tmp_path / "lab.site.yaml"
        path.write_text(yaml.safe_dump(content))
        return Bench(robot, path, plan_file, tmp_path)

    yield make
    for robot in robots:
        robot.kill()


def after(process: subprocess.Popen[str], begins: str) -> None:
    """Wait until the command has printed a line with this beginning."""
    assert process.stdout is not None
    for line in process.stdout:
        if line.startswith(begins):
            return
    pytest.fail(f"no line '{begins}'")


def test_a_dry_run_sends_nothing(bench_with: Callable[..., Bench]) -> None:
    bench = bench_with()
    code, out, err = bench.execute("--html", "page.html")
    assert (err, code) == ("", 0)
    assert "nothing was sent" in out and "VIRTUAL EQUIPMENT" in out
    assert "FAIL" not in out
    assert bench.hash in (bench.folder / "page.html").read_text()
    told = bench.robot.end()
    assert told["motion"] == 0 and told["outputs"] == {}


def test_a_plan_is_run_to_its_end(bench_with: Callable[..., Bench]) -> None:
    bench = bench_with()
    code, out, err = bench.go("--speed", "0.5")
    assert (err, code) == ("", 0)
    assert bench.hash in out and "smallest clearance" in out
    lag = re.search(r"lag +(\d+) ms from a command to its feedback", out)
    assert lag is not None and 140 <= int(lag[1]) <= 190  # 150 ms, plus the delay of this machine
    told = bench.robot.end()
    plan = FlatteningPlan.load(bench.plan)
    np.testing.assert_allclose(
        told["positions"], plan.segments[-1].trajectory.positions[-1], atol=1e-4
    )
    assert told["outputs"] == {"10010": 1, "10011": 1}  # open: the outputs are inverted
    records = bench.records()
    assert not records.cut
    assert records.header["plan_hash"] == bench.hash
    events = {event.kind: event for event in records.events}
    assert events["preflight"].data["verdict"]["passed"] is True
    assert events["result"].data["outcome"] == "done"
    # At half the speed the plan's own positions are sent as float32, only later; but for each
    # segment's last two steps.
    sent = records.commanded.positions
    planned = np.vstack([as_sent(segment.trajectory).positions for segment in plan.segments])
    own = {row.tobytes() for row in planned}
    assert sum(row.tobytes() not in own for row in sent) <= 2 * len(plan.segments)
    assert len(sent) > 0.9 * len(planned)
    runs = (bench.folder / "state" / "unwrinkle" / "finished_runs.jsonl").read_text()
    assert json.loads(runs)["plan"] == bench.hash


def test_without_the_right_hash_nothing_moves(bench_with: Callable[..., Bench]) -> None:
    bench = bench_with()
    for confirmation in ("ffffffff", "", bench.hash[:5], bench.hash[1:]):
        options = ExecutionOptions(bench.plan, str(bench.site), go=True, confirmation=confirmation)
        with pytest.raises(InputError, match="does not confirm this plan"):
            ExecutionSession(options)
    code, _, err = bench.execute("--go")
    assert code == 2
    assert "was not confirmed" in err and err.count("\n") == 1
    assert bench.robot.end()["motion"] == 0


def test_a_robot_elsewhere_is_not_moved(bench_with: Callable[..., Bench]) -> None:
    bench = bench_with(start={"7": 0.05})
    code, out, err = bench.go()
    assert code == 4
    assert "FAIL" in out
    assert "r2::joint_s is off by 50.00 mrad" in err and "r2::joint_s by -2.865 deg" in err
    assert bench.robot.end()["motion"] == 0
    assert bench.records().events[-2].data["passed"] is False


def test_a_moved_table_is_refused(bench_with: Callable[..., Bench], tmp_path: Path) -> None:
    from unwrinkle.models.io.loader_yaml import models_dir

    text = (models_dir() / "cell.dmd.yaml").read_text()
    (tmp_path / "cell.dmd.yaml").write_text(text.replace("[0, -1.2, 0.70]", "[0, -1.2, 0.72]"))
    scenario = f"Moved:\n  directives: [{tmp_path / 'cell.dmd.yaml'}]\n"
    (tmp_path / "moved.scenario.yaml").write_text(scenario)
    bench = bench_with({"scenario": "moved.scenario.yaml"})
    code, _, err = bench.go()
    assert code == 2
    assert "name the scenario that it was made in" in err
    assert bench.robot.end()["motion"] == 0


def test_an_emergency_stop_ends_it(bench_with: Callable[..., Bench]) -> None:
    bench = bench_with()
    options = ("--log", str(bench.log), "--speed", "0.5")
    process = bench.begin("--go", "--yes", bench.hash[:8], *options)
    after(process, "pull")
    bench.robot.say("e_stop")
    _, err = process.communicate(timeout=LONGEST)
    assert process.returncode == 4
    assert "emergency stop" in err
    assert not bench.robot.end()["moving"]
    assert bench.records().events[-1].kind == "disconnect"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_in_a_hold(bench_with: Callable[..., Bench], number: signal.Signals) -> None:
    bench = bench_with()
    process = bench.begin(
        "--go", "--yes", bench.hash[:8], "--log", str(bench.log), "--speed", "0.4"
    )
    after(process, "approach")
    process.send_signal(number)
    out, _ = process.communicate(timeout=LONGEST)
    assert process.returncode == 128 + number
    assert f"{number.name} received" in out
    assert not bench.robot.end()["moving"]
    records = bench.records()
    assert [event.kind for event in records.events][-2:] == ["result", "disconnect"]
    assert np.abs(records.measured.velocities[-1]).max() < 5e-3


def test_what_a_file_says_is_done(bench_with: Callable[..., Bench]) -> None:
    bench = bench_with()
    (bench.folder / "said").write_text("@1 hold\n@3 resume\n@3.3 speed 0.5\n@3.4 speed 7\n")
    code, out, err = bench.go("--speed", "0.3", "--commands", "said")
    assert (err, code) == ("", 0)
    assert "held by the operator" in out and "refused: the speed is 7" in out
    kinds = [event.kind for event in bench.records().events]
    assert {"hold", "held", "resume", "override"} <= set(kinds)


def test_two_at_once_are_refused(bench_with: Callable[..., Bench]) -> None:
    bench = bench_with()
    first = bench.begin("--go", "--yes", bench.hash[:8], "--log", str(bench.log), "--speed", "0.4")
    after(first, "approach")
    code, _, err = bench.execute()
    first.send_signal(signal.SIGTERM)
    first.communicate(timeout=LONGEST)
    assert code == 4
    assert "is in use: process" in err and str(first.pid) in err


def test_commissioning_wants_a_key_and_a_slow_first_run(bench_with: Callable[..., Bench]) -> None:
    bench = bench_with({"commissioning": True})
    code, _, err = bench.go("--speed", "0.5")
    assert code == 4
    assert "--speed 0.1 or less" in err and "0.25 m/s" in err
    bench.log.unlink()
    (bench.folder / "said").write_text("@1.5 stop\n")
    code, out, err = bench.go("--commands", "said")
    assert code == 4
    assert "COMMISSIONING" in out and "space bar" in out
    assert "stopped after no segment: stopped by the operator" in err
    assert bench.robot.end()["points"] == 0  # the key was not pressed


def test_a_missed_grasp_opens_and_retreats(bench_with: Callable[..., Bench]) -> None:
    bench = bench_with(misses=1)
    code, _, err = bench.go("--speed", "0.5")
    assert code == 4
    assert "missed after approach, retreat" in err
    assert "the left gripper closed on nothing" in err
    told = bench.robot.end()
    assert told["outputs"] == {"10010": 1, "10011": 1}
    start = FlatteningPlan.load(bench.plan).segments[0].trajectory.positions[0]
    np.testing.assert_allclose(told["positions"], start, atol=1e-3)


def test_shipped_cell_is_the_plans(plan_file: Path) -> None:
    FlatteningPlan.load(plan_file).check_made_for(load_cell())
    assert find_site("loopback").virtual
