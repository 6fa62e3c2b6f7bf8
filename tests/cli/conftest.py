"""Verbs run in this process: what they print, and how they exit."""

from __future__ import annotations

import json
from dataclasses import dataclass

import pytest

from dart_hal.cli.main import main


@dataclass
class Ran:
    """Exit code, standard output, standard error of one verb."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> dict:
        """The one JSON object on standard output."""
        assert self.out, self.err
        value, end = json.JSONDecoder().raw_decode(self.out)
        assert self.out[end:].strip() == "", "more than one object on standard output"
        assert isinstance(value, dict)
        return value

    @property
    def error(self) -> dict:
        """The error object of a verb that was refused."""
        assert self.code == 2, self.err
        assert set(self.json) == {"error"}
        error = self.json["error"]
        assert set(error) == {"code", "what", "found", "expected", "likely", "try", "read"}
        assert error["code"].startswith("D-")
        assert error["what"]
        assert error["try"]
        return error


@pytest.fixture
def verb(capsys, monkeypatch, tmp_path):
    """``verb("record", "--json", ...)`` in a folder of its own."""
    monkeypatch.chdir(tmp_path)

    def run(*args) -> Ran:
        capsys.readouterr()
        with pytest.raises(SystemExit) as left:
            main([str(a) for a in args])
        captured = capsys.readouterr()
        assert "Traceback" not in captured.out + captured.err
        return Ran(int(left.value.code or 0), captured.out, captured.err)

    return run
