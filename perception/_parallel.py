"""Thread-pool helpers: row-parallel numba kernels and parallel map."""

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np


def _processors() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


#: Threads of the pool.
_THREADS = min(4, _processors())

#: Blocks of rows per thread; several, so that a preempted thread delays the others less.
_BLOCKS_PER_THREAD = 4

#: Least number of rows in a block.
_MIN_ROWS = 16


_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(_THREADS, thread_name_prefix="parallel")


def parallel_rows(kernel: Callable[..., None], rows: int, *arguments: Any) -> None:
    """Run `kernel(first, last, *arguments)` on blocks of rows in parallel.

    Args:
        kernel: function compiled with `nogil` that writes only to its rows [first, last).
        rows: number of rows.
        arguments: passed to the kernel.
    """
    count = max(1, min(_BLOCKS_PER_THREAD * _THREADS, rows // _MIN_ROWS))
    edges = np.linspace(0, rows, count + 1).round().astype(int).tolist()
    if count == 1:
        kernel(0, rows, *arguments)
        return
    for done in [_pool().submit(kernel, *edge, *arguments) for edge in pairwise(edges)]:
        done.result()


def parallel_map(function: Callable[[_Item], _Result], items: Iterable[_Item]) -> list[_Result]:
    """Apply a function to items in parallel; return the results in order.

    Only functions that release the global interpreter lock run concurrently.
    """
    return list(_pool().map(function, items))
