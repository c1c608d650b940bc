"""Preflight: a correct setup passes; each single fault is refused and named."""

import dataclasses as dc
import datetime
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml

from unwrinkle.execution.finished_runs import FinishedRuns
from unwrinkle.execution.posture import check_posture, escape
from unwrinkle.execution.preflight import (
    COMMISSIONING_BANNER,
    VIRTUAL_BANNER,
    Preflight,
    preflight,
    recheck,
)
from unwrinkle.hardware.controller_state import (
    FAULT,
    READY,
    RUNNING,
    DriverStatus,
    JointFeedback,
    RobotStatus,
)
from unwrinkle.models.errors import InputError
from unwrinkle.models.io.loader_yaml import models_dir
from unwrinkle.models.robot import Cell, load_cell
from unwrinkle.models.site import Site
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.search.planner import FlatteningPlanner
from unwrinkle.site.preflight_checks import check_margins
from unwrinkle.site.sites import find_site, shipped_sites, site_cell

PLAY = RobotStatus(1, 0, 0, 0, 0, 2, 1)
TODAY = datetime.date(2026, 6, 1)


@dc.dataclass(frozen=True)
class Grippers:
    reason: str = ""
    closed: tuple[bool, bool] = (False, False)


@pytest.fixture(scope="module")
def real_plan(cell: Cell) -> FlatteningPlan:
    from unwrinkle.testing.targets import flattening_task

    result = FlatteningPlanner(cell).plan(flattening_task((0.0, -1.10), 0.2))
    assert result.plan is not None
    return result.plan


@pytest.fixture
def look(cell: Cell, real_plan: FlatteningPlan, tmp_path: Path) -> Callable[..., Preflight]:
    """Return a function that runs the preflight with one change."""

    def run(axis: dict[int, float] | None = None, **changes: object) -> Preflight:
        q = np.zeros(13)
        for index, value in (axis or {}).items():
            q[index] = value
        feedback = JointFeedback(q, np.zeros(13), 10.0)
        status = DriverStatus(READY, robot=PLAY)
        found: dict[str, object] = {
            "plan": real_plan,
            "cell": cell,
            "site": find_site("loopback"),
            "feedback": feedback,
            "status": status,
            "now": 10.02,
            "grippers": Grippers(),
            "log": tmp_path / "log.jsonl",
            "finished": FinishedRuns(tmp_path / "finished.jsonl"),
            "today": TODAY,
            **changes,
        }
        return preflight(**found)  # type: ignore[arg-type]

    return run


def failed(found: Preflight) -> list[str]:
    return [check.name for check in found.failures]


def test_everything_right_passes(look: Callable[..., Preflight]) -> None:
    found = look()
    assert found.passed, found.summary()
    assert found.verdict is not None and found.verdict.passed
    assert found.speed == found.most_speed == 1.0
    assert found.banner == VIRTUAL_BANNER


@pytest.mark.parametrize(
    ("status", "name", "text"),
    [
        (None, "controller", "not connected"),
        (DriverStatus(FAULT, robot=PLAY, reason="an e-stop"), "controller", "an e-stop"),
        (DriverStatus(RUNNING, robot=PLAY), "controller", "running, not ready"),
        (DriverStatus(READY), "robot", "status has not arrived"),
        (DriverStatus(READY, robot=dc.replace(PLAY, e_stopped=1)), "robot", "emergency stop"),
        (DriverStatus(READY, robot=dc.replace(PLAY, mode=1)), "robot", "teach mode"),
        (DriverStatus(READY, robot=dc.replace(PLAY, in_error=1)), "robot", "alarm"),
        (DriverStatus(READY, robot=dc.replace(PLAY, in_motion=1)), "robot", "is moving"),
    ],
)
def test_the_robots_state(
    look: Callable[..., Preflight], status: DriverStatus | None, name: str, text: str
) -> None:
    found = look(status=status)
    assert name in failed(found)
    assert text in found.check(name).text


def test_old_or_broken_feedback(look: Callable[..., Preflight]) -> None:
    found = look(now=10.11)
    assert failed(found) == ["feedback"]
    assert "0.11 s old, at most 0.10 s" in found.check("feedback").text
    assert failed(look(feedback=None)) == ["feedback"]
    assert "not thirteen finite" in look(axis={4: np.nan}).check("feedback").text


def test_a_start_in_collision_names_the_pair_and_a_way_out(look: Callable[..., Preflight]) -> None:
    found = look(axis={2: 1.9, 3: 0.245})
    assert failed(found) == ["posture", "start"]
    text = found.check("posture").text
    assert "r1::link_5 and t2::desk" in text
    assert "jog it home" in text and "pendant" in text


