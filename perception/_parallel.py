"""Sharing work out to a few threads: strips of rows for a compiled kernel, or several filters."""

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


_THREADS = min(4, _processors())
_STRIPS = 4  # per thread, so that a thread that was held up does not hold up all
_LEAST_ROWS = 16


_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(_THREADS, thread_name_prefix="strip")


def parallel_rows(kernel: Callable[..., None], rows: int, *arguments: Any) -> None:
    """Call `kernel(first, last, *arguments)` for strips that share out `rows`.

    Args:
        kernel: compiled with `nogil`; writes only what belongs to its rows.
        rows: how many there are.
        arguments: given on.
    """
    count = max(1, min(_STRIPS * _THREADS, rows // _LEAST_ROWS))
    edges = np.linspace(0, rows, count + 1).round().astype(int).tolist()
    if count == 1:
        kernel(0, rows, *arguments)
        return
    for done in [_pool().submit(kernel, *edge, *arguments) for edge in pairwise(edges)]:
        done.result()


def parallel_map(function: Callable[[_Item], _Result], items: Iterable[_Item]) -> list[_Result]:
    """Return the function's results for items, in order; it must release Python's lock to gain."""
    return list(_pool().map(function, items))
