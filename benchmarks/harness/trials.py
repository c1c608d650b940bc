"""A board's rows, worked out in processes of their own and kept one by one, so that an interrupted
board goes on.
"""

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
from typing import Any, cast

from benchmarks.harness.digest import code_digest
from benchmarks.harness.report import Progress
from unwrinkle.models.errors import InputError
from unwrinkle.models.io.files import write_json

#: Where rows are kept, below the folder that the command is given in.
ROOT = Path("out") / "boards"
#: Rows that one process works out before another takes its place: renderers give not all of their
#: memory back.
_ROWS_PER_PROCESS = 3
_FILE = "row.json"

Work = Callable[[dict[str, Any], Path], dict[str, Any]]


@dataclass(frozen=True)
class Trial:
    """One row of a board.

    Attributes:
        name: in words that a file's name may have, for people.
        work: `module:function`, the function takes `settings` and the row's folder and returns JSON
            values.
        settings: JSON values; all that the result depends on besides the code.
    """

    name: str
    work: str
    settings: dict[str, Any]

    def folder(self, board: str) -> Path:
        """Where its result belongs: another place for other settings, and for other code."""
        text = json.dumps([self.work, self.settings], sort_keys=True)
        key = hashlib.sha256(text.encode()).hexdigest()[:8]
        digest = code_digest(self.work.partition(":")[0])
        return ROOT / digest[:12] / board / f"{self.name}-{key}"


_Task = tuple[Trial, Path]


def run_trials(
    board: str,
    wanted: Sequence[Trial],
    progress: Progress,
    *,
    workers: int | None = None,
    tolerated: str = "",
) -> list[dict[str, Any]]:
    """Work out what is not there yet, and return all rows in order.

    Args:
        board: its name.
        wanted: the rows.
        progress: told of every finished row.
        workers: processes at once; by the number of cores if left out.
        tolerated: class of errors that a board expects of some rows; those come back with `failed`,
            its message.

    Returns:
        For each row its name, settings, folder, wall (s) and code (digest), and what its function
        returned.

    Raises:
        InputError: rows failed; the others are kept, and the next run tries those again.
    """
    folders = [row.folder(board) for row in wanted]
    missing = [
        (row, folder)
        for row, folder in zip(wanted, folders, strict=True)
        if not (folder / _FILE).exists()
    ]
    done = len(wanted) - len(missing)
    progress(done, len(wanted), board)
    failed: list[str] = []
    expected: dict[str, str] = {}
    for row, error in _worked_out(missing, workers or len(os.sched_getaffinity(0))):
        done += 1
        progress(done, len(wanted), row.name)
        if tolerated and error.startswith(f"{tolerated}: "):
            expected[row.name] = error
        elif error:
            failed.append(f"{row.name}: {error}")
    if failed:
        raise InputError(
            f"{board}: {len(failed)} of {len(wanted)} rows failed, the first {failed[0]}; the others are "
            "kept, the same command goes on with these"
        )
    return [
        {"name": row.name, "settings": row.settings, "failed": expected[row.name]}
        if row.name in expected
        else {"folder": str(folder), **json.loads((folder / _FILE).read_text(encoding="utf-8"))}
        for row, folder in zip(wanted, folders, strict=True)
    ]


def trials_wall(rows: Iterable[dict[str, Any]]) -> float:
    """Seconds that rows took, one after the other, for a report's `results["trials_wall"]`.

    Those kept from before too.
    """
    return float(sum(row.get("wall", 0.0) for row in rows))


def _worked_out(missing: list[_Task], workers: int) -> Iterator[tuple[Trial, str]]:
    """Yield each row with its error, or nothing, as it ends.

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
    """Have rows worked out by one process after another, until none is left or nobody waits for
    them.
    """
    context = multiprocessing.get_context("spawn")
    while not left.is_set() and not todo.empty():
        ours, theirs = context.Pipe()
        process = context.Process(target=_work, args=(theirs,), daemon=True)
        process.start()
        theirs.close()
        for _ in range(_ROWS_PER_PROCESS):
            try:
                row, folder = todo.get_nowait()
            except queue.Empty:
                break
            error = _ask(ours, row, folder)
            ended.put((row, error))
            if error:
                break
        ours.close()
        process.join()


def _ask(pipe: Connection, row: Trial, folder: Path) -> str:
    """Have one row worked out at the other end; what went wrong."""
    try:
        pipe.send((row, folder))
        return str(pipe.recv())
    except (EOFError, OSError):
        return "its process died; is there too little memory?"


def _work(pipe: Connection) -> None:
    """Work out the rows that come, until no more do."""
    while True:
        try:
            row, folder = pipe.recv()
        except EOFError:
            return
        try:
            _work_out(row, folder)
        except Exception as error:  # noqa: BLE001 - whatever it is, the other rows go on
            pipe.send(f"{type(error).__name__}: {error}")
        else:
            pipe.send("")


def _work_out(row: Trial, folder: Path) -> None:
    """Work out one row, and keep it."""
    module, _, function = row.work.partition(":")
    work = cast("Work", getattr(importlib.import_module(module), function))
    logging.getLogger("drake").setLevel(logging.WARNING)  # Drake's import sets it to INFO
    folder.mkdir(parents=True, exist_ok=True)
    begin = time.perf_counter()
    result = work(row.settings, folder)
    head = {
        "name": row.name,
        "settings": row.settings,
        "wall": time.perf_counter() - begin,
        "code": code_digest(module),
    }
    write_json(folder / _FILE, head | result)
