"""Whole runs of `unwrinkle flatten` in processes of their own, kept so that an interrupted
benchmark resumes.
"""

import hashlib
import json
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.harness.digest import source_digest
from unwrinkle.models.errors import InputError
from unwrinkle.models.io.archive import load_archive
from unwrinkle.planning.plan import FlatteningPlan

_RECORD = "bench.json"
_ENDED = (0, 3)  # exit codes of a run that came to its own end


@dataclass(frozen=True)
class Run:
    """What a run left.

    Attributes:
        name: of its folder.
        options: of the command line.
        folder: where it is.
        wall: from the process' start to its end, s.
        exit_code: of the process.
        record: `run.json`.
        actions: every look's `action.json`, in order.
    """

    name: str
    options: tuple[str, ...]
    folder: Path
    wall: float
    exit_code: int
    record: dict[str, Any]
    actions: list[dict[str, Any]]

    @property
    def pulls(self) -> list[dict[str, Any]]:
        """The looks that an action followed (missed grasps included)."""
        return [action for action in self.actions if action["outcome"] in ("done", "missed")]

    @property
    def truth(self) -> dict[str, float]:
        """Of the cloth at the end."""
        last = self.actions[-1]
        return dict(last["truth_after"] or last["truth_before"] or {})

    @property
    def fingerprint(self) -> str:
        """SHA-256 over the plans' hashes and the bits of the last state of the cloth."""
        digest = hashlib.sha256()
        for look in sorted(self.folder.glob("[0-9]*")):
            if (look / "plan.npz").exists():
                digest.update(FlatteningPlan.load(look / "plan.npz").content_hash.encode())
        states = sorted([*self.folder.glob("*/before.npz"), *self.folder.glob("*/after.npz")])
        last = max(states, key=lambda path: (path.parent.name, path.name == "after.npz"))
        _, arrays = load_archive(last)
        for key in sorted(arrays):
            digest.update(np.ascontiguousarray(arrays[key]).tobytes())
        return digest.hexdigest()

    def unverified(self) -> int:
        """Motions that were carried out without a passing verdict for the very plan."""
        count = 0
        for action in self.pulls:
            look = self.folder / f"{action['index']:03d}"
            verdict = json.loads((look / "verdict.json").read_text(encoding="utf-8"))
            plan = FlatteningPlan.load(look / "plan.npz")
            count += not (verdict["passed"] and verdict["plan_hash"] == plan.content_hash)
        return count


def flatten(root: Path, name: str, options: tuple[str, ...]) -> Run:
    """Run `unwrinkle flatten` into a folder, or take what a run with this very code left there.

    Args:
        root: folder of all runs.
        name: of this run's folder.
        options: of the command line, without `--out`.

    Raises:
        InputError: the run broke off.
    """
    folder = root / source_digest()[:12] / name
    if not (folder / _RECORD).exists():
        _remove_part_of(folder)
        folder.parent.mkdir(parents=True, exist_ok=True)
        command = [sys.executable, "-m", "unwrinkle", "flatten", *options, "--no-live"]
        begin = time.perf_counter()
        done = subprocess.run(
            [*command, "--out", str(folder)], capture_output=True, text=True, check=False
        )
        wall = time.perf_counter() - begin
        if done.returncode not in _ENDED:
            raise InputError(
                f"{' '.join(command[1:])} ended with {done.returncode}: {done.stderr.strip()[-600:]}"
            )
        record = {"wall": wall, "exit_code": done.returncode, "options": list(options)}
        (folder / _RECORD).write_text(json.dumps(record), encoding="utf-8")
    record = json.loads((folder / _RECORD).read_text(encoding="utf-8"))
    actions = [
        json.loads((look / "action.json").read_text(encoding="utf-8"))
        for look in sorted(folder.glob("[0-9]*"))
        if (look / "action.json").exists()
    ]
    run = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    return Run(name, options, folder, record["wall"], record["exit_code"], run, actions)


def _remove_part_of(folder: Path) -> None:
    """Put a run that was broken off out of the way."""
    if folder.exists():
        folder.rename(folder.with_name(f"{folder.name}-broken-off-{time.time_ns()}"))
