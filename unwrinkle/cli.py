"""Command line: register the sub-commands, set up logging, convert errors into exit codes."""

import atexit
import errno
import gc
import importlib
import locale
import logging
import os
import pkgutil
import sys
from typing import Annotated, NoReturn

import typer

from unwrinkle import __version__, commands
from unwrinkle.commands._shared.examples import examples
from unwrinkle.models.errors import UnwrinkleError

#: Errors of a standard output that cannot be written.
_OUTPUT_ERRORS = (errno.ENOSPC, errno.EIO, errno.EDQUOT)

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
        try:
            app(prog_name="unwrinkle")
        finally:
            if sys.stdout is not None:
                sys.stdout.flush()
    except UnwrinkleError as error:
        _end(str(error), error.exit_code)
    except OSError as error:
        if error.filename is not None or error.errno not in _OUTPUT_ERRORS:
            raise
        # What is left in the buffer cannot be written either, and would fail again at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        _end(f"standard output cannot be written ({error.strerror}); free its disk", 2)
    except ImportError as error:
        if "initialization failed" not in str(error):
            raise
        # Drake reads its environment as UTF-8.
        _end(
            f"Drake does not load ({error}) in the locale {locale.setlocale(locale.LC_CTYPE)}; "
            "set LC_ALL=C.UTF-8",
            2,
        )


def _end(text: str, code: int) -> NoReturn:
    """Print one line on stderr and exit."""
    print("unwrinkle: " + " ".join(text.split()), file=sys.stderr)
    sys.exit(code)
