"""Run a benchmark's trials in subprocesses, and keep each result, so that an interrupted run resumes."""

import hashlib
import importlib
import json
import logging
import multiprocessing
import os
import queue
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, TypeVar, cast

from benchmarks.harness.digest import code_digest
from benchmarks.harness.report import Progress
from benchmarks.harness.results import from_json, to_json
from unwrinkle.models.errors import InputError
from unwrinkle.models.io.files import write_json

#: Where results are kept, below the folder that the command is given in.
ROOT = Path("out") / "trials"
#: Trials of one process before another takes its place: VTK leaks memory.
_TRIALS_PER_PROCESS = 3
_FILE = "trial.json"

Work = Callable[[dict[str, Any], Path], Any]


@dataclass(frozen=True)
class Trial:
    """One trial of a benchmark.

    Attributes:
        name: in words that a file's name may have, for people.
        work: `module:function`; the function takes `settings` and the trial's folder, and returns a
            dataclass.
        settings: JSON values; all that the result depends on besides code and versions.
    """

    name: str
    work: str
    settings: dict[str, Any]

    def folder(self, benchmark: str) -> Path:
        """Return where its result belongs: another place for other settings, and for other code."""
        text = json.dumps([self.work, self.settings], sort_keys=True)
        key = hashlib.sha256(text.encode()).hexdigest()[:8]
        digest = code_digest(self.work.partition(":")[0])
        return ROOT / digest[:12] / benchmark / f"{self.name}-{key}"


@dataclass(frozen=True, kw_only=True)
class KeptTrial:
    """A trial that was worked out; a benchmark's own class adds the fields of what its work returns.

    Attributes:
        name, settings: of the trial.
        folder: where it is kept.
        wall: time that it took, s.
        code: digest of code and versions.
    """

    name: str
    settings: dict[str, Any]
    folder: str
    wall: float
    code: str


@dataclass(frozen=True)
class FailedTrial:
    """A trial that failed as its benchmark expects of some.

    Attributes:
        name, settings: of the trial.
        reason: class and message of the error.
    """

    name: str
    settings: dict[str, Any]
    reason: str


_Kept = TypeVar("_Kept", bound=KeptTrial)
_Task = tuple[Trial, Path]


def run_trials(
    benchmark: str,
    wanted: Sequence[Trial],
    kind: type[_Kept],
    progress: Progress,
    *,
    workers: int | None = None,
) -> list[_Kept]:
    """Work out what is not there yet, and return all trials in order.

    Args:
        benchmark: its name.
        wanted: the trials.
        kind: of a trial that was worked out.
        progress: told of every finished trial.
        workers: processes at once; by the number of cores if left out.

    Raises:
        InputError: trials failed; the others are kept, and the next run tries those again.
    """
    found = try_trials(benchmark, wanted, kind, progress, workers=workers)
    return [each for each in found if not isinstance(each, FailedTrial)]


def try_trials(
    benchmark: str,
    wanted: Sequence[Trial],
    kind: type[_Kept],
    progress: Progress,
    *,
    tolerated: str = "",
    workers: int | None = None,
) -> list[_Kept | FailedTrial]:
    """Work out trials of which some may fail; arguments and errors as of `run_trials`.

    Args:
        benchmark, wanted, kind, progress, workers: as of `run_trials`.
        tolerated: name of the class of errors that the benchmark expects of some trials.
    """
    folders = [trial.folder(benchmark) for trial in wanted]
    missing = [
        (trial, folder)
        for trial, folder in zip(wanted, folders, strict=True)
        if not (folder / _FILE).exists()
    ]
    done = len(wanted) - len(missing)
    progress(done, len(wanted), benchmark)
    failed: list[str] = []
    expected: dict[str, str] = {}
    for trial, error in _worked_out(missing, workers or len(os.sched_getaffinity(0))):
        done += 1
        progress(done, len(wanted), trial.name)
        if tolerated and error.startswith(f"{tolerated}: "):
            expected[trial.name] = error
        elif error:
            failed.append(f"{trial.name}: {error}")
    if failed:
        raise InputError(
            f"{benchmark}: {len(failed)} of {len(wanted)} trials failed, the first {failed[0]}; "
            "the others are kept, the same command resumes with these"
        )
    return [
        FailedTrial(trial.name, trial.settings, expected[trial.name])
        if trial.name in expected
        else _kept(kind, folder)
        for trial, folder in zip(wanted, folders, strict=True)
    ]


def _kept(kind: type[_Kept], folder: Path) -> _Kept:
    values = json.loads((folder / _FILE).read_text(encoding="utf-8"))
    return from_json(kind, {"folder": str(folder), **values}, str(folder))


def trials_wall(trials: Iterable[KeptTrial]) -> float:
    """Sum up the times of trials, those kept from before included, s."""
    return float(sum(trial.wall for trial in trials))


def _worked_out(missing: list[_Task], workers: int) -> Iterator[tuple[Trial, str]]:
    """Yield each trial with its error, or nothing, as it ends.

    Not `ProcessPoolExecutor`: Python 3.11's may hang once it has to replace its processes.
    """
    todo, ended = queue.SimpleQueue[_Task](), queue.SimpleQueue[tuple[Trial, str]]()
    for task in missing:
        todo.put(task)
    left = threading.Event()
    threads = [
        threading.Thread(target=_serve, args=(todo, ended, left), daemon=True)
        for _ in range(min(workers, len(missing)))
    ]
    for thread in threads:
        thread.start()
    try:
        for _ in missing:
            yield ended.get()
    finally:
        left.set()


def _serve(
    todo: queue.SimpleQueue[_Task],
    ended: queue.SimpleQueue[tuple[Trial, str]],
    left: threading.Event,
) -> None:
    """Have trials worked out by one process after another, until none is left or nobody waits for
    them.
    """
    context = multiprocessing.get_context("spawn")
    while not left.is_set() and not todo.empty():
        ours, theirs = context.Pipe()
        process = context.Process(target=_work, args=(theirs,), daemon=True)
        process.start()
        theirs.close()
        for _ in range(_TRIALS_PER_PROCESS):
            try:
                trial, folder = todo.get_nowait()
            except queue.Empty:
                break
            error = _ask(ours, trial, folder)
            ended.put((trial, error))
            if error:
                break
        ours.close()
        process.join()


def _ask(pipe: Connection, trial: Trial, folder: Path) -> str:
    """Have one trial worked out at the other end; what went wrong."""
    try:
        pipe.send((trial, folder))
        return str(pipe.recv())
    except (EOFError, OSError):
        return "its process died; is there too little memory?"


def _work(pipe: Connection) -> None:
    """Work out the trials that come, until no more do."""
    while True:
        try:
            trial, folder = pipe.recv()
        except EOFError:
            return
        try:
            _work_out(trial, folder)
        except Exception as error:  # noqa: BLE001 - whatever it is, the other trials go on
            pipe.send(f"{type(error).__name__}: {error}")
        else:
            pipe.send("")


def _work_out(trial: Trial, folder: Path) -> None:
    """Work out one trial, and keep it."""
    module, _, function = trial.work.partition(":")
    work = cast("Work", getattr(importlib.import_module(module), function))
    logging.getLogger("drake").setLevel(logging.WARNING)  # Drake's import sets it to INFO
    folder.mkdir(parents=True, exist_ok=True)
    begin = time.perf_counter()
    result = to_json(work(trial.settings, folder))
    head = {
        "name": trial.name,
        "settings": trial.settings,
        "wall": time.perf_counter() - begin,
        "code": code_digest(module),
    }
    write_json(folder / _FILE, head | result)
