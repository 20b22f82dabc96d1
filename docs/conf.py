"""The documentation as a site: `python -m sphinx -nW docs site`, without network, every warning an error."""

import os
import sys
from importlib.metadata import version as version_of
from pathlib import Path

os.environ.setdefault("RELNAV_JIT", "0")  # models are loaded here, nothing is filtered: do not compile
sys.path.insert(0, str(Path(__file__).parent / "_ext"))

project = "relnav"
author = "The relnav founders"
copyright = "the relnav founders, MIT licence"  # noqa: A001  (Sphinx's name)
release = version = version_of("relnav")

extensions = ["myst_parser", "sphinx.ext.autodoc", "numpydoc", "mathml", "generated", "notebooks"]
exclude_patterns = ["_ext"]
root_doc = "index"

myst_enable_extensions = ["dollarmath", "deflist"]
myst_heading_anchors = 3

highlight_language = "none"  # what a program prints is no Python; code names its language
default_role = "code"  # a name between single backticks in a docstring
autodoc_typehints = "none"  # types, shapes and units stand in the docstrings
autodoc_member_order = "bysource"
numpydoc_show_class_members = False
numpydoc_class_members_toctree = False
nitpick_ignore_regex = [("py:.*", r"(numpy|scipy|pyarrow|matplotlib|pandas|xarray)\..*")]

html_theme = "furo"
html_title = f"relnav {release}"
html_theme_options = {"light_css_variables": {"code-font-size": "var(--font-size--small--3)"}}
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False
