"""Fill the templates of the pages that the package writes; texts are escaped."""

from functools import cache
from typing import Any

import jinja2


@cache
def _environment(package: str) -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader(package, "."),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.policies["json.dumps_kwargs"] = {"allow_nan": False}  # keys stay in their order
    return environment


def filled_page(package: str, template: str, **values: Any) -> str:
    """Fill a template that lies in a package.

    Args:
        package: its name, e.g. `unwrinkle.report`.
        template: name of the file.
        values: of the template's names; text is escaped, `Markup` is taken as HTML.

    Raises:
        jinja2.UndefinedError: the template uses a name without a value.
    """
    return _environment(package).get_template(template).render(**values)
