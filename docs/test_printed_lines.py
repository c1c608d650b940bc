"""Run the lines that the pages print, as printed, each page in a folder of its own.

From the top of a page to its end: a fence with the language `sh` or `python` is run, and a block of
code whose caption is the name of a file is written to it. Fences of other languages are not run.
"""

import contextlib
import os
import re
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

DOCS = Path(__file__).parent
PAGES = ("quickstart", *(f"howto/own_{name}" for name in ("capture", "camera", "cell", "policy")))
PAGES += ("howto/own_site", "howto/headless", "howto/container")
PAGES += ("howto/settings", "howto/export", "howto/evidence")
#: Pages that execute in real time, which a busy computer may be too slow for: tried twice.
REAL_TIME = ("quickstart", "howto/own_site")
#: Longest time of one block, s.
LONGEST = 240.0

_FENCE = re.compile(
    r"^```(?P<language>\S*)(?P<argument>[^\n]*)\n(?P<body>.*?)^```$", re.MULTILINE | re.DOTALL
)
_CAPTION = re.compile(r"\A:caption: (?P<name>[\w.-]+)\n\n", re.MULTILINE)


@dataclass(frozen=True)
class Block:
    """A block of a page: `sh` or `python` to run, or `file` to write under a name."""

    kind: str
    text: str
    name: str = ""


def blocks_of(page: str) -> list[Block]:
    """Return the blocks of a page that are run or written, in order."""
    found = []
    for fence in _FENCE.finditer(page):
        language, body = fence["language"], fence["body"]
        caption = _CAPTION.match(body) if language == "{code-block}" else None
        if caption:
            found.append(Block("file", body[caption.end() :], caption["name"]))
        elif language in ("sh", "python"):
            found.append(Block(language, body))
    return found


def run(block: Block, folder: Path) -> str:
    """Run a block in a folder, or write its file; return what it printed.

    Raises:
        AssertionError: the block failed, with what it printed.
    """
    if block.kind == "file":
        (folder / block.name).write_text(block.text, encoding="utf-8")
        return ""
    command = ["bash", "-euo", "pipefail", "-c", block.text]
    if block.kind == "python":
        command = [sys.executable, "-W", "error::DeprecationWarning:__main__", "-c", block.text]
    environment = dict(os.environ)
    environment["PATH"] = f"{Path(sys.executable).parent}:{environment['PATH']}"
    with subprocess.Popen(
        command,
        cwd=folder,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=(out := (folder / "printed").open("w+")),
        stderr=subprocess.STDOUT,
        start_new_session=True,
    ) as process:
        try:
            status = process.wait(LONGEST)
        except subprocess.TimeoutExpired:
            status = "too long"
        finally:  # what the block left in the background ends with it
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGTERM)
    out.seek(0)
    printed = out.read()
    out.close()
    assert status == 0, f"{block.text}\nended with {status}:\n{printed}"
    return printed


@pytest.mark.parametrize("page", PAGES)
def test_the_lines_of_a_page_run_as_printed(page: str, tmp_path: Path) -> None:
    """Every block of the page succeeds."""
    blocks = blocks_of((DOCS / f"{page}.md").read_text(encoding="utf-8"))
    assert any(block.kind != "file" for block in blocks)
    attempts = 2 if page in REAL_TIME else 1
    for attempt in range(1, attempts + 1):
        folder = tmp_path / str(attempt)
        folder.mkdir()
        try:
            for block in blocks:
                run(block, folder)
            return
        except AssertionError:
            if attempt == attempts:
                raise


@pytest.mark.parametrize(
    "page",
    [
        "```sh\nfalse\ntrue\n```\n",
        "```sh\nfalse | true\n```\n",
        "```python\nraise SystemExit(3)\n```\n",
        "```{code-block} yaml\n:caption: a.yaml\n\nx: 1\n```\n\n```sh\ngrep y a.yaml\n```\n",
        "```sh\nunwrinkle plan nothing.npz\n```\n",
    ],
)
def test_a_line_that_fails_is_found(page: str, tmp_path: Path) -> None:
    """The runner fails where a printed line does."""
    with pytest.raises(AssertionError):
        for block in blocks_of(page):
            run(block, tmp_path)
