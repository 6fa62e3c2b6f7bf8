"""What the measuring `calibrate` verbs ask, print and write."""

from __future__ import annotations

import json
import math

import pytest

from dart_hal.cli.bench import AskedWorkshop, agreed
from dart_hal.errors import CalibrationFailed

ENCODER = ("calibrate", "encoder", "--url", "sim://?seed=4&nano=mock", "--distance", "1",
           "--runs", "1", "--json")


def test_typed_answers_become_si_units():
    answers = iter([3.012, 1080.0, 1.67, 0.9, 0.77])
    calls = []
    shop = AskedWorkshop(lambda: calls.append("pause"), lambda: calls.append("resume"),
                         lambda question: next(answers))
    assert shop.distance() == 3.012
    assert shop.turns() == pytest.approx(6.0 * math.pi)
    assert shop.mass()[0] == 1.67
    assert shop.axle_loads()[:2] == (0.9, 0.77)
    assert calls == ["pause", "resume"] * 5


def test_without_a_terminal_nothing_starts(monkeypatch, tmp_path):
    with (tmp_path / "empty").open("w+") as nobody:
        monkeypatch.setattr("sys.stdin", nobody)
        with pytest.raises(CalibrationFailed, match="no terminal"):
            agreed("This drives.", yes=False)
        with pytest.raises(CalibrationFailed, match="no terminal"):
            AskedWorkshop().mark()
        with pytest.raises(CalibrationFailed, match="no terminal"):
            AskedWorkshop().distance()
        assert agreed("This drives.", yes=True)


@pytest.mark.more
@pytest.mark.parametrize("dry", [True, False])
def test_encoder_writes_unless_it_is_a_dry_run(verb, tmp_path, dry):
    result = verb(*ENCODER, "--cars", str(tmp_path), *(["--dry-run"] if dry else []))
    found = json.loads(result.out)
    assert set(found["quantities"]) == {"encoder.metres_per_edge", "encoder.ring"}
    assert found["quantities"]["encoder.metres_per_edge"]["unit"] == "m"
    assert len(found["quantities"]["encoder.ring"]["value"]) == 20
    files = list(tmp_path.rglob("calibration.toml"))
    assert [str(f) for f in files] == ([] if dry else [found["written"]])
