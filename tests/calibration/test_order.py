"""Which procedures `calibrate all` still has to run, and whether the floor is large enough."""

from __future__ import annotations

from datetime import datetime, timedelta, timezone

import pytest
from msgspec.structs import replace

from dart_hal.calibration import order
from dart_hal.core.config import Calibration, DriveTable, Quantity, load_car
from dart_hal.core.config.calibration import SteeringCalibration, SteeringTable
from dart_hal.core.errors import CalibrationFailed

NOW = datetime(2026, 11, 24, 12, 0, tzinfo=timezone.utc)


@pytest.fixture(scope="module")
def steps():
    return order.make_steps(load_car("dart-01", ["cars"]))


def measured(**minutes_ago: float) -> Calibration:
    """A calibration in which these verbs were run that long ago."""
    quantity = Quantity(1.0, 0.01)
    named = {"clock": ("pwm.oscillator_hz",),
             "esc": ("throttle.neutral_us", "throttle.deadband_forward_us"),
             "encoder": ("encoder.metres_per_edge",),
             "imu": ("imu.gyro_scale", "imu.mount_yaw"),
             "latency": ("latency.pulse_to_wheel", "latency.pulse_to_yaw",
                         "latency.sensor_to_host")}
    known = Calibration(car="dart-01", provenance={
        verb: {"when": NOW - timedelta(minutes=ago)} for verb, ago in minutes_ago.items()})
    for verb in minutes_ago:
        known = known.with_quantities(dict.fromkeys(named.get(verb, ()), quantity))
    if "throttle" in minutes_ago:
        drive = DriveTable(speed=(0.3, 0.6), pulse_us=(1580.0, 1590.0), std_us=(0.5, 0.5))
        known = replace(known, throttle=replace(known.throttle, drive=drive))
    if "steering" in minutes_ago:
        table = SteeringTable(pulse_us=(1.0, 2.0), angle_rad=(0.0, 1.0), std_rad=(0.1, 0.1))
        known = replace(known, steering=SteeringCalibration(map=table))
    return known


ALL = ("clock", "esc", "encoder", "throttle", "imu", "steering", "latency")
DONE = {"clock": 9, "esc": 8.5, "encoder": 8, "throttle": 7.5, "imu": 7, "steering": 6,
        "latency": 5.5}


@pytest.mark.parametrize(("known", "left"), [
    (None, ALL),
    (measured(**DONE), ()),
    (measured(clock=9, esc=8.5, encoder=8), ALL[3:]),
    (measured(**{**DONE, "encoder": 3}), ALL[3:]),                          # by another travel
    (measured(**{**DONE, "esc": 3}), ("throttle", "latency")),              # by another neutral
    (measured(**{**DONE, "steering": 3}), ("latency",)),                    # by another backlash
    (measured(**{k: v for k, v in DONE.items() if k != "latency"}), ("latency",)),
    (measured(**{k: v for k, v in DONE.items() if k != "clock"}), ("clock",)),  # may be missed
    (measured(**{**DONE, "clock": 5}), ALL[1:]),
    (measured(**{k: 991 + v if v > 6 else v for k, v in DONE.items()}), ALL),
])
def test_what_is_left(steps, known, left):
    assert tuple(s.verb for s in order.due(steps, known, NOW)) == left


def test_an_old_file_without_times_is_measured_again(steps):
    old = replace(measured(**DONE), provenance={"when": NOW})
    assert order.due(steps, old, NOW) == steps


def test_a_floor_that_is_too_small_names_what_has_no_room():
    files = load_car("dart-01", ["cars"])
    with pytest.raises(CalibrationFailed, match="too small for imu, steering, latency") as refused:
        order.make_steps(files, (2.8, 2.0))
    assert "imu: 3.0 m x 2.5 m" in str(refused.value.expected)
    assert "--skip imu --skip steering --skip latency" in str(refused.value.remedy)
    short = order.make_steps(files, (2.0, 2.0), ALL[3:])
    assert [s.verb for s in short] == ["clock", "esc", "encoder"]
    assert "over 1.0 m" in short[2].plan
    assert "over 3.0 m" in order.make_steps(files, (9.0, 9.0))[2].plan


@pytest.mark.parametrize(("floor", "how"), [((2.8, 9.0), "straight"), ((4.0, 1.2), "straight")])
def test_the_throttle_is_measured_straight_where_there_is_room(floor, how):
    steps = order.make_steps(load_car("dart-01", ["cars"]), floor, ("encoder", *ALL[4:]))
    assert how in steps[-1].plan


def test_without_room_for_either_the_throttle_is_refused():
    with pytest.raises(CalibrationFailed, match="too small for throttle"):
        order.make_steps(load_car("dart-01", ["cars"]), (2.4, 2.4), ALL[4:])
