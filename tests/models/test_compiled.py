"""Kernels compile where no folder can be written for what is compiled."""

import logging

import numba
import pytest
from numba.core import caching

from unwrinkle.models import compiled


def test_without_a_place_for_a_cache_a_kernel_compiles_and_a_warning_says_so_once(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(caching.CacheImpl, "_locator_classes", [])
    monkeypatch.setattr(compiled, "_warned", False)
    with pytest.raises(RuntimeError):
        numba.njit(cache=True)(lambda x: x)
    with caplog.at_level(logging.WARNING):
        add, double = compiled.njit()(lambda x, y: x + y), compiled.njit()(lambda x: 2 * x)
    assert add(2, 3) == 5 and double(4) == 8
    assert [record.levelname for record in caplog.records] == ["WARNING"]
