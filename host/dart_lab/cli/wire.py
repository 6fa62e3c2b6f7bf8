"""``dart-hal wire``: the frame table, and the files that are generated from the specification."""

from __future__ import annotations

from pathlib import Path

import click

from dart_hal.cli.common.options import json_option
from dart_hal.cli.common.output import console, output, print_json, results
from dart_hal.core.errors import UsageError
from dart_hal.wire import emit
from dart_hal.wire.messages import MESSAGES, PROTO, SCHEMA
from dart_lab.pages.effect_page import render_effects
from dart_lab.pages.error_page import render_errors
from dart_lab.pages.gate_page import render_gates
from dart_lab.pages.model_page import render_model_file
from dart_lab.pages.verb_page import render_verbs

# Generated pages of the handbook, and the functions that render them.
PAGES = {"docs/reference/errors.md": render_errors, "docs/reference/effects.md": render_effects,
         "docs/reference/gates.md": render_gates,
         "docs/reference/model_file.md": render_model_file,
         "docs/reference/verbs.md": render_verbs}
FORMATS = {"md": emit.render_markdown, "c": emit.render_header}


def find_checkout() -> Path:
    """Return the root of the source tree; raises UsageError in an installed package."""
    root = Path(__file__).resolve().parents[3]
    if not (root / "firmware").is_dir():
        raise UsageError("this needs a checkout of DART-HAL", found=str(root),
                         remedy="git clone the project and install it with pip install -e .")
    return root


@click.command("wire")
@click.option("--format", "form", type=click.Choice(sorted(FORMATS)), default="md",
              show_default=True, help="markdown table or C++ header")
@click.option("--write", is_flag=True, help="regenerate header, docs and golden vectors in place")
@click.option("--check", is_flag=True, help="exit 1 if a generated file differs")
@json_option
def command(form: str, write: bool, check: bool, as_json: bool) -> int:
    """Print the frame table that Nano and host share."""
    if check:
        root = find_checkout()
        # Names of all generated files that differ from what would be written now.
        stale = emit.list_stale(root)
        stale += [name for name, render in PAGES.items() if not (root / name).is_file()
                  or (root / name).read_text(encoding="utf-8") != render()]
        if as_json:
            print_json({"drift": stale})
        else:
            for path in stale:
                results.print(f"differs from the specification: {path}  (dart-hal wire --write)")
        return 1 if stale else 0
    if write:
        emit.write_all(find_checkout())
        for name, render in PAGES.items():
            (find_checkout() / name).write_text(render(), encoding="utf-8")
        console.print("header, docs and golden vectors are up to date")
        return 0
    if as_json:
        print_json({"proto": PROTO, "schema": f"{SCHEMA:08x}", "messages": [
            {"name": m.name, "id": m.id, "dir": m.dir, "payload": m.size, "wire": m.wire_size,
             "seed": f"{m.seed:04x}",
             "fields": [{"name": f.name, "type": f.type, "count": f.count, "scale": f.scale,
                         "unit": f.unit, "doc": f.doc} for f in m.fields]} for m in MESSAGES]})
    else:
        print(FORMATS[form](), file=output, flush=True)
    return 0
