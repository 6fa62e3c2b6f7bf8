"""Handbook: Markdown pages in the furo theme."""

import dart_hal

project = "DART-HAL"
author = "The DART-HAL developers"
copyright = "2026, The DART-HAL developers"
version = release = dart_hal.__version__
extensions = ["myst_parser"]
source_suffix = {".md": "markdown"}
exclude_patterns = ["build", "build_guide/README.md"]
html_theme = "furo"
html_title = "DART-HAL"
myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_heading_anchors = 3
suppress_warnings = ["myst.xref_missing"]
