"""`fit_yaw` on a servo of known delay, measured by a gyro whose clock is not the Nano's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from dart_hal.calibration.latency import STAIRS, STAIRS_SPEED
from dart_hal.calibration.latency_fit import YAW_RATE_STD, fit_yaw, load_linkage
from dart_hal.calibration.latency_log import PwmGrid, Traffic, TrafficFrame
from dart_hal.estimation.imu_clock import AGE_STD, DEFAULT_GYRO_READ, MIN_GYRO_READ_TIME, PERIOD
from dart_lab.sim.servo import HORN_RAD_PER_US, ServoParams, SteeringServo

DELAY, PLAY, SLEW, EDGE = 0.0137, 0.03, 4200.0, 0.0021
FRAMES = PwmGrid(0.003, 0.0204, 1e-3, 3e-4, 1e-4, measured=True)
STEP = 1e-4


def driven(files, age, looks, seed=0):
    """Traffic of one round of stairs, of a gyro whose samples are ``age(t)`` s old when read."""
    rng = np.random.default_rng(seed)
    span, center = files.config.steering.span_us, files.config.steering.center_us
    commands = (STAIRS[-1], *STAIRS, STAIRS[0])
    begins = np.cumsum(rng.uniform(0.4, 0.46, len(commands)))
    t = np.arange(0.0, begins[-1] + 0.5, 0.01)
    pulse = center + span * np.array(commands)[
        np.maximum(np.searchsorted(begins, t, side="right") - 1, 0)]
    ends, widths = FRAMES.pulses(t, pulse)
    servo = SteeringServo(ServoParams(delay=DELAY, backlash=PLAY, rate=SLEW * HORN_RAD_PER_US))
    fine, waiting = np.arange(0.0, t[-1], STEP), list(zip(ends, widths, strict=True))
    angle = np.zeros(len(fine))
    for k, now in enumerate(fine):
        while waiting and waiting[0][0] <= now:
            servo.pulse((waiting[0][0] - 1e-6 * waiting[0][1], waiting[0][0]))
            waiting.pop(0)
        angle[k] = servo.move(now, STEP)
    yaw = STAIRS_SPEED * np.tan(angle) / files.config.geometry.wheelbase
    for late in (0.0062, 1.0 / (2.0 * np.pi * 32.0)):   # the paper's tyres, the gyro
        share = -np.expm1(-STEP / late)
        yaw = lfilter([share], [1.0, share - 1.0], yaw)
    measured = np.interp(t - age(t), fine, yaw) + rng.normal(0.0, 0.5 * YAW_RATE_STD, len(t))
    read_t = t - age(t) + 0.5 * PERIOD if looks else t
    edges = np.floor(STAIRS_SPEED * t / EDGE)
    std = np.full(len(t), 1e-4 if looks else AGE_STD)
    columns = {"t": t, "ticks": edges, "edge_t": edges * EDGE / STAIRS_SPEED, "yaw_rate": measured,
               "yaw_t": read_t, "age_std": std}
    rows = np.column_stack([columns.get(name, np.zeros(len(t))) for name in TrafficFrame._fields])
    return Traffic(np.column_stack([t, pulse, np.full(len(t), 1500.0)]), rows, 1e-3)


def found(files, age, looks):
    """Delay of a linkage with an unmeasured backlash."""
    return fit_yaw(FRAMES, driven(files, age, looks), load_linkage(files), STAIRS_SPEED, EDGE,
                   20).delay


@pytest.mark.parametrize("age", [1e-3, 9e-3])
@pytest.mark.slow
def test_register_reads_show_the_age_although_the_clocks_are_in_step(files, age):
    """For any age, and for any play of the linkage: steps that go on do not cross it."""
    delay, std = found(files, lambda t: np.full(len(t), age), True)
    assert delay - MIN_GYRO_READ_TIME == pytest.approx(DELAY, abs=1e-3)
    assert std < 1e-3


@pytest.mark.slow
def test_without_looks_the_interval_is_as_wide_as_the_age(files):
    delay, std = found(files, lambda t: np.full(len(t), 9.5e-3), False)
    assert std > AGE_STD
    assert 2.0e-3 < abs(delay - DELAY) < 1.645 * std


@pytest.mark.parametrize(("slot", "seconds"), [
    (np.nan, DEFAULT_GYRO_READ[0]), (5.26e-3, 2.43e-3), (1e-3, MIN_GYRO_READ_TIME)])
def test_the_firmware_reports_the_duration_of_a_read(slot, seconds):
    """By the emulated chip, of 180 us a byte: a sample is up to 3.28 ms younger than the begin of
    its read, and DIAG reports 5.26 ms; or of no stretching."""
    nothing = np.zeros((0, 0))
    assert Traffic(nothing, nothing, slot).read_delay[0] == pytest.approx(seconds, abs=1e-4)
