"""Which procedures `calibrate all` still has to run, and whether the floor is large enough."""

from __future__ import annotations

from datetime import datetime, timedelta, timezone

import pytest

from dart_hal.calibration import order
from dart_hal.config import Calibration, Quantity, load_car
from dart_hal.config.calibration import SteeringCalibration, SteeringTable
from dart_hal.errors import CalibrationFailed

NOW = datetime(2026, 11, 24, 12, 0, tzinfo=timezone.utc)


@pytest.fixture(scope="module")
def steps():
    return order.steps_of(load_car("dart-01", ["cars"]))


def measured(**minutes_ago: float) -> Calibration:
    """A calibration in which these verbs were run that long ago."""
    quantity = Quantity(1.0, 0.01)
    named = {"clock": ("pwm.oscillator_hz",), "encoder": ("encoder.metres_per_edge",),
             "imu": ("imu.gyro_scale", "imu.mount_yaw")}
    known = Calibration(car="dart-01", provenance={
        verb: {"when": NOW - timedelta(minutes=ago)} for verb, ago in minutes_ago.items()})
    for verb in minutes_ago:
        known = known.with_quantities(dict.fromkeys(named.get(verb, ()), quantity))
    if "steering" in minutes_ago:
        table = SteeringTable(pulse_us=(1.0, 2.0), angle_rad=(0.0, 1.0), std_rad=(0.1, 0.1))
        known = Calibration(**{**{f: getattr(known, f) for f in known.__struct_fields__},
                               "steering": SteeringCalibration(map=table)})
    return known


@pytest.mark.parametrize(("known", "left"), [
    (None, ("clock", "encoder", "imu", "steering")),
    (measured(clock=9, encoder=8, imu=7, steering=6), ()),
    (measured(clock=9, encoder=8), ("imu", "steering")),
    (measured(clock=9, encoder=3, imu=7, steering=6), ("imu", "steering")),  # by another travel
    (measured(encoder=8, imu=7, steering=6), ("clock",)),  # it can be missed, and was
    (measured(clock=5, encoder=8, imu=7, steering=6), ("encoder", "imu", "steering")),
    (measured(clock=999, encoder=998, imu=997, steering=6),
     ("clock", "encoder", "imu", "steering")),
])
def test_what_is_left(steps, known, left):
    assert tuple(s.verb for s in order.due(steps, known, NOW)) == left


def test_an_old_file_says_no_times_and_is_measured_anew(steps):
    known = measured(clock=9, encoder=8, imu=7, steering=6)
    old = Calibration(car=known.car, pwm=known.pwm, encoder=known.encoder, imu=known.imu,
                      steering=known.steering, provenance={"when": NOW})
    assert order.due(steps, old, NOW) == steps


def test_a_floor_that_is_too_small_names_what_has_no_room():
    files = load_car("dart-01", ["cars"])
    with pytest.raises(CalibrationFailed, match="too small for imu, steering") as refused:
        order.steps_of(files, (2.8, 2.0))
    assert "imu: 3.0 m x 2.5 m" in str(refused.value.expected)
    assert "--skip imu --skip steering" in str(refused.value.remedy)
    short = order.steps_of(files, (2.0, 2.0), ("imu", "steering"))
    assert [s.verb for s in short] == ["clock", "encoder"]
    assert "over 1.0 m" in short[1].plan
    assert "over 3.0 m" in order.steps_of(files, (9.0, 9.0))[1].plan
