"""`unwrinkle execute` in a process of its own, against a virtual controller in real time."""

import dataclasses as dc
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

import numpy as np
import yaml

from unwrinkle.hardware.motoros.messages import Command, MessageType, MotionControl
from unwrinkle.models.arrays import Array
from unwrinkle.models.site import Site, loopback_site
from unwrinkle.simulation.controllers.controller import VirtualController, VirtualControllerSettings
from unwrinkle.simulation.controllers.server import ControllerServer, ServerFault
from unwrinkle.simulation.devices.digital_grippers import VirtualDigitalGrippers
from unwrinkle.testing import cells

_STEP, _LAG = 0.002, 0.01
#: s that a process may take.
_LONGEST = 60.0


class LiveController:
    """A virtual controller with virtual grippers, on this machine's clock, in a thread."""

    def __init__(
        self, *faults: ServerFault, start: Array | None = None, holding: bool = True
    ) -> None:
        """Stand at `start` (13,), rad, and listen on ports that the system chooses."""
        limits = cells.cell().limits
        self.start = np.zeros(13) if start is None else np.array(start, dtype=float)
        self.controller = VirtualController(
            VirtualControllerSettings(keep=100000),
            self.start,
            (limits.lower, limits.upper, limits.velocity),
        )
        self.server = ControllerServer(self.controller, faults=faults)
        self.site = loopback_site()
        self._grippers = VirtualDigitalGrippers(self.site.grippers)
        self._holding = (holding, holding)
        self._measured = self.start.copy()
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._loop, name="virtual controller", daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        """The controller itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Stop and close."""
        self._end.set()
        self._thread.join(2.0)
        self.server.close()

    def _loop(self) -> None:
        last = time.monotonic()
        while not self._end.is_set():
            self.server.wait(_STEP)
            now = time.monotonic()
            share = 1.0 - np.exp(-(now - last) / _LAG)
            before = self._measured
            self._measured = before + share * (self.controller.axis_positions - before)
            speed = (self._measured - before) / max(now - last, 1e-4)
            last = now
            inputs = self._grippers.update(now, self.controller.outputs, self._holding)
            self.controller.inputs.update(inputs)
            self.server.poll(now, self._measured, speed)

    @property
    def closed_outputs(self) -> tuple[bool, ...]:
        """Whether the outputs ask the grippers to close, right and left."""
        site = self.site.grippers
        return tuple(
            bool(self.controller.outputs.get(address, int(inverted))) != inverted
            for address, inverted in zip(site.close_output, site.inverted, strict=True)
        )

    def motion_messages(self) -> int:
        """Messages that came over the motion connection."""
        kinds = (
            MessageType.MOTION_CTRL,
            MessageType.JOINT_TRAJ_PT_FULL,
            MessageType.JOINT_TRAJ_PT_FULL_EX,
        )
        return sum(message.type in kinds for _, message in list(self.controller.messages))

    def commands(self) -> list[int]:
        """Motion control commands that came, in order, without questions."""
        asked = [
            MotionControl.of(message).command
            for _, message in list(self.controller.messages)
            if message.type == MessageType.MOTION_CTRL
        ]
        return [command for command in asked if command != Command.CHECK_MOTION_READY]

    def until(self, holds: Callable[[], bool], most: float = 30.0) -> bool:
        """Wait until something holds, at most so long, s; whether it does."""
        end = time.monotonic() + most
        while not holds():
            if time.monotonic() > end:
                return False
            time.sleep(0.002)
        return True

    def at_rest(self) -> bool:
        """Whether no axis moves, nor will before another motion connection is made."""
        return self.controller.resting

    def disconnected(self) -> bool:
        """Whether nobody has the motion connection."""
        return not self.server.motion

    def site_file(self, folder: Path, **changes: Any) -> Path:
        """Write a site of this controller; `changes` are its keys, nested ones as dictionaries."""
        motion, state, io = self.server.ports
        site: dict[str, Any] = dc.asdict(self.site)
        site["controller"] |= {"motion_port": motion, "state_port": state, "io_port": io}
        for name, value in changes.items():
            site[name] = site[name] | value if isinstance(value, dict) else value
        Site(
            **{k: v for k, v in site.items() if not isinstance(v, dict)}
        )  # its keys are the site's
        path = folder / "here.site.yaml"
        path.write_text(yaml.safe_dump(site), encoding="utf-8")
        return path


class Execution:
    """A process that executes the shared plan."""

    def __init__(self, folder: Path, site: Path, *options: str) -> None:
        """Start it; its log is `run.jsonl` in the folder."""
        self.log = folder / "run.jsonl"
        plan = folder / "plan.npz"
        cells.plan().save(plan)
        command = [sys.executable, "-m", "unwrinkle", "execute", str(plan), "--site", str(site)]
        for name in ("state", "runtime"):
            (folder / name).mkdir(exist_ok=True)
        self.process = subprocess.Popen(
            [*command, "--log", str(self.log), *options],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd=folder,
            env={
                **os.environ,
                "XDG_STATE_HOME": str(folder / "state"),
                "XDG_RUNTIME_DIR": str(folder / "runtime"),
            },
        )
        self.out = self.error = ""

    @classmethod
    def going(cls, folder: Path, site: Path, *options: str) -> "Execution":
        """One that moves the robot, confirmed by the plan's hash; nobody types."""
        commands = folder / "commands.txt"
        commands.touch()
        confirmed = ("--go", "--yes", cells.plan().content_hash[:12], "--commands", str(commands))
        return cls(folder, site, *confirmed, *options)

    def reached(self, live: LiveController, points: int) -> bool:
        """Wait until the controller has so many points; whether the process still runs then."""
        live.until(lambda: live.controller.points >= points or self.process.poll() is not None)
        return self.process.poll() is None and live.controller.points >= points

    def end(self) -> int:
        """Wait for its end; the exit code.

        What it wrote is in `out`, its last error line in `error`.
        """
        try:
            self.out, error = self.process.communicate(timeout=_LONGEST)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.out, error = self.process.communicate()
            error += "\nit did not end"
        lines = [line for line in error.splitlines() if line.startswith("unwrinkle: ")]
        self.error = lines[-1].removeprefix("unwrinkle: ") if lines else error[-300:]
        return self.process.returncode
