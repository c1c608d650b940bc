"""The pages name what is there: files, commands, options, and every name of the library."""

import ast
import json
import re
import shlex
from pathlib import Path
from typing import Any

import pytest
import typer
import yaml

from unwrinkle import cli

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = sorted(
    path.relative_to(ROOT).as_posix()
    for path in (*DOCS.rglob("*.md"), *ROOT.glob("*.md"))
    if DOCS / "results" not in path.parents or path.name == "README.md"
)
_FENCE = re.compile(r"^```(\S*)[^\n]*\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_LINK = re.compile(r"\]\((?!https?:|mailto:)([^)\s]+)\)")
_PAGE = re.compile(r"\{doc\}`(?:[^`<]*<)?(/?[\w./]+)>?`")


def _text(page: str) -> str:
    return (ROOT / page).read_text(encoding="utf-8")


def _anchors(path: Path) -> set[str]:
    """The anchors of a page's headings, as GitHub and MyST make them."""
    headings = re.findall(r"^#+ (.*)$", path.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", each.lower()).replace(" ", "-") for each in headings}


@pytest.mark.parametrize("page", PAGES)
def test_links_lead_to_files_and_headings(page: str) -> None:
    here = (ROOT / page).parent
    for link in _LINK.findall(_text(page)):
        name, _, anchor = link.partition("#")
        target = here / name if name else ROOT / page
        assert target.exists(), f"{page}: {link}"
        assert not anchor or anchor in _anchors(target), f"{page}: {link}"
    for name in _PAGE.findall(_text(page)):
        target = (DOCS / name[1:]) if name.startswith("/") else here / name
        assert any(target.with_suffix(end).exists() for end in (".md", ".rst")), f"{page}: {name}"


def test_every_page_is_in_a_table_of_contents() -> None:
    listed = {DOCS / "index"}
    for page in (*DOCS.rglob("*.md"), *DOCS.rglob("*.rst")):
        text = page.read_text(encoding="utf-8")
        trees = [body for kind, body in _FENCE.findall(text) if kind == "{toctree}"]
        trees += re.findall(r"^\.\. toctree::\n(.*)\Z", text, re.MULTILINE | re.DOTALL)
        names = [line.strip() for tree in trees for line in tree.splitlines()]
        for name in names:
            if name and not name.startswith(":"):
                listed |= {each.with_suffix("") for each in page.parent.glob(f"{name}.*")}
    pages = [each for end in ("md", "rst", "ipynb") for each in DOCS.rglob(f"*.{end}")]
    missing = {page for page in pages if page.with_suffix("") not in listed}
    assert not {each.relative_to(DOCS).as_posix() for each in missing}


def _names_of_the_facade() -> set[str]:
    face = (ROOT / "unwrinkle" / "__init__.pyi").read_text(encoding="utf-8")
    imports = [node for node in ast.parse(face).body if isinstance(node, ast.ImportFrom)]
    return {alias.asname or alias.name for node in imports for alias in node.names}


def test_every_name_of_the_facade_has_one_entry_in_the_api() -> None:
    api = (DOCS / "api" / "index.rst").read_text(encoding="utf-8")
    entries = re.findall(r"^\.\. face:: unwrinkle\n\n((?:   .*\n)+)", api, re.MULTILINE)
    names = " ".join(entries).split()
    assert sorted(names) == sorted(_names_of_the_facade())


def test_every_room_with_a_face_has_an_entry_in_the_api() -> None:
    pages = "".join(each.read_text(encoding="utf-8") for each in (DOCS / "api").glob("*.rst"))
    entries = set(re.findall(r"^\.\. face:: (\S+)$", pages, re.MULTILINE))
    folders = {
        each.parent.relative_to(ROOT)
        for folder in ROOT.iterdir()
        if folder.is_dir() and not folder.name.startswith(".")
        for each in folder.rglob("__init__.pyi")
    }
    rooms = {
        ".".join(each.parts if each.parts[0] == "unwrinkle" else ("unwrinkle", *each.parts))
        for each in folders
        if each.parts[0] not in ("build", "out")
    }
    assert entries == rooms


def _command(words: list[str]) -> tuple[Any, list[str]] | None:
    """The command that a line calls, and its further words; None where it names none."""
    command: Any = typer.main.get_command(cli.app)
    rest = list(words)
    while hasattr(command, "commands"):
        while rest and rest[0].startswith("-"):
            rest.pop(0)
        if not rest:
            return None
        assert rest[0] in command.commands, f"no command {rest[0]!r}"
        command, rest = command.commands[rest[0]], rest[1:]
    return command, rest


def _lines(page: str) -> list[str]:
    fences = [body for kind, body in _FENCE.findall(_text(page)) if kind in ("", "sh", "text")]
    fences += re.findall(r"`(unwrinkle [^`]*)`", _text(page))
    lines = [line for body in fences for line in body.splitlines()]
    calls = [re.sub(r"^(env( -u \w+)*|\.venv/bin/)? ?(?=unwrinkle )", "", line) for line in lines]
    calls = [re.split(r"\s#|\s+&|\s\|", call.replace(".venv/bin/", ""))[0] for call in calls]
    return [call for call in calls if call.startswith("unwrinkle ") and "COMMAND" not in call]


@pytest.mark.parametrize("page", PAGES)
def test_commands_and_options_of_the_pages_exist(page: str) -> None:
    for line in _lines(page):
        if re.search(r"unwrinkle (bench|calibrate) \w+\|", line) or line.endswith("|"):
            continue
        words = shlex.split(line)[1:]
        if not words or not re.fullmatch(r"-{0,2}[a-z][a-z-]*", words[0]):
            continue
        called = _command(words)
        if called is None:
            continue
        command, rest = called
        known = {each for param in command.params for each in (*param.opts, *param.secondary_opts)}
        options = {word.split("=")[0] for word in rest if re.match(r"--?[a-z]", word)}
        assert options <= known | {"--help", "-h"}, f"{page}: {line}"


def test_the_notebook_is_kept_without_outputs() -> None:
    cells = json.loads((DOCS / "tutorial.ipynb").read_text(encoding="utf-8"))["cells"]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert code
    assert not any(cell["outputs"] or cell["execution_count"] for cell in code)


def test_the_citation_is_that_of_this_version() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert f'version = "{citation["version"]}"' in project
    assert f'license = "{citation["license"]}"' in project


#: Words that claim what a model cannot show, and those of safety functions.
_CLAIMS = re.compile(
    r"\b(prov(e|es|ed|en)|proofs?|certif\w+|safe plans?|real protocol)\b", re.IGNORECASE
)
#: Where they are named to be avoided, or stand for something else.
_NAMED = re.compile(r"not|no |never|nor|\| verified against|safe, proved")


@pytest.mark.parametrize("page", PAGES)
def test_no_page_claims_a_proof(page: str) -> None:
    claims = [line for line in _text(page).splitlines() if _CLAIMS.search(line)]
    assert not [line for line in claims if not _NAMED.search(line)]
