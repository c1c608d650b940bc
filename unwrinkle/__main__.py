"""Run the command line as ``python -m unwrinkle``."""

from unwrinkle.cli import main

main()
