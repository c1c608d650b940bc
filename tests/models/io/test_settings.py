"""Settings by dotted key: values, types, refusals, and YAML with the sources."""

import dataclasses as dc
from pathlib import Path

import pytest
import yaml

from unwrinkle.models.errors import InputError
from unwrinkle.models.io.settings import (
    SettingTypeError,
    UnknownSettingError,
    setting_values,
    settings_yaml,
    with_settings,
)
from unwrinkle.models.scenario import Scenario, load_scenario
from unwrinkle.models.site import Site, loopback_site
from unwrinkle.site.sites import find_site


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("speed=0.5", 0.5),
        ("speed=1", 1.0),
        ("speed=1e-1", 0.1),  # a text in YAML 1.1
        ("loop.actions=3", 3),
        ("loop.mode=paper", "paper"),
        ("planner.turntable = fixed", "fixed"),
        ("garment_centre=[0.1, -1]", [0.1, -1.0]),
        ("directives=[a.yaml, b.yaml]", ["a.yaml", "b.yaml"]),
        ("station.garment.nodes=40", 40),
        ("robot=2013", "2013"),
    ],
)
def test_a_value_is_read_by_its_type(text: str, value: object) -> None:
    changed = setting_values(with_settings(Scenario(), [text]))
    key = text.partition("=")[0].strip()
    assert changed[key] == value and type(changed[key]) is type(value)
    rest = {name: item for name, item in setting_values(Scenario()).items() if name != key}
    assert {name: item for name, item in changed.items() if name != key} == rest


def test_lists_of_flags_and_switches() -> None:
    site = with_settings(Site(), ["grippers.inverted=[true, false]", "commissioning=false"])
    assert site.grippers.inverted == [True, False]
    assert site.commissioning is False


@pytest.mark.parametrize(
    ("key", "near"),
    [
        ("loop.mod", "loop.mode"),
        ("mode", "loop.mode"),
        ("turntabel", "planner.turntable"),
        ("clearence.arm_arm", "clearance.arm_arm"),
    ],
)
def test_an_unknown_key_names_the_nearest(key: str, near: str) -> None:
    with pytest.raises(UnknownSettingError) as refused:
        with_settings(Scenario(), [f"{key}=1"])
    assert refused.value.key == key
    assert near in refused.value.near
    assert near in str(refused.value)


def test_a_group_names_its_settings() -> None:
    with pytest.raises(UnknownSettingError) as refused:
        with_settings(Scenario(), ["clearance=0.1"])
    wanted = {f"clearance.{item.name}" for item in dc.fields(Scenario().clearance)}
    assert set(refused.value.near) == wanted


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("speed=fast", "a number"),
        ("speed=true", "a number"),
        ("loop.actions=2.5", "a whole number"),
        ("loop.actions=yes", "a whole number"),
        ("garment_centre=0.1", "a list, each a number, e.g. [a, b]"),
        ("garment_centre=[0.1, x]", "a list, each a number, e.g. [a, b]"),
        ("speed=[", "a number"),
    ],
)
def test_a_value_of_another_type_is_refused(text: str, expected: str) -> None:
    with pytest.raises(SettingTypeError) as refused:
        with_settings(Scenario(), [text])
    assert refused.value.key == text.partition("=")[0]
    assert refused.value.expected == expected


@pytest.mark.parametrize("texts", [["speed"], ["=1"], ["speed=0.5", "speed=0.6"]])
def test_bad_assignments_are_refused(texts: list[str]) -> None:
    with pytest.raises(InputError):
        with_settings(Scenario(), texts)


def test_the_scenario_checks_changed_values() -> None:
    assert load_scenario(settings=("loop.mode=paper",)).loop.mode == "paper"
    with pytest.raises(InputError, match="foot, paper, between"):
        load_scenario(settings=("loop.mode=papers",))
    with pytest.raises(InputError, match="speed"):
        load_scenario(settings=("speed=1.5",))


@pytest.mark.parametrize("settings", [Scenario(), Site(name="a: b # c", speed=1e-7)])
def test_the_yaml_reads_back_and_names_every_source(settings: object) -> None:
    text = settings_yaml(settings, {"speed": "--set"}, name="Mine", head="a head")
    assert yaml.safe_load(text)["Mine"]["speed"] == pytest.approx(settings.speed)
    assert text.startswith("# a head\n")
    values = [
        line for line in text.splitlines()[2:] if not line.split("#")[0].rstrip().endswith(":")
    ]
    assert len(values) == len(setting_values(settings))
    sources = [line.rpartition("# ")[2] for line in values]
    assert sources.count("--set") == 1
    assert sources.count("default") == len(values) - 1


@pytest.mark.parametrize("number", [".nan", ".inf", "-.inf"])
def test_no_number_of_a_scenario_is_infinite_or_none(number: str, tmp_path: Path) -> None:
    """A clearance that is not a number would allow every distance."""
    for key, value in setting_values(load_scenario()).items():
        if isinstance(value, float):
            text = number
        elif isinstance(value, list) and value and isinstance(value[0], float):
            text = f"[{', '.join([number] + [str(each) for each in value[1:]])}]"
        else:
            continue
        with pytest.raises(InputError):
            load_scenario(settings=[f"{key}={text}"])
    path = tmp_path / "lab.scenario.yaml"
    path.write_text(f"Lab:\n  clearance: {{arm_arm: {number}}}\n", encoding="utf-8")
    with pytest.raises(InputError):
        load_scenario(path)


@pytest.mark.parametrize("number", [".nan", ".inf", "-.inf"])
def test_no_number_of_a_site_is_infinite_or_none(number: str) -> None:
    for key, value in setting_values(loopback_site()).items():
        if isinstance(value, float):
            with pytest.raises(InputError):
                find_site("loopback", settings=[f"{key}={number}"])
