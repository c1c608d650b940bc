"""Compile kernels with numba, kept on disk where a folder can be written.

numba keeps compiled code in $NUMBA_CACHE_DIR, beside the source, or in the user's cache folder. In
a container whose source and home are read-only it has none of them, and refuses to define the
function; then every process compiles anew.
"""

import logging
from collections.abc import Callable
from typing import Any

import numba

_log = logging.getLogger(__name__)
_warned = False


def njit(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return numba's decorator with the options, with a cache where there is a place for one."""

    def compiled(function: Callable[..., Any]) -> Any:
        try:
            return numba.njit(cache=True, **options)(function)
        except RuntimeError as error:
            _warn(error)
            return numba.njit(**options)(function)

    return compiled


def _warn(error: RuntimeError) -> None:
    """Log once what a process without a cache costs."""
    global _warned
    if not _warned:
        _warned = True
        _log.warning(
            "compiled code cannot be kept (%s): each start takes up to a minute longer; set "
            "NUMBA_CACHE_DIR to a folder that can be written",
            error,
        )
