"""A controller driver polled by a thread of this process, for drivers that fail on purpose."""

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from unwrinkle.hardware.controller.driver import ControllerDriver
from unwrinkle.hardware.controller.driver_loop import DriverLoop
from unwrinkle.hardware.controller.proxy import DriverProxy
from unwrinkle.hardware.message_pipe import MessagePipe


@contextmanager
def polled_in_thread(driver: ControllerDriver) -> Iterator[DriverProxy]:
    """Poll a driver in a thread while the block runs; yield its proxy."""
    ours, theirs = socket.socketpair()
    loop = DriverLoop(driver, MessagePipe(theirs))
    pipe = MessagePipe(ours)
    thread = threading.Thread(target=loop.run, daemon=True)
    thread.start()
    first = pipe.receive(10.0)
    if isinstance(first, Exception):
        raise first
    proxy = DriverProxy(pipe)
    try:
        yield proxy
    finally:
        proxy.close()
        thread.join(10.0)
        theirs.close()
