"""Sphinx configuration. The build needs no network access."""

from __future__ import annotations

import os
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE / "_ext"))
os.environ.setdefault("MPLBACKEND", "Agg")

import crosstrack  # noqa: E402

project = "crosstrack"
author = "the crosstrack contributors"
project_copyright = author
version = release = crosstrack.__version__

extensions = [
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx_gallery.gen_gallery",
    "crosstrack_site",
    "crosstrack_pages",
    "crosstrack_pictures",
    "crosstrack_entries",
    "crosstrack_code",
    "crosstrack_papers",
    "crosstrack_install",
    "crosstrack_tables",
    "crosstrack_api",
]

exclude_patterns = [
    "_build",
    "_ext",
    "examples",
    "stranger",
    "gallery/**.ipynb",
    "gallery/**.py",
    "**.zip",
]
nitpicky = True
# The build needs no network, so names of other packages have no target.
nitpick_ignore_regex = [("py:.*", r"(abc|enum|numpy|collections|typing|gymnasium|matplotlib)\..+")]
suppress_warnings = ["config.cache"]

myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3

autodoc_typehints = "none"
autodoc_member_order = "bysource"
autosummary_generate = False
toc_object_entries_show_parents = "hide"
numpydoc_show_class_members = False
# Public types in docstrings are links; `crosstrack_api` defines the names.
numpydoc_xref_param_type = True
numpydoc_xref_ignore = "all"

html_math_renderer = "mathml"
html_theme = "furo"
html_title = f"crosstrack {version}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sphinx = False
templates_path: list[str] = []

sphinx_gallery_conf = {
    "examples_dirs": "examples",
    "gallery_dirs": "gallery",
    "filename_pattern": r"/plot_",
    "image_scrapers": ("crosstrack_site",),
    "download_all_examples": False,
    "show_memory": False,
    "show_signature": False,
    "remove_config_comments": True,
    "min_reported_time": 10**6,
    "abort_on_example_error": True,
    "nested_sections": False,
    "write_computation_times": False,
    # Figures are the value of their block; do not print them.
    "capture_repr": (),
}
