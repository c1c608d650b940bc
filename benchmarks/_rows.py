"""A board's rows, worked out in processes of their own and kept one by one, so that an interrupted board goes on."""

import hashlib
import importlib
import json
import multiprocessing
import os
import time
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from unwrinkle.benchmarks._code_digest import code_digest
from unwrinkle.benchmarks.report import Progress
from unwrinkle.models.errors import InputError
from unwrinkle.models.files import write_json

#: Where rows are kept, below the folder that the command is given in.
ROOT = Path("out") / "boards"
#: Rows that one process works out before another takes its place: renderers give not all of their memory back.
_ROWS_PER_PROCESS = 2
_FILE = "row.json"

Work = Callable[[dict[str, Any], Path], dict[str, Any]]


@dataclass(frozen=True)
class Row:
    """One row of a board.

    Attributes:
        name: in words that a file's name may have, for people.
        work: `module:function`, the function takes `settings` and the row's folder and returns JSON values.
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


def run_rows(
    board: str, wanted: Sequence[Row], progress: Progress, *, workers: int | None = None
) -> list[dict[str, Any]]:
    """Work out what is not there yet, and return all rows in order.

    Args:
        board: its name.
        wanted: the rows.
        progress: told of every finished row.
        workers: processes at once; by the number of cores if left out.

    Returns:
        For each row its name, settings, folder, wall (s) and code (digest), and what its function returned.

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
    if missing:
        workers = min(len(missing), workers or len(os.sched_getaffinity(0)))
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(
            workers, mp_context=context, max_tasks_per_child=_ROWS_PER_PROCESS
        ) as pool:
            futures = {pool.submit(_work_out, row, folder): row for row, folder in missing}
            try:
                for row, error in _finished(futures):
                    done += 1
                    progress(done, len(wanted), row.name)
                    if error is not None:
                        failed.append(f"{row.name}: {type(error).__name__}: {error}")
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                raise
    if failed:
        raise InputError(
            f"{board}: {len(failed)} of {len(wanted)} rows failed, the first {failed[0]}; the others are "
            "kept, the same command goes on with these"
        )
    return [
        {"folder": str(folder), **json.loads((folder / _FILE).read_text(encoding="utf-8"))}
        for folder in folders
    ]


def _finished(futures: dict[Future[None], Row]) -> Any:
    """Yield each row with its error, or None, as it ends."""
    left = set(futures)
    while left:
        ended, left = wait(left, return_when=FIRST_COMPLETED)
        for future in ended:
            yield futures[future], future.exception()


def _work_out(row: Row, folder: Path) -> None:
    """Work out one row, and keep it."""
    module, _, function = row.work.partition(":")
    work = cast("Work", getattr(importlib.import_module(module), function))
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
