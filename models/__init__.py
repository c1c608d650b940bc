"""The robot and the cell as data, and the small typed loader of them."""

from unwrinkle.models.errors import InputError as InputError
from unwrinkle.models.errors import NoSafePlanError as NoSafePlanError
from unwrinkle.models.errors import UnwrinkleError as UnwrinkleError
from unwrinkle.models.io.loader_yaml import load_yaml as load_yaml
from unwrinkle.models.io.loader_yaml import models_dir as models_dir
