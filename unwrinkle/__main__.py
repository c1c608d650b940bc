"""``python -m unwrinkle`` is the command ``unwrinkle``."""

from unwrinkle.cli import main

main()
