"""Kernels are compiled by a child process, once."""

import logging
import subprocess
import sys
from collections.abc import Sequence
from typing import Any

import pytest

from unwrinkle.perception.stereo import compile_cache


def test_nothing_is_started_where_the_kernels_are_in_the_cache(monkeypatch: pytest.MonkeyPatch):
    compile_cache.compile_kernels()
    assert compile_cache.compiled()
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: pytest.fail("a child was started"))
    assert not compile_cache.ensure_compiled()


def test_an_empty_cache_is_filled_by_a_child(monkeypatch: pytest.MonkeyPatch, tmp_path: Any):
    monkeypatch.setattr(compile_cache, "_folders", lambda module: {str(tmp_path)})
    assert not compile_cache.compiled()
    started: list[Sequence[str]] = []
    monkeypatch.setattr(subprocess, "run", lambda command, **_: started.append(command))
    assert compile_cache.ensure_compiled()
    assert started[0][0] == sys.executable
    assert "unwrinkle.perception.stereo.compile_cache import compile_kernels" in started[0][-1]


def test_a_child_that_fails_is_no_reason_to_stop(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Any, caplog: pytest.LogCaptureFixture
):
    def failing(*_: Any, **__: Any) -> None:
        raise subprocess.CalledProcessError(1, "python")

    monkeypatch.setattr(compile_cache, "_folders", lambda module: {str(tmp_path)})
    monkeypatch.setattr(subprocess, "run", failing)
    with caplog.at_level(logging.WARNING):
        assert compile_cache.ensure_compiled()
    assert "could not be compiled beforehand" in caplog.text
