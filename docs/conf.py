"""How Sphinx builds this documentation: `make docs` puts it into site/."""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
sys.path.insert(0, str(HERE.parent))

import spring_pendulum_env  # noqa: E402  it is found by the lines above

project = "spring_pendulum_env"
author = "The spring_pendulum_env developers"
version = release = spring_pendulum_env.__version__

extensions = [
    "myst_parser",  # pages in Markdown
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",  # docstrings under Args, Returns, Raises
    "extensions.docstrings",
    "extensions.equations",
    "extensions.manual",
]
exclude_patterns = ["extensions", "_static"]
myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_heading_anchors = 3
html_math_renderer = "mathml"

autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autodoc_type_aliases = {name: name for name in ("ArrayLike", "FloatArray", "Array")}
napoleon_numpy_docstring = False
napoleon_custom_sections = [("Arguments", "params_style"), ("Attributes", "params_style")]
python_use_unqualified_type_names = True

html_theme = "furo"
html_title = "spring_pendulum_env"
html_static_path = ["_static"]
html_css_files = ["style.css"]
html_extra_path = ["live.html"]
html_show_sphinx = False
html_show_copyright = False  # the licence is the README's
html_copy_source = False
html_show_sourcelink = False
html_theme_options = {"navigation_with_keys": True}
