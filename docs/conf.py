"""Handbook: Markdown pages in the furo theme."""

import os
import re

import dart_hal

project = "DART-HAL"
author = "The DART-HAL developers"
copyright = "2026, The DART-HAL developers"
version = release = dart_hal.__version__
extensions = ["myst_parser"]
source_suffix = {".md": "markdown"}
exclude_patterns = ["build"]
html_theme = "furo"
html_title = "DART-HAL"
html_static_path = ["_static"]
html_css_files = ["dart.css"]
myst_enable_extensions = ["dollarmath", "colon_fence", "attrs_inline"]
myst_heading_anchors = 3

HARDWARE = re.compile(r"\]\((?:\.\./)+hardware/README\.md(?=[#)])")


def setup(app):
    """In the handbook the page reference/hardware stands for hardware/README.md, which it includes."""
    def hardware_page(app, page, source):
        here = os.path.relpath("reference/hardware.md", os.path.dirname(page) or ".")
        source[0] = HARDWARE.sub(f"]({here}", source[0])

    app.connect("source-read", hardware_page)
