"""Handbook: Markdown pages in the furo theme, the Python reference by autodoc."""

import os
import re
import sys
from pathlib import Path

import dart_hal
import dart_lab
from dart_lab.live.view.flash_page import load_flash_assets

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

import api_pages  # noqa: E402 - beside this file
import recorded_run  # noqa: E402

project = "DART-HAL"
author = "The DART-HAL developers"
copyright = "2026, The DART-HAL developers"
version = release = dart_hal.__version__
extensions = ["myst_nb", "sphinx.ext.autodoc"]
nb_execution_mode = "off"  # docs/notebooks.py runs them
exclude_patterns = ["build", "jupyter_execute"]
html_theme = "furo"
html_title = "DART-HAL"
html_static_path = ["_static"]
html_css_files = ["dart.css"]
myst_enable_extensions = ["colon_fence", "attrs_inline"]
myst_heading_anchors = 3
autodoc_mock_imports = api_pages.missing()
autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
python_maximum_signature_line_length = 80
toc_object_entries = False
suppress_warnings = ["ref.python"]  # rooms have types of the same name

HARDWARE = re.compile(r"\]\((?:\.\./)+hardware/README\.md(?=[#)])")


def flasher(app, failure):
    """The page that flashes a Nano, as files under flash/, with the prebuilt image."""
    if failure is None and app.builder.format == "html":
        folder = Path(app.outdir) / "flash"
        folder.mkdir(exist_ok=True)
        image = HERE.parent / "firmware" / "prebuilt" / "dart_nano.hex"
        for name, body in load_flash_assets(image).items():
            (folder / name).write_bytes(body)


def setup(app):
    """In the handbook reference/hardware.md stands for hardware/README.md, which it includes."""
    def hardware_page(app, page, source):
        here = os.path.relpath("reference/hardware.md", os.path.dirname(page) or ".")
        source[0] = HARDWARE.sub(f"]({here}", source[0])

    app.connect("source-read", hardware_page)
    app.connect("build-finished", flasher)
    api_pages.connect(app, HERE, [Path(p.__file__).parent for p in (dart_hal, dart_lab)])
    recorded_run.connect(app)
