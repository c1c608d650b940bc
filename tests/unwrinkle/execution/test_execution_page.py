"""The live page of an execution.

It shows the robot, reads buttons, and detects when it is closed.
"""

import base64
import os
import socket
import time
from collections.abc import Callable
from urllib.parse import urlparse

import numpy as np
import pytest

from unwrinkle.execution.page import PERIOD, ExecutionPage
from unwrinkle.hardware.controller_state import JointFeedback
from unwrinkle.models.robot import Cell
from unwrinkle.planning.plan import FlatteningPlan
from unwrinkle.viewer.scene import start_meshcat

pytestmark = pytest.mark.alone


def browser(url: str) -> socket.socket:
    """Open a websocket, which Meshcat counts as a browser."""
    place = urlparse(url)
    connection = socket.create_connection(("127.0.0.1", place.port or 80))
    key = base64.b64encode(os.urandom(16)).decode()
    connection.sendall(
        f"GET / HTTP/1.1\r\nHost: {place.netloc}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        f"Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n\r\n".encode()
    )
    assert connection.recv(1 << 12).startswith(b"HTTP/1.1 101")
    return connection


def until(predicate: Callable[[], bool]) -> None:
    end = time.monotonic() + 10.0
    while not predicate():
        assert time.monotonic() < end
        time.sleep(0.01)


@pytest.mark.slow
def test_a_page_that_is_closed_is_noticed(cell: Cell, plan: FlatteningPlan) -> None:
    meshcat = start_meshcat()
    feedback = JointFeedback(np.full(13, 0.1), np.zeros(13), 0.0)
    page = ExecutionPage(plan, cell, meshcat, lambda: feedback)
    now = [0.0]

    def look() -> None:
        now[0] += 2.0 * PERIOD
        assert list(page.update(now[0], "approach at 10%")) == []

    look()
    assert not page.closed, "a page that nobody has opened is not closed"
    connection = browser(meshcat.web_url())
    until(lambda: meshcat.GetNumActiveConnections() == 1)
    look()
    assert not page.closed
    connection.close()
    until(lambda: meshcat.GetNumActiveConnections() == 0)
    assert list(page.update(now[0], "too soon")) == [] and not page.closed
    look()
    assert page.closed
    np.testing.assert_allclose(page.positions, 0.1)
