"""Limits files: every limit of every axis is a finite number."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from unwrinkle.models.errors import InputError
from unwrinkle.models.io.loader_yaml import models_dir
from unwrinkle.models.limits import load_limits

_SHIPPED = models_dir() / "limits.yaml"
_KEYS = ("lower", "upper", "velocity", "acceleration", "jerk", "effort")
_PLACES = [
    *(("turntable", "ext_axis", key) for key in _KEYS),
    *(("arm", "l", key) for key in _KEYS),
    *(("head", axis, key) for axis in ("pan", "tilt") for key in _KEYS[:3]),
    ("gripper", "stroke"),
    ("gripper", "velocity"),
    ("tip_speed_holding",),
]


def _changed(folder: Path, place: tuple[str, ...], value: object) -> Path:
    """Write the shipped limits with one value replaced; without it for None."""
    limits: Any = yaml.safe_load(_SHIPPED.read_text(encoding="utf-8"))
    inner = limits
    for key in place[:-1]:
        inner = inner[key]
    if value is None:
        del inner[place[-1]]
    else:
        inner[place[-1]] = value
    path = folder / "limits.yaml"
    path.write_text(yaml.safe_dump(limits), encoding="utf-8")
    return path


def test_the_shipped_limits_are_finite() -> None:
    limits = load_limits(_SHIPPED)
    for name in ("lower", "upper", "velocity", "acceleration", "jerk", "effort"):
        assert np.isfinite(getattr(limits, name)).all()


@pytest.mark.parametrize("place", _PLACES, ids=".".join)
@pytest.mark.parametrize("value", [None, float("nan"), float("inf"), float("-inf")])
def test_a_limit_that_is_missing_or_not_finite_is_refused(
    place: tuple[str, ...], value: float | None, tmp_path: Path
) -> None:
    """Every comparison with such a limit would hold, so that a motion beyond it would pass."""
    with pytest.raises(InputError):
        load_limits(_changed(tmp_path, place, value))


@pytest.mark.parametrize("key", _KEYS[2:])
@pytest.mark.parametrize("value", [0.0, -1.0])
def test_a_limit_that_is_not_positive_is_refused(key: str, value: float, tmp_path: Path) -> None:
    with pytest.raises(InputError):
        load_limits(_changed(tmp_path, ("arm", "l", key), value))


def test_a_range_that_is_empty_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError):
        load_limits(_changed(tmp_path, ("arm", "l", "lower"), 3.0))
