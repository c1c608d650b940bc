"""Command line: register the sub-commands, set up logging, convert errors into exit codes."""

import atexit
import gc
import importlib
import logging
import os
import pkgutil
import sys
from typing import Annotated

import typer

from unwrinkle import __version__, commands
from unwrinkle.commands._shared.examples import examples
from unwrinkle.models.errors import UnwrinkleError

app = typer.Typer(
    name="unwrinkle",
    help="Flatten a garment with two arms: find its wrinkles, plan a motion, "
    "verify it against the model of the cell.",
    epilog="Exit codes: 0 done, 1 internal error, 2 bad input or usage, "
    "3 no verified plan, 4 a device failed.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_version(wanted: bool) -> None:
    if wanted:
        print(f"unwrinkle {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    verbose: Annotated[
        int,
        typer.Option("--verbose", "-v", count=True, help="Log progress; twice for debug messages."),
    ] = 0,
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version."
        ),
    ] = False,
) -> None:
    level = (logging.WARNING, logging.INFO, logging.DEBUG)[min(verbose, 2)]
    handler = logging.StreamHandler()
    handler.setLevel(level)  # pydrake resets its logger's level to INFO on import
    logging.basicConfig(
        level=logging.WARNING, format="%(levelname)s %(name)s: %(message)s", handlers=[handler]
    )
    logging.getLogger("unwrinkle").setLevel(level)
    logging.getLogger("drake").setLevel(max(level, logging.INFO))  # DEBUG can deadlock Meshcat


def _register() -> None:
    """Add every command of the public modules of `commands` and of its folders.

    A module holds one command of its name, and in EXAMPLES the examples of its help.
    """
    for info in pkgutil.walk_packages(commands.__path__, f"{commands.__name__}."):
        name = info.name.rpartition(".")[2]
        if info.ispkg or any(part.startswith("_") for part in info.name.split(".")):
            continue
        module = importlib.import_module(info.name)
        command = getattr(module, name)
        if isinstance(command, typer.Typer):  # a command with sub-commands
            app.add_typer(command, name=name)
        else:
            app.command(epilog=examples(*module.EXAMPLES))(command)


_register()


def main() -> None:
    """Run the command line; errors raised on purpose become one line on stderr and an exit code."""
    # Before numpy is loaded. The matrices here are small: more threads only wait for each other,
    # and the last bits of a plan would depend on the number of cores.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    atexit.register(gc.freeze)  # at exit the collector would walk through all that was loaded
    try:
        app(prog_name="unwrinkle")
    except UnwrinkleError as error:
        print("unwrinkle: " + " ".join(str(error).split()), file=sys.stderr)
        sys.exit(error.exit_code)
