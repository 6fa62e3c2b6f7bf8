"""Measure how plainly the code is written, package by package.

    python tests/language/measure_language.py            print the figures
    python tests/language/measure_language.py --write    lower the budgets to what is measured

The figures are those in which this code differed most from well-known packages such as
python-control and Gymnasium:

- private words for each 1000 lines: words with a meaning of their own here (words.toml)
- participles: share of function names such as ``settled`` in place of ``is_settled`` [%]
- prepositions: functions and parameters that are named ``of``, ``at``, ``beside``, ...
- tuple assignments for each 1000 lines: ``a, b = 1, 2`` of unrelated values
- comment lines for each 1000 lines, of which more is better
- shared constants: names of constants that are defined in three files or more
- shared classes: share of class names that are defined in two files or more [%]
"""

from __future__ import annotations

import ast
import re
import sys
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import tomlkit

ROOT = Path(__file__).parents[2]
BUDGETS = Path(__file__).with_name("budgets.toml")
EXCLUDED = ("compat.py",)
"""Files that have to name what others were called before."""
WORDS = {key: frozenset(text.split()) for key, text in tomlkit.parse(
    Path(__file__).with_name("words.toml").read_text(encoding="utf-8")).unwrap().items()}
MEASURED = (ast.Module, ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef, ast.Assign,
            ast.AnnAssign, ast.Name, ast.Attribute, ast.arg, ast.Constant)
PARTICIPLE = re.compile(r"[a-z]+(ed|wn|lt|ft|pt|ught|ade|orn|aid|een)")


@dataclass(frozen=True)
class Figures:
    """What is measured of one package, per 1000 lines or in per cent."""

    private_words: float
    participles: float
    prepositions: float
    tuple_assignments: float
    comments: float


@dataclass(frozen=True)
class Shared:
    """What is measured of a whole tree: a number of constants, and classes [%]."""

    constants: float
    classes: float


def list_packages() -> dict[str, list[Path]]:
    """Return the Python files of each package of ``host``, and of the tests."""
    packages: dict[str, list[Path]] = defaultdict(list)
    for path in sorted((ROOT / "host").rglob("*.py")):
        inner = path.relative_to(ROOT / "host").parts
        if path.name not in EXCLUDED:
            packages[".".join(inner[:2]) if len(inner) > 2 else inner[0]].append(path)
    packages["tests"] = [path for path in sorted((ROOT / "tests").rglob("*.py"))
                         if path.parent != BUDGETS.parent]
    return dict(packages)


def is_participle(name: str) -> bool:
    """Return whether a function name is one word, and that word a participle."""
    word = name.strip("_")
    return word not in WORDS["no_participles"] and (
        word in WORDS["participles"] or PARTICIPLE.fullmatch(word) is not None)


@cache
def count_private_words(text: str) -> int:
    """Return how many words of a text or an identifier are private ones."""
    words = re.findall(r"[A-Z]?[a-z]+|[A-Z]+", text)
    return sum(word.lower() in WORDS["private"] for word in words)


def measure_package(texts: Iterable[str]) -> Figures:
    """Return the figures of a package of which these are the files."""
    lines = comments = functions = participles = prepositions = tuples = private = 0
    for text in texts:
        rows = [row.strip() for row in text.splitlines() if row.strip()]
        lines += len(rows)
        comments += sum(row.startswith("#") for row in rows)
        for node in list_nodes(text):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                functions += 1
                participles += is_participle(node.name)
                names = [node.name.strip("_"), *(one.arg for one in list_arguments(node))]
                prepositions += sum(name in WORDS["prepositions"] for name in names)
            elif isinstance(node, ast.Assign):
                tuples += isinstance(node.targets[0], ast.Tuple) and isinstance(
                    node.value, ast.Tuple)
            private += count_private_words(name_node(node))
    thousands = max(lines, 1) / 1000.0
    return Figures(private / thousands, 100.0 * participles / max(functions, 1), prepositions,
                   tuples / thousands, comments / thousands)


@cache
def list_nodes(text: str) -> list[ast.AST]:
    """Return the measured nodes of a file, its module first: two measurements need them."""
    return [node for node in ast.walk(ast.parse(text)) if isinstance(node, MEASURED)]


def list_arguments(function: ast.FunctionDef | ast.AsyncFunctionDef) -> list[ast.arg]:
    """Return the parameters of a function, but for ``*args`` and ``**kwargs``."""
    given = function.args
    return [*given.posonlyargs, *given.args, *given.kwonlyargs]


def name_node(node: ast.AST) -> str:
    """Return the identifier or the text of a syntax node; "" for any other node."""
    match node:
        case ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name) | ast.ClassDef(name=name):
            return name
        case ast.Name(id=name) | ast.Attribute(attr=name) | ast.arg(arg=name):
            return name
        case ast.Constant(value=str(text)) if " " in text:
            return text
    return ""


def measure_shared(paths: Iterable[Path]) -> Shared:
    """Return which constants and classes of a tree have one name and several meanings."""
    constants: dict[str, int] = defaultdict(int)
    classes: dict[str, int] = defaultdict(int)
    for path in paths:
        tree, *nodes = list_nodes(path.read_text(encoding="utf-8"))
        for name in {one.name for one in nodes if isinstance(one, ast.ClassDef)}:
            classes[name] += not name.startswith("_")
        targets = [target for one in tree.body if isinstance(one, ast.Assign | ast.AnnAssign)
                   for target in (one.targets if isinstance(one, ast.Assign) else [one.target])]
        for name in {part.id for target in targets for part in ast.walk(target)
                     if isinstance(part, ast.Name) and part.id.isupper()}:
            constants[name] += 1
    public = [count for count in classes.values() if count]
    return Shared(sum(count > 2 for count in constants.values()),
                  100.0 * sum(count > 1 for count in public) / max(len(public), 1))


def measure() -> dict[str, dict[str, float]]:
    """Return all figures, rounded to a tenth: by package, and of the two trees."""
    packages = list_packages()
    found = {name: vars(measure_package(path.read_text(encoding="utf-8") for path in paths))
             for name, paths in packages.items()}
    host = [path for name, paths in packages.items() if name != "tests" for path in paths]
    found["shared by host"] = vars(measure_shared(host))
    found["shared by tests"] = vars(measure_shared(packages["tests"]))
    return {name: {key: round(value, 1) for key, value in figures.items()}
            for name, figures in found.items()}


def read_budgets() -> dict[str, dict[str, float]]:
    """Return the worst allowed figures."""
    return tomlkit.parse(BUDGETS.read_text(encoding="utf-8")).unwrap()


def exceeds(key: str, figure: float, budget: float) -> bool:
    """Return whether a figure is worse than its budget."""
    return figure < budget if key == "comments" else figure > budget


def write_budgets(found: dict[str, dict[str, float]]) -> None:
    """Write what is measured, but no budget that is worse than the present one."""
    before = read_budgets() if BUDGETS.exists() else {}
    document = tomlkit.document()
    document.add(tomlkit.comment("Worst allowed figures: measure_language.py --write lowers them."))
    for name, figures in found.items():
        old = before.get(name, {})
        document[name] = {key: old[key] if key in old and exceeds(key, value, old[key]) else value
                          for key, value in figures.items()}
    BUDGETS.write_text(tomlkit.dumps(document), encoding="utf-8")


def main() -> int:
    """Print the figures, or write the budgets."""
    found = measure()
    if sys.argv[1:] == ["--write"]:
        write_budgets(found)
    for name, figures in found.items():
        print(f"{name:28}", "  ".join(f"{key} {value:g}" for key, value in figures.items()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
