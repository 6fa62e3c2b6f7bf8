"""``calibrate clock``: the PCA9685's oscillator, by which every pulse is made.

The spare channel of the PCA9685 is wired to the input capture of the Nano (D8),
which stamps the rises in 0.5 us. Its resonator is no better than 0.5 %, so the
stamps are turned into seconds of the host, whose crystal is the reference.
Without the wire, a frequency that was measured with an instrument is taken.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from dart_hal.core.config import CarFiles, Quantity
from dart_hal.core.config.ranges import MAX_CLOCK_STD, OSCILLATOR_HZ
from dart_hal.core.errors import CalibrationFailed, UsageError
from dart_hal.devices.actuation.quantiser import COUNTS_PER_FRAME, NOMINAL_HZ, counter_of
from dart_hal.wire.messages import TICKS_PER_SECOND

from .measured import Measured, map_outdated
from .procedure import Bench, Condition, Option, Procedure, ProcedurePlan
from .runner import driving
from .sensor_log import SensorLog

PERIODS, CAPTURES = 250, 2
"""PWM periods of one capture, as many as the firmware takes, and captures one after the
other: 10 s, over which host and device time agree within 2e-5."""
WAIT = 0.1 + 0.025 * PERIODS + 0.5
"""s for one capture: what the Nano waits at most, and its turn on the line."""
CRYSTAL = 5e-5
"""Relative, one sigma of the host's crystal: 50 ppm is what boards are sold with."""
STAMP = 1e-6
"""s, one sigma of a rise: the capture's step of 0.5 us and its noise canceller."""
UNKNOWN = 0.04
"""Relative error of an oscillator that nobody measured: 24 to 27 MHz are seen."""
CHANGED = 1e-3
"""Relative; of a pulse of 1500 us it is 1.5 us, a third of the PCA9685's count."""


def plan(files: CarFiles, frequency: float | None = None, std: float | None = None
         ) -> ProcedurePlan | None:
    """Say what ``measure`` will do; None where the frequency was measured with an instrument."""
    if frequency is not None:
        return None
    return ProcedurePlan(
        f"times {CAPTURES * PERIODS} pulses of the PCA9685's channel "
        f"{files.config.pwm.clock_channel} to measure its oscillator; the throttle stays "
        "neutral: about 17 s, no floor, a wire from that channel to D8 of the Nano", 17.0)


def measure(bench: Bench, frequency: float | None = None, std: float | None = None) -> Measured:
    """Measure the oscillator [Hz], or take it from a typed PWM frequency and its one sigma [Hz].

    Errors: CalibrationFailed without the wire (with what to do instead), LinkLost, NotArmed.
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
            periods, states = [], []
            for k in range(CAPTURES):
                bench.progress(0.1 + 0.9 * k / CAPTURES, f"timing {PERIODS} pulses")
                car.request("CAPTURE_REQ", frames=PERIODS)
                states += runner.hold(WAIT, center, 0.0)
                periods.append(_period(car.answers("CAPTURE")))
            rate, seconds = log.device_rate(), states[-1].t - states[0].t
            rate_std = math.sqrt(2.0) * states[-1].health.t_std / seconds
    finally:
        car.clock_pulse(False)
    period = float(np.mean(periods)) * rate
    hertz = COUNTS_PER_FRAME * (counter_of(files)[0] + 1) / period
    stamps = STAMP * math.sqrt(2.0 / CAPTURES) / (PERIODS * period)
    relative = math.hypot(rate_std, CRYSTAL, stamps)
    found = Quantity(hertz, hertz * relative,
                     f"spare channel into D8, {CAPTURES * PERIODS} periods")
    off = 100.0 * (1.0 / rate - 1.0)
    return _measured(files, bench.source, found, "the Nano's clock differs from the host's by "
                     f"{off:+.3f} %, taken out", seconds)


def typed_clock(files: CarFiles, frequency: float, std: float, source: str = "") -> Measured:
    """The oscillator of a PWM frequency [Hz] that an instrument has shown, with its one sigma.

    Errors: CalibrationFailed for what no PCA9685 does.
    """
    counts = COUNTS_PER_FRAME * (counter_of(files)[0] + 1)
    found = Quantity(frequency * counts, std * counts, f"{frequency:.4f} Hz measured, typed")
    return _measured(files, source, found, f"as typed: {frequency:.4f} +- {std:.2g} Hz of PWM", 0.0)


def _period(answers: list[dict[str, Any]]) -> float:
    """One PWM period [s of the device]. Errors: CalibrationFailed if too few came."""
    captured = answers[-1] if answers else {}
    frames = captured.get("frames", 0)
    if frames >= PERIODS:
        ticks = (captured["last_rise"] - captured["first_rise"]) % (1 << 32)
        return float(ticks / TICKS_PER_SECOND / frames)
    raise CalibrationFailed(
        "the Nano does not see the PCA9685's pulses", found=f"{frames} periods at D8",
        expected=f"{PERIODS}",
        likely="no wire from the spare channel to D8; the oscillator is then known to "
               f"{UNKNOWN:.0%} alone",
        remedy="fit the wire; or measure the PWM frequency of any channel with a scope or a "
               "logic analyser: dart-hal calibrate clock --frequency 50.21 --std 0.01")


def _measured(files: CarFiles, source: str, hertz: Quantity, residual: str, duration: float
              ) -> Measured:
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
            "the oscillator is not known well enough",
            found=f"{hertz.value:.0f} +- {hertz.std:.0f} Hz, {hertz.std / hertz.value:.1%}",
            expected=f"at most {MAX_CLOCK_STD:.1%}: 7.5 us of a pulse of 1500 us",
            remedy="an instrument with a crystal, over more periods; --std is its error in Hz")
    before = files.oscillator_hz.value if files.oscillator_hz else NOMINAL_HZ
    notes = (f"a pulse of 1500 us by the nominal clock is really "
             f"{1500.0 * NOMINAL_HZ / hertz.value:.1f} us",
             *map_outdated(files, abs(hertz.value / before - 1.0) > CHANGED, f"{before:.0f} Hz"))
    return Measured(files.config.name, source or files.config.name, "clock",
                    {"pwm.oscillator_hz": hertz}, residual, duration, notes)


def _check_typed(frequency: float | None = None, std: float | None = None) -> None:
    if (frequency is None) != (std is None):
        raise UsageError("a measured frequency needs its standard error",
                         found="--frequency or --std alone", expected="both",
                         remedy="--frequency 50.21 --std 0.01")


calibrate_clock = Procedure(
    name="clock",
    help="""The oscillator of the PCA9685, by which every pulse is made.

    The Nano times the pulses of the spare channel, by a wire to its D8. Without
    the wire: --frequency and --std of a scope or a logic analyser.
    """,
    plan=plan, measure=measure, condition=Condition.WIRED,
    options=(
        Option("frequency", "PWM frequency of any channel as an instrument shows it; nothing is "
               "measured", None, "Hz", 20.0, 400.0, metavar="HZ"),
        Option("std", "its one sigma", None, "Hz", 0.0, 10.0, metavar="HZ", above_low=True)),
    check=_check_typed, keys=("pwm.oscillator_hz",), optional=True)
