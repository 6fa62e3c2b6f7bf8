"""The demo from its first word to its page, with a diagnosis made by hand.

The demo of an installed wheel makes one, and the chapter on the lidar.
"""

from __future__ import annotations

import json

import pytest

from dart_hal.cli.main import main
from dart_lab.demo.section import real_skipped
from tests.diagnosis import made_by_hand as made


@pytest.mark.slow
def test_the_demo_drives_calibrates_and_writes_its_page(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("dart_lab.demo.real.find_excerpt", lambda: None)
    monkeypatch.setattr("dart_lab.demo.map.section", lambda *_: (real_skipped(), {"skipped": "x"}))
    monkeypatch.setattr("dart_lab.cli.demo.LAPS", 1)
    monkeypatch.setattr("dart_lab.diagnosis.inputs._check_duration", lambda *_: None)
    for name in ("FIRST_DRIVE_S", "SECOND_DRIVE_S", "THIRD_DRIVE_S"):
        monkeypatch.setattr(f"dart_lab.demo.diagnosis.{name}", 10.0)
    monkeypatch.setattr("dart_lab.demo.diagnosis.diagnose", lambda *_, **__: made.diagnosis())
    # in this process, where what was replaced is replaced
    monkeypatch.setattr("dart_hal.core.process.jobs.start_in_background",
                        lambda work, *given: iter([work(*given)]))
    out = tmp_path / "demo"
    with pytest.raises(SystemExit) as ended:
        main(["demo", "--url", "sim://?seed=7&nano=mock&effect=steering_lag:0.12", "--out",
              str(out), "--json"])
    captured = capsys.readouterr()
    assert not ended.value.code, captured.err
    result = json.loads(captured.out)
    assert 0 < result["summary"]["steering_rms_deg"] < 0.5
    assert result["summary"]["diagnosis"]["named"] is True
    assert all((tmp_path / path).stat().st_size > 0 for path in result["files"].values())
    page = (out / "index.html").read_text(encoding="utf-8")
    assert "steering_lag" in page
    assert "diagnosis.html" in page
