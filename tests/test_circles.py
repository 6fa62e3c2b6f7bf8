"""No circles: which file needs which is a tree that can be read from the bottom up.

The packages have contracts (test_layers.py). Here the scripts of
``hardware`` and the C files of the emulator, which those do not see.
"""

from __future__ import annotations

import ast
import graphlib
import re
from pathlib import Path

import pytest

from tests.common import ROOT

SCRIPTS = sorted(p for p in (ROOT / "hardware").rglob("*") if p.is_dir() and any(p.glob("*.py")))
EMULATOR = ROOT / "firmware" / "emulator"
Graph = dict[str, set[str]]


def circle(graph: Graph) -> list[str]:
    """Names along one circle, its first again at the end; [] = there is none."""
    try:
        graphlib.TopologicalSorter(graph).prepare()
    except graphlib.CycleError as error:
        return list(error.args[1])
    return []


def imports(folder: Path) -> Graph:
    """Python files of one folder that import each other, inside functions too."""
    files = {path.stem: path for path in folder.glob("*.py")}
    graph: Graph = {}
    for name, path in files.items():
        nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
        named = {a.name for n in nodes if isinstance(n, ast.Import) for a in n.names}
        named |= {n.module or "" for n in nodes if isinstance(n, ast.ImportFrom)}
        graph[name] = named & set(files) - {name}
    return graph


def code_of(path: Path) -> str:
    """C without comments and strings."""
    text = re.sub(r"/\*.*?\*/", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
    return re.sub(r'"(\\.|[^"\\])*"', "", text)


def uses(folder: Path) -> Graph:
    """C files of one folder that name each other's functions."""
    code = {path.name: code_of(path) for path in folder.glob("*.c")}
    home = {found[1]: name for name, text in code.items() for found in re.finditer(
        r"^(?!static)[a-z][\w \t*]*?\b(\w+)\([^;{}]*\)\s*\{", text, flags=re.MULTILINE)}
    return {name: {home[word] for word in re.findall(r"\w+", text) if word in home} - {name}
            for name, text in code.items()}


def includes(folder: Path) -> Graph:
    """Headers of one folder that include each other."""
    return {path.name: set(re.findall(r'^#include "(.+)"', path.read_text(encoding="utf-8"),
                                      flags=re.MULTILINE)) for path in folder.glob("*.h")}


@pytest.mark.parametrize("folder", [ROOT / "hardware", *SCRIPTS], ids=lambda p: p.name)
@pytest.mark.slow_except("wiring", "hardware")
def test_no_script_of_the_hardware_needs_itself(folder):
    assert circle(imports(folder)) == []


def test_no_c_file_of_the_emulator_needs_itself():
    graph = uses(EMULATOR)
    assert "base.c" in graph["emu.c"] & graph["uart.c"], "functions are found"
    assert circle(graph) == []
    assert circle(includes(EMULATOR)) == []


def test_a_circle_of_scripts_would_be_detected(tmp_path):
    (tmp_path / "rows.py").write_text("def page():\n    from pages import head\n    return head\n")
    (tmp_path / "pages.py").write_text("import shapes\nhead = ''\n")
    (tmp_path / "shapes.py").write_text("")
    assert circle(imports(tmp_path)) == []
    (tmp_path / "shapes.py").write_text("import math\nimport rows\n")
    assert set(circle(imports(tmp_path))) == {"rows", "pages", "shapes"}


@pytest.mark.parametrize("use", ["pins_show(0);", "notify = pins_show;"])
def test_a_circle_of_c_files_would_be_detected(tmp_path, use):
    (tmp_path / "pins.c").write_text("void pins_show(int bit)\n{\n\tlevel(bit);\n}\n")
    (tmp_path / "timer.c").write_text('int level(int bit)\n{\n\t/* pins_show() */ f("pins_show");'
                                      "\n\treturn bit;\n}\n")
    assert circle(uses(tmp_path)) == []
    (tmp_path / "timer.c").write_text(f"int level(int bit)\n{{\n\t{use}\n\treturn bit;\n}}\n")
    assert set(circle(uses(tmp_path))) == {"pins.c", "timer.c"}
    (tmp_path / "a.h").write_text('#include "b.h"\n')
    (tmp_path / "b.h").write_text('#include "a.h"\n')
    assert set(circle(includes(tmp_path))) == {"a.h", "b.h"}
