"""Every script of the hardware folder describes what it does, and does nothing else then."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import pytest

sys.path[:0] = [str(Path(__file__).parents[2] / "hardware")]


@pytest.mark.parametrize("option", ["-h", "--help"])
@pytest.mark.parametrize("name", ["measured", "see_lidar"])
def test_help_is_the_text_of_the_script(name, option, monkeypatch, capsys):
    script = importlib.import_module(name)
    monkeypatch.setattr(sys, "argv", [f"{name}.py", option])
    assert script.main() == 0
    out, err = capsys.readouterr()
    assert out == script.__doc__
    assert err == ""
    assert f"python hardware/{name}.py" in out
