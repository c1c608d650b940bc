"""Help of every command: two examples, which the command's own options accept; completion."""

import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import typer

from unwrinkle import cli

COMMAND = typer.main.get_command(cli.app)


def leaves(command, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], object]]:
    """List the commands without sub-commands, with their names."""
    inner = getattr(command, "commands", None)
    if inner is None:
        yield path, command
        return
    for name, child in inner.items():
        yield from leaves(child, (*path, name))


LEAVES = dict(leaves(COMMAND))
EXAMPLES = {
    path: [line for line in (command.epilog or "").split("\n\n") if line.startswith("unwrinkle ")]
    for path, command in LEAVES.items()
}


@pytest.mark.parametrize("path", LEAVES, ids=" ".join)
def test_two_examples(path: tuple[str, ...]) -> None:
    assert len(EXAMPLES[path]) == 2


@pytest.mark.parametrize("line", [line for lines in EXAMPLES.values() for line in lines])
def test_an_example_parses_and_is_of_its_command(line: str) -> None:
    words = shlex.split(line)[1:]
    command, context, path = COMMAND, None, ()
    while hasattr(command, "commands"):
        context = command.make_context("unwrinkle", words, parent=context)
        rest = [*context._protected_args, *context.args]
        name, command, words = command.resolve_command(context, rest)
        path = (*path, name)
    with command.make_context(path[-1], words, parent=context):
        pass
    assert line in EXAMPLES[path]


def test_an_example_with_a_wrong_option_does_not_parse() -> None:
    command = LEAVES[("verify",)]
    with pytest.raises(Exception, match="No such option"):
        command.make_context("verify", ["plan.npz", "--jsn", "a"])


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_offers_the_commands(shell: str, tmp_path: Path) -> None:
    # What the installed completion script of the shell runs.
    environment = {
        "_UNWRINKLE_COMPLETE": f"complete_{shell}",
        "COMP_WORDS": "unwrinkle ev",
        "COMP_CWORD": "1",
        "_TYPER_COMPLETE_ARGS": "unwrinkle ev",
        "_TYPER_COMPLETE_FISH_ACTION": "get-args",
        "PYTHONPATH": ":".join(sys.path),
    }
    found = subprocess.run(
        [sys.executable, "-m", "unwrinkle"],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert "evidence" in found.stdout, found.stderr
