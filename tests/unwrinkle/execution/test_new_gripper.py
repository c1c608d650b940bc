"""A gripper that this package does not know: one class in this file, one line in a site."""

import contextlib
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Self

import numpy as np
import pytest
import yaml

from unwrinkle.execution.robot import Robot
from unwrinkle.hardware import equipment
from unwrinkle.hardware.controller.base import DigitalIo
from unwrinkle.hardware.controller_state import (
    READY,
    RUNNING,
    DriverStatus,
    JointFeedback,
    RobotStatus,
)
from unwrinkle.hardware.equipment import connected
from unwrinkle.hardware.grippers.base import GripperPair, Grippers
from unwrinkle.hardware.grippers.factory import GRIPPERS, GripperKind, make_grippers
from unwrinkle.hardware.run_log.writer import RunLog
from unwrinkle.models.errors import InputError
from unwrinkle.models.robot import Cell
from unwrinkle.models.site import GripperSite
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.planning.search.planner import FlatteningPlanner
from unwrinkle.planning.trajectory import Trajectory
from unwrinkle.site.sites import find_site

#: Strokes of the grippers opened last: side and whether it closes.
SENT: list[tuple[int, bool]] = []


class ToyGrippers(GripperPair):
    """Grippers that obey at once, and hold what they close on."""

    def __init__(self, site: GripperSite) -> None:
        super().__init__(site)
        self.port = site.options["port"]
        self._are = [False, False]
        SENT.clear()

    def close(self) -> None:
        pass

    def _listen(self, now: float) -> None:
        pass

    def _send(self, index: int, closed: bool) -> None:
        SENT.append((index, closed))
        self._are[index] = closed

    def _lacks(self, index: int, closed: bool) -> str:
        return "" if self._are[index] == closed else "it does not move"

    def _closed(self, index: int) -> bool:
        return self._are[index]

    def _holding(self, index: int) -> bool | None:
        return self._are[index]


def open_toy(site: GripperSite, io: DigitalIo | None, stroke: float | None) -> Grippers:
    return ToyGrippers(site)


class QuickDriver:
    """Driver whose robot is at a trajectory's end a few reports after its start."""

    def __init__(self, *arguments: object, **options: object) -> None:
        self.inputs: dict[int, int | None] = {}
        self.outputs_written: dict[int, int | None] = {}
        self.io_problem = ""
        self._way: list[np.ndarray] = []
        self._at = np.zeros(13)
        self._number = self._completed = self._count = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        pass

    @property
    def feedback(self) -> JointFeedback:
        self._count += 1
        return JointFeedback(self._at, np.zeros(13), time.monotonic(), None, self._count)

    @property
    def status(self) -> DriverStatus:
        if self._way:
            self._at = self._way.pop(0)
            if not self._way:
                self._completed = self._number
        return DriverStatus(
            state=RUNNING if self._way else READY,
            command=self._number,
            completed=self._completed,
            robot=RobotStatus(1, 0, 0, 0, 0, 2, 1),
            feedback_age=0.0,
        )

    def run(self, number: int, trajectory: Trajectory, name: str = "") -> None:
        self._number = number
        self._way = list(
            trajectory.positions[np.linspace(0, -1 + len(trajectory.times), 4, dtype=int)]
        )

    def hold(self, number: int) -> None:
        self._number = self._completed = number
        self._way = []

    resume = hold

    def stop(self, reason: str) -> None:
        self._way = []

    def reset(self) -> None:
        pass

    def fail(self, text: str) -> None:
        raise AssertionError(text)

    def set_override(self, value: float) -> None:
        pass

    def write_output(self, address: int, value: int) -> None:
        raise AssertionError("the toy is not on the controller")

    def read_input(self, address: int) -> None:
        raise AssertionError("the toy is not on the controller")


def _site_file(folder: Path, kind: str) -> Path:
    file = folder / "toy.site.yaml"
    grippers = {"kind": kind, "options": {"port": "toy-1"}, "stroke_time": 0.02, "timeout": 1.0}
    site: dict[str, object] = {"name": "toy", "virtual": True, "speed": 1.0, "commissioning": False}
    site["controller"] = {"speed_cap": 1.0}
    file.write_text(yaml.safe_dump({**site, "grippers": grippers}))
    return file


@contextlib.contextmanager
def _robot(file: Path, cell: Cell, log: Path) -> Iterator[Robot]:
    site = find_site(file)
    with (
        RunLog.create(log, {}) as run_log,
        connected(site, cell, command="a test", log=run_log) as devices,
    ):
        yield Robot(site, cell, devices, run_log)


def test_a_registered_gripper_carries_out_a_plan(
    cell: Cell, plan: FlatteningPlan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = FlatteningPlanner(cell).plan(plan.target).plan
    assert made is not None
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.setattr(equipment, "DriverProcess", QuickDriver)
    monkeypatch.setitem(GRIPPERS, "toy", GripperKind(open_toy))
    with _robot(_site_file(tmp_path, "toy"), cell, tmp_path / "log.jsonl") as robot:
        grippers: Any = robot.equipment.grippers
        assert isinstance(grippers, ToyGrippers) and grippers.port == "toy-1"
        result = robot.execute(made)
        assert result.finished == ("approach", "pull", "release")
    closing = SENT.index((0, True))
    assert all(not closed for _, closed in SENT[:closing]), "plans start with open grippers"
    assert SENT[closing : closing + 2] == [(0, True), (1, True)]
    assert SENT[-2:] == [(0, False), (1, False)]


def test_a_driver_elsewhere_is_named_by_its_module(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "my_lab_grippers", sys.modules[__name__])
    site = find_site(_site_file(tmp_path, "my_lab_grippers:open_toy"))
    assert isinstance(make_grippers(site.grippers), ToyGrippers)


@pytest.mark.parametrize("kind", ["toy", "no_such_module:open", "unwrinkle.hardware:no_such_name"])
def test_a_kind_without_a_driver_is_refused_when_the_site_is_read(
    kind: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError):
        find_site(_site_file(tmp_path, kind))
