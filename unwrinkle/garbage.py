"""Disable Python's garbage collector during motion."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def gc_disabled() -> Iterator[None]:
    """Collect garbage once, then disable the collector while the block runs.

    The collector runs in the thread whose allocation triggers it and stops all threads meanwhile;
    and Drake's renderers and Meshcat instances must be destroyed by the thread that created them.
    The main thread may call `gc.collect` at rest.
    """
    enabled = gc.isenabled()
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()
