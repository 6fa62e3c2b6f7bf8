"""Pages of the Python reference: one for each package, written anew at every build."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path

OPTIONAL = ("board", "busio", "casadi", "gymnasium", "matplotlib", "torch")
"""Extras that an environment may lack; a room that imports one is documented all the same."""
APART = ("cli",)  # rooms with a page of their own kind: the verbs
DIRECTIVE = re.compile(r"^\.\. \w+::|:math:`", re.MULTILINE)
CODE = re.compile(r"(``.+?``)", re.DOTALL)
BULLET = re.compile(r"(?:- |\* |\d+\. )")


def missing() -> list[str]:
    """Optional packages that are not installed here."""
    return [name for name in OPTIONAL if find_spec(name) is None]


def packages(root: Path) -> dict[str, list[str]]:
    """Package -> its modules, in the order of the tree; ``root`` is its folder."""
    found = {}
    for init in sorted(root.rglob("__init__.py")):
        parts = init.parent.relative_to(root).parts
        if parts[:1] not in [(name,) for name in APART]:
            names = sorted(p.stem for p in init.parent.glob("*.py") if not p.stem.startswith("_"))
            found[".".join((root.name, *parts))] = names
    return found


def write(roots: Sequence[Path], folder: Path) -> None:
    """Write ``folder``/<package>.rst for each package below some folders; delete all others."""
    folder.mkdir(parents=True, exist_ok=True)
    wanted = {f"{package}.rst": "\n".join(_page(package, modules))
              for root in roots for package, modules in packages(root).items()}
    for old in folder.glob("*.rst"):
        if old.name not in wanted:
            old.unlink()
    for name, text in wanted.items():
        path = folder / name
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def _page(package: str, modules: list[str]) -> Iterator[str]:
    yield from (package, "=" * len(package), "", f".. automodule:: {package}",
                "   :members:", "   :ignore-module-all:", "")
    for module in modules:
        yield from (module, "-" * len(module), "", f".. automodule:: {package}.{module}",
                    "   :members:", "   :ignore-module-all:", "")


def as_rst(lines: list[str]) -> None:
    """A docstring is plain text with ``code`` in it: nothing else of it is markup.

    An indented paragraph is a formula or a drawing and keeps its lines. One that
    uses directives itself is left as it is.
    """
    text = "\n".join(lines).strip("\n")
    if DIRECTIVE.search(text):
        return
    lines[:] = [line for part in re.split(r"\n\s*\n", text) for line in _paragraph(part)]


def _paragraph(part: str) -> list[str]:
    rows = part.split("\n")
    if BULLET.match(rows[0]) and all(r.startswith("  ") or BULLET.match(r) for r in rows):
        return [_escaped(r) for r in rows] + [""]
    if any(r[:1].isspace() for r in rows):
        return ["::", "", *("   " + r for r in rows), ""]
    return [*_escaped(part).split("\n"), ""]


def _escaped(text: str) -> str:
    pieces = [p if p.startswith("``") else re.sub(r"([\\*|_`])", r"\\\1", p)
              for p in CODE.split(text)]
    return "\\ ".join(pieces) if len(pieces) > 1 else pieces[0]


def connect(app: object, source: Path, roots: Sequence[Path]) -> None:
    """Write the pages before Sphinx looks for pages, and make docstrings harmless."""
    warnings.filterwarnings("ignore", category=SyntaxWarning)
    write(roots, source / "reference" / "api")
    app.connect("autodoc-process-docstring",  # type: ignore[attr-defined]
                lambda app, what, name, obj, options, lines: as_rst(lines))