def test_a_small_way_out_is_named_and_is_one(cell: Cell) -> None:
    # Lower the right arm until it is just too near to the table.
    low, high = np.zeros(13), np.zeros(13)
    high[2] = 1.9
    for _ in range(9):
        middle = 0.5 * (low + high)
        bad = check_posture(cell, middle, (False, False)).problems
        low, high = (low, middle) if bad else (middle, high)
    text = escape(cell, high, (False, False))
    name, _, degrees = text.split("e.g. ")[1].split(" deg")[0].rpartition(" by ")
    high[cell.robot.axes.index(name)] += np.radians(float(degrees))
    assert not check_posture(cell, high, (False, False)).problems


def test_a_start_beyond_a_limit_says_by_how_much(look: Callable[..., Preflight]) -> None:
    text = look(axis={0: 2.06}).check("posture").text
    assert "above its limit 115.0 deg" in text
    assert "by -3.03 deg" in text


def test_a_start_away_from_the_plans(look: Callable[..., Preflight]) -> None:
    assert look(axis={7: 0.00029}).passed
    found = look(axis={7: 0.0005})  # half a milliradian on S: 41 pulses, the controller takes 30
    assert failed(found) == ["start"]
    assert "r2::joint_s is off by 0.50 mrad, at most 0.30 mrad" in found.check("start").text
    assert "r2::joint_s by -0.029 deg" in found.check("start").text


def test_speeds_that_the_controller_refuses_in_motion_are_refused_before(
    look: Callable[..., Preflight],
) -> None:
    site = find_site("loopback")
    governed = dc.replace(site, controller=dc.replace(site.controller, speed_cap=0.4))
    found = look(site=governed, speed=1.0)
    assert failed(found) == ["governor"]
    told = re.search(r"refuses more than 40%.* give --speed (0\.\d+)", found.check("governor").text)
    assert told is not None
    slower = look(site=governed, speed=float(told[1]))
    assert slower.passed and slower.most_speed == float(told[1])
    assert look(site=governed, speed=0.2).passed


def test_a_plan_that_moves_what_the_firmware_does_not_move_is_refused(
    look: Callable[..., Preflight],
) -> None:
    site = find_site("loopback")
    two = dc.replace(site, controller=dc.replace(site.controller, groups_moved=["r1", "ext_axis"]))
    found = look(site=two)
    assert failed(found) == ["groups"]
    text = found.check("groups").text
    assert "r2 is to move by " in text and "groups_moved: r1, ext_axis" in text


def test_a_table_that_was_moved_is_refused(
    look: Callable[..., Preflight], cell: Cell, tmp_path: Path
) -> None:
    text = (models_dir() / "cell.dmd.yaml").read_text()
    assert "[0, -1.2, 0.70]" in text
    (tmp_path / "cell.dmd.yaml").write_text(text.replace("[0, -1.2, 0.70]", "[0, -1.2, 0.72]"))
    directives = [str(tmp_path / "cell.dmd.yaml")]
    found = look(cell=load_cell(dc.replace(cell.scenario, directives=directives)))
    assert failed(found) == ["plan"]
    assert (
        "plan again where the robot, a table or a clearance has changed" in found.check("plan").text
    )
    assert found.verdict is None


def test_a_changed_plan_is_refused(
    look: Callable[..., Preflight], real_plan: FlatteningPlan
) -> None:
    found = look(plan=dc.replace(real_plan, events=real_plan.events[:1]))
    assert failed(found) == ["verification"]
    assert "gripper events" in found.check("verification").text


@pytest.mark.parametrize("speed", [0.0, 1.2, float("nan")])
def test_absurd_speeds(look: Callable[..., Preflight], speed: float) -> None:
    assert "speed" in failed(look(speed=speed))


def test_commissioning_slows_the_first_run_and_the_tips(
    look: Callable[..., Preflight], real_plan: FlatteningPlan, tmp_path: Path
) -> None:
    site = dc.replace(find_site("loopback"), commissioning=True)
    found = look(site=site)
    assert found.passed, found.summary()
    assert found.speed == 0.1 and found.most_speed <= 0.1
    assert COMMISSIONING_BANNER in found.banner
    fast = look(site=site, speed=0.5)
    assert failed(fast) == ["speed", "tips"]
    assert "--speed 0.1 or less" in fast.check("speed").text
    FinishedRuns(tmp_path / "finished.jsonl").add("loopback", real_plan.content_hash, 0.1)
    assert failed(look(site=site, speed=0.5)) == ["tips"]
    assert look(site=site, speed=look(site=site, speed=0.1).most_speed).passed


