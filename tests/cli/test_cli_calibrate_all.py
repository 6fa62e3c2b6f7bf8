"""`calibrate all`: in order, each written as it ends, and gone on with where it was left."""

from __future__ import annotations

import pytest

from dart_hal.calibration import order
from dart_hal.calibration.measured import Measured
from dart_hal.core.config import Quantity
from dart_hal.core.errors import CalibrationFailed
from tests.common import MOCK_4_URL

MEASURED_VALUES = {"pwm.oscillator_hz": 25.5e6, "encoder.metres_per_edge": 2e-3,
                   "imu.gyro_scale": 1.0}
ALL_COMMAND = ("calibrate", "all", "--url", MOCK_4_URL, "--json")


@pytest.fixture
def by_hand(monkeypatch):
    """Procedures that measure at once; ``broken`` ones fail. Returns (broken, what was run)."""
    broken = set()
    ran = []

    def make_procedure(verb, keys):
        def run(car, workshop, progress, ask):
            cal = car.files.calibration
            ran.append((verb, sorted(cal.provenance) if cal else []))
            if verb in broken:
                raise CalibrationFailed(f"{verb} is broken", remedy="repair it")
            return Measured(car.files.config.name, car.url, verb,
                            {key: Quantity(MEASURED_VALUES[key], 1e-6) for key in keys}, "well",
                            2.0)
        return run

    step = order.ProcedureStep
    encoder_key = "encoder.metres_per_edge"
    steps = (step("clock", "times", make_procedure("clock", ["pwm.oscillator_hz"]),
                  ("pwm.oscillator_hz",), optional=True),
             step("encoder", "rolls", make_procedure("encoder", [encoder_key]), (encoder_key,),
                  ("clock",)),
             step("imu", "turns", make_procedure("imu", ["imu.gyro_scale"]), ("imu.gyro_scale",),
                  ("encoder",)))
    monkeypatch.setattr(order, "make_steps", lambda *_: steps)
    return broken, ran


@pytest.mark.slow
def test_each_finds_what_the_one_before_wrote(verb, tmp_path, by_hand):
    _, ran = by_hand
    done = verb(*ALL_COMMAND, "--cars", tmp_path).json
    assert ran == [("clock", []), ("encoder", ["clock", "when"]),
                   ("imu", ["clock", "encoder", "when"])]
    assert list(done["found"]) == ["clock", "encoder", "imu"]
    assert done["duration_s"] == 6.0
    assert verb(*ALL_COMMAND, "--cars", tmp_path).json["found"] == {}      # all of it is there
    assert list(verb(*ALL_COMMAND, "--cars", tmp_path,
                     "--again").json["found"]) == list(done["found"])


@pytest.mark.slow
def test_it_goes_on_where_it_was_left(verb, tmp_path, by_hand):
    broken, ran = by_hand
    broken.add("encoder")
    failed = verb(*ALL_COMMAND, "--cars", tmp_path)
    assert failed.code == 2
    assert failed.error["what"] == "encoder is broken"
    assert "goes on here" in failed.err
    assert [v for v, _ in ran] == ["clock", "encoder"]
    broken.clear()
    assert list(verb(*ALL_COMMAND, "--cars", tmp_path).json["found"]) == ["encoder", "imu"]


@pytest.mark.slow
def test_what_is_optional_is_reported_and_skipped(verb, tmp_path, by_hand):
    by_hand[0].add("clock")
    done = verb(*ALL_COMMAND, "--cars", tmp_path)
    assert list(done.json["found"]) == ["encoder", "imu"]
    assert "clock not measured: clock is broken; repair it" in done.err


@pytest.mark.slow
def test_a_dry_run_writes_nothing_and_still_hands_on(verb, tmp_path, by_hand):
    done = verb(*ALL_COMMAND, "--cars", tmp_path, "--dry-run").json
    assert by_hand[1][2] == ("imu", ["clock", "encoder", "when"])
    assert {f["written"] for f in done["found"].values()} == {None}
    assert not list(tmp_path.rglob("calibration.toml"))


@pytest.mark.slow
def test_a_hidden_car_is_measured_within_ten_minutes(verb, tmp_path):
    done = verb(*ALL_COMMAND, "--cars", tmp_path, "--floor", "9", "9")
    expected = [name for name in order.PROCEDURE_NAMES if name not in ("mocap", "lidar")]
    assert list(done.json["found"]) == expected
    assert done.json["duration_s"] < 600.0
    true = verb("sim", "--reveal", "--url", MOCK_4_URL, "--json").json["sensors"]
    found = [(q["value"] - true[name]) / q["std"] for result in done.json["found"].values()
             for name, q in result.get("quantities", {}).items() if name != "encoder.ring"]
    assert len(found) >= 19
    assert max(map(abs, found)) < 4.0
