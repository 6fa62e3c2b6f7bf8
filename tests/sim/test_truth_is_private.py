"""No package outside ``sim`` learns the truth: read from the sources, not from good will."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import dart_hal

ROOT = Path(dart_hal.__file__).parents[1]
ALLOWED = {f"dart_lab/{n}.py" for n in ("cli/sim", "cli/class", "cli/demo", "cli/view", "demo/map")}
SECRET = {f"dart_lab.sim.{n}" for n in (
    "truth", "marking", "sealed", "classroom", "room_truth", "hidden", "world", "drawn",
    "true_car", "lidar.maps", "lidar.params", "lidar.unit")}


WAYS = re.compile(r"\bsim\b|_world\b|world_of\b")
"""Every import and attribute that is looked for contains one of these words."""


def imported(nodes: list[ast.AST], package: str) -> set[str]:
    """Absolute names of all modules that nodes of a source may import, also inside functions."""
    names: set[str] = set()
    for node in nodes:
        if isinstance(node, ast.Import):
            names |= {a.name for a in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                head = package.split(".")[:len(package.split(".")) - node.level + 1]
                base = ".".join([*head, base] if base else head)
            names |= {base} | {f"{base}.{a.name}" for a in node.names}
    return names


def peeks(source: str, package: str = "dart_lab.diagnosis") -> list[str]:
    """What in a source reaches for the truth."""
    if not WAYS.search(source):  # most sources: parsing them all takes two seconds
        return []
    nodes = list(ast.walk(ast.parse(source)))
    found = sorted(imported(nodes, package) & SECRET)
    for node in nodes:
        if isinstance(node, ast.Attribute) and node.attr in ("_world", "world_of"):
            own = isinstance(node.value, ast.Name) and node.value.id == "self"
            found += [] if own else [f".{node.attr}"]
        if isinstance(node, ast.Constant) and node.value in (SECRET | {"_world"}):
            found.append(repr(node.value))
    return found


def test_no_other_package_reads_it():
    guilty = {}
    for path in sorted(ROOT.rglob("*.py")):
        name = path.relative_to(ROOT).as_posix()
        if name.startswith("dart_lab/sim/") or name in ALLOWED:
            continue
        package = ".".join(path.relative_to(ROOT).parent.parts)
        if found := peeks(path.read_text(encoding="utf-8"), package):
            guilty[name] = found
    assert guilty == {}


def test_the_test_would_see_a_peek():
    for source in ("from dart_lab.sim.truth import truth", "import dart_lab.sim.hidden as h",
                   "from dart_lab.sim import world", "from dart_lab.sim.lidar import maps",
                   "from ..sim import truth",
                   "def f(b):\n    from dart_lab.sim.world import World",
                   "def f(b): return b.link._world.car", "getattr(b.link, '_world')",
                   "import importlib\nimportlib.import_module('dart_lab.sim.truth')"):
        assert peeks(source), source
    assert peeks("from dart_lab.sim.backend import open_sim") == []


def test_importing_the_library_does_not_load_the_simulator():
    import subprocess
    import sys

    code = "import sys, dart_hal; print([m for m in sys.modules if m.startswith('dart_lab.sim')])"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"
