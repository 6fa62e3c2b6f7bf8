"""The examples in the docstrings of Car, Fleet and Recorder run as they are printed."""

from __future__ import annotations

import doctest
import inspect

import pytest

from dart_hal import Car, Fleet
from dart_hal.car.recorder import Recorder

EXAMPLE_URLS = ["sim://?nano=mock&seed=1", "sim://?nano=mock&seed=2"]


def public_members(cls: type) -> dict[str, str | None]:
    """Docstrings of what the class itself defines for its users, by name."""
    return {name: inspect.getdoc(getattr(member, "__func__", member))
            for name, member in vars(cls).items()
            if not name.startswith("_") and (callable(member) or isinstance(
                member, property | classmethod))}


MEMBERS = [(cls, name) for cls in (Car, Fleet, Recorder) for name in public_members(cls)]


@pytest.mark.parametrize(("cls", "name"), MEMBERS, ids=lambda v: getattr(v, "__name__", v))
def test_an_example_runs(cls, name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = public_members(cls)[name]
    assert text, f"{cls.__name__}.{name} has no docstring"
    example = doctest.DocTestParser().get_doctest(text, {"Car": Car, "Fleet": Fleet}, name, None, 0)
    assert example.examples, f"{cls.__name__}.{name} has no example"
    opened = Fleet.open(EXAMPLE_URLS) if cls is Fleet else Car.open(EXAMPLE_URLS[0])
    example.globs["fleet" if cls is Fleet else "car"] = opened
    output: list[str] = []
    with opened:
        doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(
            example, out=output.append, clear_globs=False)
    assert not output, "".join(output)


@pytest.mark.parametrize(("cls", "name"), MEMBERS, ids=lambda v: getattr(v, "__name__", v))
def test_every_parameter_is_described(cls, name):
    """In the section Args, with its name; those of ``over`` are those of ``open``."""
    member = vars(cls)[name]
    if isinstance(member, property) or (cls, name) == (Car, "over"):
        return
    text = public_members(cls)[name]
    parameters = list(inspect.signature(getattr(member, "__func__", member)).parameters)[1:]
    assert [p for p in parameters if f"\n    {p}: " not in text] == []
