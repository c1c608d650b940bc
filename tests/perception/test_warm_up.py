"""Kernels are compiled by a child process, once."""

import logging
import subprocess
import sys
from collections.abc import Sequence
from typing import Any

import pytest

from unwrinkle.perception import warm_up


def test_nothing_is_started_where_the_kernels_are_in_the_cache(monkeypatch: pytest.MonkeyPatch):
    warm_up.compile_kernels()
    assert warm_up.compiled()
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: pytest.fail("a child was started"))
    assert not warm_up.ensure_compiled()


def test_an_empty_cache_is_filled_by_a_child(monkeypatch: pytest.MonkeyPatch, tmp_path: Any):
    monkeypatch.setattr(warm_up, "_folders", lambda module: {str(tmp_path)})
    assert not warm_up.compiled()
    started: list[Sequence[str]] = []
    monkeypatch.setattr(subprocess, "run", lambda command, **_: started.append(command))
    assert warm_up.ensure_compiled()
    assert started[0][0] == sys.executable
    assert "unwrinkle.perception.warm_up import compile_kernels" in started[0][-1]


def test_a_child_that_fails_is_no_reason_to_stop(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Any, caplog: pytest.LogCaptureFixture
):
    def failing(*_: Any, **__: Any) -> None:
        raise subprocess.CalledProcessError(1, "python")

    monkeypatch.setattr(warm_up, "_folders", lambda module: {str(tmp_path)})
    monkeypatch.setattr(subprocess, "run", failing)
    with caplog.at_level(logging.WARNING):
        assert warm_up.ensure_compiled()
    assert "could not be compiled beforehand" in caplog.text
