"""``calibrate clock``: the oscillator of the PCA9685, which sets the length of every pulse.

The spare channel of the PCA9685 is wired to the input capture of the Nano (D8), which stamps the
rises with a resolution of 0.5 us. The resonator of the Nano is accurate to 0.5 % only. The stamps
are therefore converted to seconds of the host, whose crystal is the reference. Without the wire,
the user enters a frequency that was measured with an instrument.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from dart_hal.core.config import CarFiles, Quantity
from dart_hal.core.config.ranges import MAX_CLOCK_STD, OSCILLATOR_HZ
from dart_hal.core.errors import CalibrationFailed, UsageError
from dart_hal.core.types import INTERVAL_90, FloatArray
from dart_hal.devices.actuation.quantiser import COUNTS_PER_FRAME, NOMINAL_HZ, counter_of
from dart_hal.wire.messages import TICKS_PER_SECOND

from .measured import FitGraph, Measured, list_outdated
from .procedure import Bench, Condition, Option, Procedure, ProcedurePlan
from .runner import driving
from .sensor_log import SensorLog

# PWM periods of one capture, the most that the firmware accepts, and number of captures: 10 s, over
# which host and device time agree within 2e-5.
CLOCK_PERIODS = 250
CLOCK_CAPTURES = 2
# s for one capture: timeout of the Nano, and transfer of the answer.
CLOCK_CAPTURE_WAIT = 0.1 + 0.025 * CLOCK_PERIODS + 0.5
# Relative, one sigma of the host's crystal: boards are specified with 50 ppm.
HOST_CRYSTAL_STD = 5e-5
# s, one sigma of a rise: the capture's step of 0.5 us and its noise canceller.
RISE_STD = 1e-6
# Relative, one sigma of an oscillator that was never measured: chips are at 24 to 27 MHz.
UNMEASURED_CLOCK_STD = 0.04
# us, of the picture of a typed frequency: the pulses of servo and ESC.
PULSE_WIDTHS_US = np.arange(1000.0, 2001.0, 100.0)
# Relative change that outdates a steering map: 1.5 us of 1500, a third of the PCA9685's count.
MAX_CLOCK_CHANGE = 1e-3


def plan(files: CarFiles, frequency: float | None = None, std: float | None = None
         ) -> ProcedurePlan | None:
    """Describe what ``measure`` does; None if the frequency was measured with an instrument."""
    if frequency is not None:
        return None
    return ProcedurePlan(
        f"times {CLOCK_CAPTURES * CLOCK_PERIODS} pulses of the PCA9685's channel "
        f"{files.config.pwm.clock_channel} to measure its oscillator; the throttle stays "
        "neutral: about 17 s, no floor, a wire from that channel to D8 of the Nano", 17.0)


def measure(bench: Bench, frequency: float | None = None, std: float | None = None) -> Measured:
    """Measure the oscillator [Hz], or compute it from a typed PWM frequency and its std [Hz].

    Raises CalibrationFailed without the wire (with the alternative), LinkLost, NotArmed.
    """
    car = bench.car
    files = bench.files
    if frequency is not None and std is not None:
        return typed_clock(files, frequency, std, bench.source)
    log = SensorLog(car)
    try:
        with driving(car) as runner:
            car.clock_pulse(True)
            center = files.config.steering.center_us
            runner.hold(0.1, center, 0.0)
            car.answers("CAPTURE")
            log.take()
            periods = []
            states = []
            for k in range(CLOCK_CAPTURES):
                bench.progress(0.1 + 0.9 * k / CLOCK_CAPTURES, f"timing {CLOCK_PERIODS} pulses")
                car.request("CAPTURE_REQ", frames=CLOCK_PERIODS)
                states += runner.hold(CLOCK_CAPTURE_WAIT, center, 0.0)
                periods.append(_read_period(car.answers("CAPTURE")))
            rate = log.device_rate()
            seconds = states[-1].t - states[0].t
            rate_std = math.sqrt(2.0) * states[-1].health.t_std / seconds
    finally:
        car.clock_pulse(False)
    period = float(np.mean(periods)) * rate
    hertz = COUNTS_PER_FRAME * (counter_of(files)[0] + 1) / period
    # Errors: clock fit, crystal of the host, stamps of the first and the last rise.
    stamps = RISE_STD * math.sqrt(2.0 / CLOCK_CAPTURES) / (CLOCK_PERIODS * period)
    relative = math.hypot(rate_std, HOST_CRYSTAL_STD, stamps)
    found = Quantity(hertz, hertz * relative,
                     f"spare channel into D8, {CLOCK_CAPTURES * CLOCK_PERIODS} periods")
    difference = 100.0 * (1.0 / rate - 1.0)
    result = _make_result(files, bench.source, found, "the Nano's clock differs from the host's by "
                          f"{difference:+.3f} %, corrected", seconds)
    return replace(result, graph=_graph_periods(np.array(periods) * rate, found,
                                                counter_of(files)[0]))


def _graph_periods(periods: FloatArray, hertz: Quantity, prescale: int) -> FitGraph:
    """Return how much later than by the nominal clock the pulses of each capture are."""
    counts = COUNTS_PER_FRAME * (prescale + 1)
    pulses = CLOCK_PERIODS * np.arange(len(periods) + 1.0)
    behind = CLOCK_PERIODS * np.cumsum(np.append(0.0, periods - counts / NOMINAL_HZ))
    late = counts / hertz.value - counts / NOMINAL_HZ
    half = INTERVAL_90 * counts / hertz.value * hertz.std / hertz.value
    return FitGraph("Pulses of this board against those of a nominal 25 MHz clock",
                    "pulses counted", "later by [ms]", pulses, 1e3 * behind, pulses,
                    1e3 * late * pulses, 1e3 * half * pulses)


def typed_clock(files: CarFiles, frequency: float, std: float, source: str = "") -> Measured:
    """Compute the oscillator from a PWM frequency [Hz] of an instrument, with its one sigma.

    Raises CalibrationFailed for a frequency that no PCA9685 has.
    """
    counts = COUNTS_PER_FRAME * (counter_of(files)[0] + 1)
    found = Quantity(frequency * counts, std * counts, f"{frequency:.4f} Hz measured, typed")
    result = _make_result(files, source, found,
                          f"as typed: {frequency:.4f} +- {std:.2g} Hz of PWM", 0.0)
    return replace(result, graph=_graph_pulses(found, _previous_clock(files)))


def _graph_pulses(hertz: Quantity, previous: float) -> FitGraph:
    """Return the error of pulses by the previous clock [Hz], and by the new one with its interval.

    The PCA9685 counts w previous / 1e6 periods for a pulse of w us. They last w previous / hertz.
    """
    error = PULSE_WIDTHS_US * (previous / hertz.value - 1.0)
    middle = float(np.interp(1500.0, PULSE_WIDTHS_US, error))
    return FitGraph(
        f"So far a pulse of 1500 us was {abs(middle):.1f} us too "
        f"{'short' if middle < 0.0 else 'long'}", "requested pulse [us]", "error of the pulse [us]",
        PULSE_WIDTHS_US, error, PULSE_WIDTHS_US, 0.0 * PULSE_WIDTHS_US,
        INTERVAL_90 * PULSE_WIDTHS_US * hertz.std / hertz.value,
        points_name=f"so far, with {previous / 1e6:.2f} MHz",
        curve_name=f"with {hertz.value / 1e6:.2f} MHz, 90 % interval")


def _previous_clock(files: CarFiles) -> float:
    """Return the oscillator [Hz] by which pulses are made so far."""
    return files.oscillator_hz.value if files.oscillator_hz else NOMINAL_HZ


def _read_period(answers: list[dict[str, Any]]) -> float:
    """Compute the PWM period [s of the device]. Raises CalibrationFailed for too few periods."""
    captured = answers[-1] if answers else {}
    frames = captured.get("frames", 0)
    if frames >= CLOCK_PERIODS:
        ticks = (captured["last_rise"] - captured["first_rise"]) % (1 << 32)
        return float(ticks / TICKS_PER_SECOND / frames)
    raise CalibrationFailed(
        "the Nano does not receive the PCA9685's pulses", found=f"{frames} periods at D8",
        expected=f"{CLOCK_PERIODS}",
        likely="no wire from the spare channel to D8; the oscillator is then known only to "
               f"{UNMEASURED_CLOCK_STD:.0%}",
        remedy="connect the wire; or measure the PWM frequency of any channel with a scope or a "
               "logic analyser: dart-hal calibrate clock --frequency 50.21 --std 0.01")


def _make_result(files: CarFiles, source: str, hertz: Quantity, residual: str, duration: float
                 ) -> Measured:
    """Check the frequency and make the result. Raises CalibrationFailed."""
    low, high = OSCILLATOR_HZ
    if not (low <= hertz.value <= high and np.isfinite(hertz.std) and hertz.std > 0.0):
        raise CalibrationFailed(
            "no PCA9685 has such an oscillator", found=f"{hertz.value:.0f} Hz",
            expected=f"{low:.3g} to {high:.3g} Hz",
            likely=f"another PWM frequency than {files.config.pwm.frequency} Hz was measured, or "
                   "something else is wired to D8",
            remedy="[pwm] frequency in car.toml; the PWM frequency is pulses per second")
    if hertz.std > MAX_CLOCK_STD * hertz.value:
        raise CalibrationFailed(
            "the standard error of the oscillator is too large",
            found=f"{hertz.value:.0f} +- {hertz.std:.0f} Hz, {hertz.std / hertz.value:.1%}",
            expected=f"at most {MAX_CLOCK_STD:.1%}: 7.5 us of a pulse of 1500 us",
            remedy="measure more periods with an instrument that has a crystal; --std is its error "
                   "in Hz")
    before = _previous_clock(files)
    notes = (f"a pulse of 1500 us by the nominal clock lasts "
             f"{1500.0 * NOMINAL_HZ / hertz.value:.1f} us",
             *list_outdated(files, abs(hertz.value / before - 1.0) > MAX_CLOCK_CHANGE,
                           f"{before:.0f} Hz", "esc", "throttle", "steering", "latency"))
    return Measured(files.config.name, source or files.config.name, "clock",
                    {"pwm.oscillator_hz": hertz}, residual, duration, notes)


def _check_typed(frequency: float | None = None, std: float | None = None) -> None:
    if (frequency is None) != (std is None):
        raise UsageError("a measured frequency needs its standard error",
                         found="--frequency or --std alone", expected="both",
                         remedy="--frequency 50.21 --std 0.01")


calibrate_clock = Procedure(
    name="clock",
    help="""The oscillator of the PCA9685, which sets the length of every pulse.

    The Nano times the pulses of the spare channel, by a wire to its D8. Without it: --frequency and
    --std of a scope.
    """,
    plan=plan, measure=measure, condition=Condition.WIRED,
    options=(
        Option("frequency", "PWM frequency of any channel, measured with an instrument; the car "
               "measures nothing", None, "Hz", 20.0, 400.0, metavar="HZ"),
        Option("std", "its one sigma", None, "Hz", 0.0, 10.0, metavar="HZ", above_low=True)),
    check=_check_typed, keys=("pwm.oscillator_hz",), optional=True)
