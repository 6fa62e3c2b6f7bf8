"""``--poses``: verbs that open a car take a source, keep its poses, and report what is wrong."""

from __future__ import annotations

import pytest

from dart_hal.recording.run import RunReader
from tests.common import KINEMATIC_URL


@pytest.fixture
def poses(tmp_path):
    path = tmp_path / "poses.csv"
    path.write_text("t,x,y,yaw\n" + "".join(f"{0.01 * k:.2f},1,2,0.5\n" for k in range(300)))
    return f"file://{path}"


def test_a_recorded_run_keeps_them(verb, poses, tmp_path):
    out = tmp_path / "run.mcap"
    assert verb("record", "--url", KINEMATIC_URL, "--poses", poses, "--duration", 0.5, "--out",
                out).code == 0
    assert {(p.x, p.y, p.yaw) for p in RunReader(out).poses()} == {(1.0, 2.0, 0.5)}


@pytest.mark.slow
def test_a_driven_run_keeps_them(verb, poses, tmp_path):
    out = tmp_path / "run.mcap"
    script = tmp_path / "drive.py"
    script.write_text("def control(state):\n    return 0.0, 0.1 * state.external.age\n")
    ran = verb("drive", script, "--url", KINEMATIC_URL, "--poses", poses, "--duration", 0.3,
               "--record", out,
               "--waive", "CALIBRATION_MISSING")
    assert ran.code == 0, ran.err
    assert len(list(RunReader(out).poses())) > 20


@pytest.mark.slow
def test_top_shows_where_the_car_is(verb, poses):
    ran = verb("top", "--url", KINEMATIC_URL, "--poses", poses, "--duration", 0.3)
    assert "TRACKING" in ran.out + ran.err


def find_check(ran):
    return next((c for c in ran.json["checks"] if c["id"] == "poses"), None)


@pytest.mark.slow
def test_the_doctor_looks_at_them(verb, poses):
    ran = ("doctor", "--url", KINEMATIC_URL, "--seconds", 1, "--json")
    good = find_check(verb(*ran, "--poses", poses))
    assert good["verdict"] == "ok"
    assert "frames, TRACKING, x +1.00 m y +2.00 m" in good["found"]
    silent = find_check(verb(*ran, "--poses", "vrpn://car@127.0.0.1:1"))
    assert silent["verdict"] == "warn"
    assert "refused" in silent["found"]
    missing = find_check(verb(*ran, "--poses", "file:///no/such.csv"))
    assert missing["verdict"] == "fail"
    assert find_check(verb(*ran)) is None
    assert verb(*ran, "--poses", "ftp://x").error["code"]
