"""Document the public names of a room: those that its face, `__init__.pyi`, lists.

    .. face:: unwrinkle.planning.timing

documents all of them; names below it document these alone. A name that several faces list is
documented once, on the page of the first of them in the order of `FOLDERS`, and is a link on the
others.
"""

import importlib
import inspect
import re
import sys
from functools import cache
from types import ModuleType
from typing import Any

from docutils import nodes
from docutils.parsers.rst import Directive
from docutils.statemachine import StringList
from sphinx.application import Sphinx
from sphinx.pycode import ModuleAnalyzer

#: Packages whose faces are documented; the facade owns its names.
FOLDERS = (
    "unwrinkle",
    "unwrinkle.flattening",
    "unwrinkle.perception",
    "unwrinkle.planning",
    "unwrinkle.models",
    "unwrinkle.hardware",
    "unwrinkle.simulation",
    "unwrinkle.systems",
    "unwrinkle.site",
    "unwrinkle.execution",
    "unwrinkle.closed_loop",
    "unwrinkle.runs",
    "unwrinkle.logs",
    "unwrinkle.report",
    "unwrinkle.viewer",
    "unwrinkle.exports",
    "unwrinkle.evidence",
    "unwrinkle.testing",
)


@cache
def rooms(package: str) -> tuple[str, ...]:
    """Return a package and the rooms below it, as its face lists them, outermost first."""
    module = importlib.import_module(package)
    below = [name for name in module.__all__ if isinstance(getattr(module, name), ModuleType)]
    return (package, *(each for name in below for each in rooms(f"{package}.{name}")))


def public_names(room: str) -> dict[str, Any]:
    """Return the names of a face that are no rooms, with what they are."""
    module = importlib.import_module(room)
    found = {name: getattr(module, name) for name in module.__all__}
    return {name: each for name, each in found.items() if not isinstance(each, ModuleType)}


@cache
def owners() -> dict[tuple[str, str], str]:
    """Map the defining module and the name of every public object to the room that documents it."""
    found: dict[tuple[str, str], str] = {}
    for folder in FOLDERS:
        for room in rooms(folder):
            for name, each in public_names(room).items():
                found.setdefault(_key(name, each), room)
    return found


def _key(name: str, each: Any) -> tuple[str, str]:
    return getattr(each, "__module__", None) or "", getattr(each, "__qualname__", name)


def _entry(room: str, name: str, each: Any) -> list[str]:
    owner = owners()[_key(name, each)]
    if owner != room:
        role = "class" if inspect.isclass(each) else "func" if callable(each) else "data"
        return ["", f"- :py:{role}:`{owner}.{name}`"]
    if inspect.isclass(each):
        kind = "autoexception" if issubclass(each, BaseException) else "autoclass"
        shown = [] if each.__bases__ == (object,) else ["   :show-inheritance:"]
        return ["", f".. {kind}:: {room}.{name}", "   :members:", *shown, ""]
    if isinstance(each, dict):
        return ["", f".. py:data:: {room}.{name}", "", f"   {_comment(room, name, each)}", ""]
    return ["", f".. {'autofunction' if callable(each) else 'autodata'}:: {room}.{name}", ""]


def _comment(room: str, name: str, each: Any) -> str:
    """Return the comment `#:` of a value in the module of a room that defines it.

    A value such as a dictionary would be documented by what its type says of itself.
    """
    for below, module in list(sys.modules.items()):
        if below.startswith(f"{room}.") and getattr(module, name, None) is each:
            lines = ModuleAnalyzer.for_module(below).find_attr_docs().get(("", name))
            if lines:
                return " ".join(lines).strip()
    raise KeyError(f"{room}.{name} has no comment that begins with '#:'")


_SEVERAL = re.compile(r"(?P<indent> +)(?P<names>\*{0,2}\w+(?:, \*{0,2}\w+)+): (?P<text>.*)")


def split_entries(
    app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]
) -> None:
    """Give each argument of an entry `a, b: text` an entry of its own; napoleon reads one name."""
    result: list[str] = []
    section = False
    k = 0
    while k < len(lines):
        line = lines[k]
        k += 1
        if line and not line.startswith(" "):
            section = line in ("Args:", "Attributes:")
        entry = _SEVERAL.fullmatch(line) if section else None
        if entry is None:
            result.append(line)
            continue
        deeper = entry["indent"] + " "
        rest = []
        while k < len(lines) and lines[k].startswith(deeper):
            rest.append(lines[k])
            k += 1
        for each in entry["names"].split(", "):
            result += [f"{entry['indent']}{each}: {entry['text']}", *rest]
    lines[:] = result


_ARRAY = re.compile(r"ndarray\[tuple\[Any, \.\.\.\], dtype\[(?P<kind>[\w.\[\]]+?)\]\]")


def shorten_arrays(
    app: Sphinx, what: str, name: str, obj: Any, options: Any, signature: str, returns: str
) -> tuple[str, str]:
    """Write numpy's array types as they stand in the code, `NDArray[float64]`."""
    return tuple(
        text and _ARRAY.sub(lambda found: f"NDArray[{found['kind']}]", text)
        for text in (signature, returns)
    )


class Face(Directive):
    """Document the names of a face."""

    required_arguments = 1
    has_content = True

    def run(self) -> list[nodes.Node]:
        """Return the documentation of the names."""
        room = self.arguments[0]
        chosen = " ".join(self.content).split()
        names = public_names(room)
        lines: list[str] = []
        if not chosen:
            lines += [*(inspect.getdoc(importlib.import_module(room)) or "").splitlines(), ""]
        for name in chosen or sorted(names, key=str.lower):
            lines += _entry(room, name, names[name])
        parent = nodes.section()
        parent.document = self.state.document
        self.state.nested_parse(StringList(lines, source=f"face of {room}"), 0, parent)
        return parent.children


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive `face`."""
    app.add_directive("face", Face)
    app.connect("autodoc-process-signature", shorten_arrays)
    app.connect("autodoc-process-docstring", split_entries, priority=400)  # before napoleon's
    return {"parallel_read_safe": True, "parallel_write_safe": True}