def test_commissioning_doubles_the_clearances(
    look: Callable[..., Preflight], real_plan: FlatteningPlan
) -> None:
    site = dc.replace(find_site("loopback"), commissioning=True)
    assert "doubled" in look(site=site).check("clearances").text
    near = look().verdict
    assert near is not None
    pairs = [dc.replace(pair, distance=0.025) for pair in near.clearances if pair.kind == "arm-arm"]
    pair = pairs[0] if pairs else dc.replace(near.clearances[0], kind="arm-arm", distance=0.05)
    with pytest.raises(InputError, match="60 mm are required"):
        check_margins(dc.replace(near, clearances=(pair,)), load_cell(), site)


@pytest.fixture
def calibration(tmp_path: Path) -> Callable[..., Path]:
    """A measured calibration with changes."""

    def make(**changes: object) -> Path:
        content = yaml.safe_load((models_dir() / "heads" / "clopema.yaml").read_text())
        content.update({"date": "2026-05-01", "valid_days": 180, **changes})
        for eye in ("left", "right"):
            content[eye].update({"views": 20, "residual": 0.2})
        path = tmp_path / "head.yaml"
        path.write_text(yaml.safe_dump(content))
        return path

    return make


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({}, ""),
        ({"date": "2025-05-01"}, "396 days old, at most 180"),
        ({"date": "2026-07-01"}, "in the future"),
        ({"row_residual": 0.9}, "residual is 0.90 pixels, at most 0.5"),
        ({"valid_days": 10}, "31 days old, at most 10"),
    ],
)
def test_the_calibration(
    look: Callable[..., Preflight],
    calibration: Callable[..., Path],
    changes: dict[str, object],
    text: str,
) -> None:
    real = dc.replace(find_site("loopback"), virtual=False, calibration=str(calibration(**changes)))
    found = look(site=real)
    assert failed(found) == (["calibration"] if text else [])
    assert text in found.check("calibration").text
    virtual = look(site=dc.replace(real, virtual=True))
    assert virtual.passed and virtual.banner == VIRTUAL_BANNER


def test_a_real_site_needs_a_measured_calibration(look: Callable[..., Preflight]) -> None:
    site = dc.replace(find_site("loopback"), virtual=False)
    assert "names no calibration" in look(site=site).check("calibration").text
    nominal = str(models_dir() / "heads" / "clopema.yaml")
    found = look(site=dc.replace(site, calibration=nominal))
    assert failed(found) == ["calibration"]
    assert "nominal" in found.check("calibration").text


def test_grippers_and_log(look: Callable[..., Preflight], tmp_path: Path) -> None:
    assert "grippers" in failed(look(grippers=None))
    found = look(grippers=Grippers("the right gripper does not answer"))
    assert "right gripper" in found.check("grippers").text
    assert "left gripper is closed" in look(grippers=Grippers("", (False, True))).summary()
    (tmp_path / "file").write_text("")
    assert failed(look(log=tmp_path / "file" / "log.jsonl")) == ["log"]


def test_a_last_look_sees_what_changed(
    look: Callable[..., Preflight], cell: Cell, real_plan: FlatteningPlan
) -> None:
    found, site = look(), find_site("loopback")
    good = DriverStatus(READY, robot=PLAY)
    here = JointFeedback(np.zeros(13), np.zeros(13), 20.0)
    away = JointFeedback(np.full(13, 0.01), np.zeros(13), 20.0)
    assert recheck(found, real_plan, cell, site, here, good, 20.01) == ""
    assert "not at the plan's start" in recheck(found, real_plan, cell, site, away, good, 20.01)
    assert "old" in recheck(found, real_plan, cell, site, here, good, 20.5)
    bad = look(status=None)
    assert "not connected" in recheck(bad, real_plan, cell, site, here, good, 20.01)


def test_finished_runs_survive_damage(tmp_path: Path) -> None:
    runs = FinishedRuns(tmp_path / "deep" / "runs.jsonl")
    assert runs.count("a", "ff") == 0
    runs.add("a", "ff", 0.1)
    runs.path.write_text(runs.path.read_text() + "{cut\n[]\n")
    runs.add("a", "ff", 0.1)
    assert (runs.count("a", "ff"), runs.count("b", "ff"), runs.count("a", "00")) == (2, 0, 0)


def test_shipped_sites_are_whole() -> None:
    assert {"loopback", "example"} <= set(shipped_sites())
    for name in shipped_sites():
        site = find_site(name)
        assert isinstance(site, Site)
        assert site_cell(site).limits.lower.shape == (13,)


def test_paths_of_a_site_are_beside_its_file(tmp_path: Path) -> None:
    (tmp_path / "lab.site.yaml").write_text("name: lab\ncalibration: head.yaml\n")
    assert find_site(tmp_path / "lab.site.yaml").calibration == str(tmp_path / "head.yaml")
    with pytest.raises(InputError, match="no site 'nowhere'"):
        find_site("nowhere")
