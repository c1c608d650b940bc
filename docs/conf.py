"""Configure Sphinx: the site of the documentation, built offline by `make docs`."""

import sys
from importlib.metadata import version as installed_version
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_extensions"))

project = "unwrinkle"
author = "The unwrinkle authors"
copyright = "the unwrinkle authors, BSD-3-Clause"
release = version = installed_version("unwrinkle")

extensions = [
    "myst_nb",  # pages in Markdown; runs the notebook
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx_design",
    "faces",
    "mathml",
]
exclude_patterns = ["_extensions"]
html_theme = "furo"
html_title = f"unwrinkle {release}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_math_renderer = "mathml"
html_show_sphinx = False
html_copy_source = False
html_show_sourcelink = False
templates_path: list[str] = []

myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 120
nb_execution_show_tb = True
nb_merge_streams = True

default_role = "code"  # docstrings mark code by single backticks
autoclass_content = "both"
autodoc_class_signature = "mixed"
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
napoleon_attr_annotations = False  # they stand in the signature
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 80
python_display_short_literal_types = True
add_module_names = True

# Every reference has to resolve, but for types in signatures without an entry: those of other
# libraries, and those that only their own room uses.
nitpicky = True
nitpick_ignore_regex = [("py:.*", r"(?!unwrinkle).*"), ("py:class", r"unwrinkle\..+\..+")]
