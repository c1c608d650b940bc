"""When garbage is collected while a robot moves: never."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def collected_at_rest() -> Iterator[None]:
    """Collect garbage only where `gc.collect` is called, in the main thread.

    The collector runs in whichever thread happens to need memory, stops all of them meanwhile, and Drake's renderers and
    Meshcats must not be destroyed by another thread than the one that made them.
    """
    enabled = gc.isenabled()
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()
