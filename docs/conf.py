"""Handbook: Markdown pages in the furo theme."""

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


def setup(app):
    """In the handbook the page hardware.md stands for hardware/README.md, which it includes."""
    app.connect("source-read", lambda app, page, source: source.__setitem__(
        0, source[0].replace("../hardware/README.md#", "hardware.md#")
        .replace("../hardware/README.md)", "hardware.md)")))
