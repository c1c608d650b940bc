"""``unwrinkle config``: print the scenario or the site that a command would use."""

from pathlib import Path
from typing import Annotated

import typer

from unwrinkle.commands._shared.settings import ScenarioOption
from unwrinkle.models.errors import InputError

EXAMPLES = (
    "unwrinkle config --set loop.mode=paper --set speed=0.5",
    "unwrinkle config --site loopback",
)


def config(
    scenario: ScenarioOption = None,
    name: Annotated[
        str | None, typer.Option(help="Scenario of a file that holds several, by its name.")
    ] = None,
    site: Annotated[
        str | None,
        typer.Option(help="Print this site instead: its file, or the name of a shipped site."),
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="KEY=VALUE", help="Setting to change, e.g. speed=0.5; repeatable."
        ),
    ] = None,
) -> None:
    """Print all settings as YAML, each with its source: default, file or --set.

    The output is itself a scenario, or a site, file. Options such as --mode win over what is
    printed; no environment variable changes a setting.
    """
    chosen = settings or []
    if site is not None and (scenario is not None or name is not None):
        raise InputError("--site prints a site; leave --scenario and --name out")
    if site is not None:
        print(_site_text(site, chosen), end="")
    else:
        print(_scenario_text(scenario, name, chosen), end="")


def _scenario_text(path: Path | None, name: str | None, settings: list[str]) -> str:
    from unwrinkle.models.io.settings import settings_yaml
    from unwrinkle.models.scenario import load_scenario, scenario_names, shipped_scenario

    scenario = load_scenario(path, name, settings=settings)
    file = shipped_scenario() if path is None else path
    name = name or scenario_names(file)[0]
    head = f"Scenario {name}: {'the shipped ' if path is None else ''}{file.name}"
    sources = _sources(_raw(file).get(name), file.name, settings)
    return settings_yaml(scenario, sources, name=name, head=head)


def _site_text(name: str, settings: list[str]) -> str:
    from unwrinkle.models.io.settings import settings_yaml
    from unwrinkle.site.sites import find_site, site_file

    site, file = find_site(name, settings=settings), site_file(name)
    head = f"Site {site.name}: {file.name}; its paths are absolute here"
    return settings_yaml(site, _sources(_raw(file), file.name, settings), head=head)


def _raw(file: Path) -> dict[str, object]:
    import yaml

    raw = yaml.safe_load(file.read_text(encoding="utf-8"))
    return raw if isinstance(raw, dict) else {}


def _sources(raw: object, file: str, settings: list[str], prefix: str = "") -> dict[str, str]:
    """Return the source of every value that is not the schema's default, by dotted key."""
    from unwrinkle.models.io.settings import assigned_keys

    found: dict[str, str] = {}
    for key, value in raw.items() if isinstance(raw, dict) else ():
        inner = _sources(value, file, [], f"{prefix}{key}.")
        found |= inner or {f"{prefix}{key}": file}
    return found | dict.fromkeys(assigned_keys(settings), "--set")
